"""The kinds of mirrors, each turned on or off by a parameter of the node `mirror`."""

#: By the parameter's name, what the mirror publishes.
MIRRORS = {
    'odom': 'the pose and the velocity, as nav_msgs/Odometry',
    'tf': 'the same pose as a transform, where ROS has the package tf2_msgs',
    'path': 'the path so far, as nav_msgs/Path, once a second',
    'markers': 'the car and the road for RViz and Foxglove',
    'accel': 'the acceleration over the ground, as geometry_msgs/AccelStamped',
    'joint_states': "the wheels' angles and speeds, as sensor_msgs/JointState",
    'diagnostics': 'the timing, the command, the noise and the bag, once a second',
}
