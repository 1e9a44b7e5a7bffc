"""The nodes of barc_sim."""

from __future__ import annotations

#: What our nodes do, by name.
NODES = {
    'vehicle_simulator': 'owns time, and steps the car with the commands that it receives',
    'controller': 'holds the speed, and the lane; answers each state with a command',
    'relay': "turns the driver's input, `cmd_vel`, into commands, `ecu`, at 20 Hz",
    'keyboard': "publishes the driver's input from the terminal's keys, as `cmd_vel`",
    'bag_recorder': 'records every selected topic into a bag',
    'bag_player': 'publishes the messages of a bag on their topics',
    'view': 'serves the live page, and passes its requests to the other nodes',
    'mirror': "publishes the simulator's states as the standard messages of ROS's own tools",
}

#: The nodes whose parameters a log has.
CONTROLLER, SIMULATOR = 'controller', 'vehicle_simulator'
