"""The nodes of a run, each in a module of its own.

A new node has its class here; the names of its topics and what it does are in `interfaces`, and a
run adds it by `Run.add`. A new type of
message that a run without ROS records has its definition in `interfaces/msg`.

The nodes import `rclpy` and messages as in any ROS package. In a run without ROS these names are
stand-ins: `runs/engine.py` puts `ros/local` into `sys.modules` before a node is imported.
"""
