"""Loads and calls a user's own code.

`code.py` knows the parts of labs, `folder.py` loads and calls any file. `adapters.py` lets user
code drive a car, and `relay_program.py` runs a whole ROS program without ROS.
"""
