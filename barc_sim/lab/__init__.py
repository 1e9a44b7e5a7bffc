"""Teaching: a user's own code, its templates, checking, grading and reports.

It runs without ROS; a user's model and controller reach a node as values.
"""
