"""Reads a running ROS graph from outside: its topics, messages and parameters."""
