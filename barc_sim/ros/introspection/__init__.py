"""Looks at a running ROS graph: topics, messages and parameters."""
