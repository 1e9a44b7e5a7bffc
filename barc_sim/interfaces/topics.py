"""The names of the topics, relative, so that a namespace moves them, and their message types."""

from __future__ import annotations

# The topics that a log is made of. The names `ecu`, `z_vhcl` and `ez_vhcl`, and those of their
# messages, are the ME131 lab's. `z_vhcl` is the measurement z of the vehicle. Its type ZDynBkMdl
# has the state of the dynamic bicycle model, and the kinematic one uses it, too. EZ: error of z.
STATE = 'z_vhcl'
STATE_ERROR = 'ez_vhcl'
#: the true place on the track, where there is one
TRACK_STATE = 'track_vhcl'
ECU = 'ecu'
#: the command that the simulator applies from a state on, which the actuators follow
APPLIED_COMMAND = 'applied_command'
ENVIRONMENT = 'environment'
PID_STATE = 'pid_state'
CONTROLLER_STATE = 'controller_state'
LANE_STATE = 'lane_state'

#: the stamp of each state, where the real-time factor is not 1, and with --clock
CLOCK = '/clock'
#: the driver's input: linear.x and angular.z from -1 to 1; a negative linear.z brakes
CMD_VEL = 'cmd_vel'
PREDICTION = 'prediction'  #: the path that the lane controller plans, at every fifth state
SPEED_REFERENCE = 'speed_reference'  #: the speed to hold [m/s], from an outer loop
INITIAL_POSE = 'initialpose'  #: resets the car to this pose on the map, at rest; RViz publishes it

# Published by the node `mirror`, for ROS's own tools.
ODOM = 'odom'  #: the measured pose from odom to base_link; x on the map, z the elevation
PATH = 'path'  #: the last 200 m of the car's path, once a second
MARKERS = 'markers'  #: the car, 25 times a second
ROAD_MARKERS = 'road_markers'  #: the road, or the track, once, latched (transient local)
TRACK_PATH = 'track_path'  #: the centre line of the track, once, latched

# ROS's own tools expect these outside of every namespace.
TF = '/tf'  #: the pose of odom as a transform, where ROS has tf2_msgs
#: timing, and losses of the bag, once a second
DIAGNOSTICS = '/diagnostics'

#: Of `ros2 bag record`, and of `barc record` where rosbag2_interfaces is installed: a file of the
#: bag has ended.
WRITE_SPLIT = 'events/write_split'

# ROS's own topics, which every node publishes.
ROSOUT = '/rosout'
PARAMETER_EVENTS = '/parameter_events'
#: Figures name them, but do not draw them.
EVERYONES = (ROSOUT, PARAMETER_EVENTS)

#: The message type of each topic that a log is made of.
LOG_TYPES = {
    STATE: 'barc_interfaces/msg/ZDynBkMdl',
    STATE_ERROR: 'barc_interfaces/msg/EZDynBkMdl',
    ECU: 'barc_interfaces/msg/ECU',
    APPLIED_COMMAND: 'barc_interfaces/msg/AppliedCommand',
    ENVIRONMENT: 'barc_interfaces/msg/Environment',
    PID_STATE: 'barc_interfaces/msg/PidState',
    # In place of `pid_state` where the controller is not a PID; its terms are named in the message.
    CONTROLLER_STATE: 'barc_interfaces/msg/ControllerState',
    TRACK_STATE: 'barc_interfaces/msg/TrackState',
    LANE_STATE: 'barc_interfaces/msg/LaneState',
}
#: The message type of each topic.
MESSAGE_TYPES = {
    **LOG_TYPES,
    CLOCK: 'rosgraph_msgs/msg/Clock',
    CMD_VEL: 'geometry_msgs/msg/Twist',
    INITIAL_POSE: 'geometry_msgs/msg/PoseWithCovarianceStamped',
    PREDICTION: 'nav_msgs/msg/Path',
    SPEED_REFERENCE: 'std_msgs/msg/Float64',
    ODOM: 'nav_msgs/msg/Odometry',
    PATH: 'nav_msgs/msg/Path',
    MARKERS: 'visualization_msgs/msg/MarkerArray',
    ROAD_MARKERS: 'visualization_msgs/msg/MarkerArray',
    TRACK_PATH: 'nav_msgs/msg/Path',
    TF: 'tf2_msgs/msg/TFMessage',
    DIAGNOSTICS: 'diagnostic_msgs/msg/DiagnosticArray',
}
