"""Loads and calls a user's own code.

`code.py` has the parts of labs, `folder.py` loads and calls any file. `adapters.py` makes
controllers of user code, and `relay_program.py` runs a whole ROS program without ROS.
"""
