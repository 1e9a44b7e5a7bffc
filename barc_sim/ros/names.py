"""Topic names, relative so that a namespace moves them all, and their quality of service."""

from rclpy.qos import QoSProfile, ReliabilityPolicy

ECU = 'ecu'
STATE = 'z_vhcl'
STATE_ERROR = 'ez_vhcl'
ENVIRONMENT = 'environment'
PID_STATE = 'pid_state'
CMD_VEL = 'cmd_vel'
SPEED_REFERENCE = 'speed_reference'
INITIAL_POSE = 'initialpose'

# For ROS's own tools, by the node `mirror`.
ODOM = 'odom'
PATH = 'path'
MARKERS = 'markers'
ROAD_MARKERS = 'road_markers'
ACCEL = 'accel'
JOINT_STATES = 'joint_states'

# Where everybody looks for them, whatever the namespace.
TF = '/tf'
DIAGNOSTICS = '/diagnostics'
CLOCK = '/clock'

#: Every topic of a run: reliable, with room for a second of 100 Hz.
QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
#: To listen where only the newest counts.
QOS_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
