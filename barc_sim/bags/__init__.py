"""Reads, writes and recovers rosbag2 directories of MCAP files, without ROS.

The node that records is in `nodes.recorder`.
"""
