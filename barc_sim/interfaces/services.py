"""The names of the services, relative, so that a namespace moves them, and their types.

They are not `~/reset` and the like: a remapped node keeps these names, so that its clients find it.
"""

from __future__ import annotations

#: resets the car, its noise, and every node that commands it
RESET_SIMULATOR = 'vehicle_simulator/reset'
PAUSE_SIMULATOR = 'vehicle_simulator/pause'  #: pauses or resumes simulated time
STEP_SIMULATOR = 'vehicle_simulator/step'  #: takes one step while paused
RESET_CONTROLLER = 'controller/reset'  #: resets the controller
RESET_RELAY = 'relay/reset'  #: clears the driver's input and straightens the wheels
PAUSE_RECORDER = 'bag_recorder/pause'  #: pauses the recording
RESUME_RECORDER = 'bag_recorder/resume'  #: resumes the recording
SPLIT_RECORDER = 'bag_recorder/split_bagfile'  #: ends the file, and begins the next one
SNAPSHOT_RECORDER = 'bag_recorder/snapshot'  #: writes the messages that a snapshot has in memory
PAUSE_PLAYER = 'bag_player/pause'  #: pauses the playback
RESUME_PLAYER = 'bag_player/resume'  #: resumes the playback
TOGGLE_PLAYER = 'bag_player/toggle_paused'  #: pauses or resumes the playback
STEP_PLAYER = 'bag_player/play_next'  #: publishes one message while paused
STOP_PLAYER = 'bag_player/stop'  #: ends the playback

# These begin the names of the services of `ros2 bag record` and `play`, which `barc record` and
# `play` offer, too. Their types are in the package rosbag2_interfaces, which may not be installed.
ROSBAG2_RECORDER = 'rosbag2_recorder'
ROSBAG2_PLAYER = 'rosbag2_player'

#: The type of each service.
SERVICE_TYPES = {
    RESET_SIMULATOR: 'std_srvs/srv/Trigger',
    PAUSE_SIMULATOR: 'std_srvs/srv/SetBool',
    STEP_SIMULATOR: 'std_srvs/srv/Trigger',
    RESET_CONTROLLER: 'std_srvs/srv/Trigger',
    RESET_RELAY: 'std_srvs/srv/Trigger',
    PAUSE_RECORDER: 'std_srvs/srv/Trigger',
    RESUME_RECORDER: 'std_srvs/srv/Trigger',
    SPLIT_RECORDER: 'std_srvs/srv/Trigger',
    SNAPSHOT_RECORDER: 'std_srvs/srv/Trigger',
    PAUSE_PLAYER: 'std_srvs/srv/Trigger',
    RESUME_PLAYER: 'std_srvs/srv/Trigger',
    TOGGLE_PLAYER: 'std_srvs/srv/Trigger',
    STEP_PLAYER: 'std_srvs/srv/Trigger',
    STOP_PLAYER: 'std_srvs/srv/Trigger',
}
