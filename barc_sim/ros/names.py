"""Names of topics and services, relative so that a namespace moves them all, and their QoS."""

from rclpy.qos import QoSProfile, ReliabilityPolicy

from barc_sim.simulation.log import COMMAND as ECU
from barc_sim.simulation.log import CONTROLLER_STATE, ENVIRONMENT, PID_STATE, STATE, STATE_ERROR

__all__ = ['CONTROLLER_STATE', 'ECU', 'ENVIRONMENT', 'PID_STATE', 'STATE', 'STATE_ERROR']

CMD_VEL = 'cmd_vel'
SPEED_REFERENCE = 'speed_reference'
INITIAL_POSE = 'initialpose'

# Published by the node `mirror`, for ROS's own tools.
ODOM = 'odom'
PATH = 'path'
MARKERS = 'markers'
ROAD_MARKERS = 'road_markers'
ACCEL = 'accel'
JOINT_STATES = 'joint_states'

# ROS's own tools expect these outside of every namespace.
TF = '/tf'
DIAGNOSTICS = '/diagnostics'
CLOCK = '/clock'

# Services. Not `~/reset`: a remapped node keeps these names, so that its clients find them.
RESET_SIMULATOR = 'vehicle_simulator/reset'
PAUSE_SIMULATOR = 'vehicle_simulator/pause'
STEP_SIMULATOR = 'vehicle_simulator/step'
RESET_CONTROLLER = 'controller/reset'
RESET_RELAY = 'relay/reset'

#: Of every topic of a run: reliable, with room for a second at 100 Hz.
QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
#: Of a subscription that needs only the newest message.
QOS_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
