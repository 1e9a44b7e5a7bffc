"""The nodes of a run, each in a module of its own.

A new node has its class here, with the topics that it subscribes to as `inputs`; the names of its
topics and what it does are in `bags/names.py`, and a run adds it by `Run.add`. A new type of
message that a run without ROS records has its definition in `bags/msg`.
"""

#: The kinds of mirrors: by the parameter of the node `mirror`, what it publishes.
MIRRORS = {
    'odom': 'the pose and the velocity, as nav_msgs/Odometry',
    'tf': 'the same pose as a transform, where ROS has the package tf2_msgs',
    'path': 'the last 200 m, as nav_msgs/Path, once a second, and the track',
    'markers': 'the car and the road, or the track, for RViz and Foxglove',
    'diagnostics': 'the timing, the command and the bag, once a second',
}
