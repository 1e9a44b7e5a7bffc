"""The nodes of a run, each in a module of its own.

A new node has its class here, with the topics that it subscribes to as `inputs`; the names of its
topics and what it does are in `interfaces`, and a run adds it by `Run.add`. A new type of
message that a run without ROS records has its definition in `interfaces/msg`.
"""
