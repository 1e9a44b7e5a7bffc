"""What all packages share: topics, services, QoS, stamps, messages, parameters and nodes.

It needs no ROS. The definitions of our messages are in `barc_interfaces/msg`; those of other
packages that a run without ROS needs are in `msg`.
"""
