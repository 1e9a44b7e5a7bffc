"""The nodes of barc_sim: the class of each, what it does, its topics and its services.

`barc node`, `ros2 run barc_sim`, `barc graph`, the topics that a run records from its start and the
pages of the reference derive from `NODES`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from barc_sim.interfaces import services, topics

if TYPE_CHECKING:
    from collections.abc import Callable

#: The nodes whose parameters a log has.
SIMULATOR = 'vehicle_simulator'
CONTROLLER = 'controller'


@dataclass(frozen=True, kw_only=True)
class NodeDescription:
    """A node: its class, what it does, and the names of its topics and services.

    It has the topics and services of every configuration, such as those of a run on a track.
    """

    module: str  #: where its class is
    class_name: str
    purpose: str
    publishes: tuple[str, ...] = ()
    subscribes: tuple[str, ...] = ()
    serves: tuple[str, ...] = ()
    calls: tuple[str, ...] = ()
    needs_arguments: bool = False  #: so that it cannot run alone, by `barc node`


#: By name, in the order in which data flows.
NODES = {
    'keyboard': NodeDescription(
        module='barc_sim.nodes.keyboard',
        class_name='Keyboard',
        purpose="publishes the driver's input from the terminal's keys, as `cmd_vel`",
        publishes=(topics.CMD_VEL,),
        calls=(services.RESET_SIMULATOR,),
    ),
    'relay': NodeDescription(
        module='barc_sim.nodes.relay',
        class_name='Relay',
        purpose="turns the driver's input, `cmd_vel`, into commands, `ecu`, at 20 Hz",
        publishes=(topics.ECU,),
        subscribes=(topics.CMD_VEL, topics.STATE),
        serves=(services.RESET_RELAY,),
    ),
    CONTROLLER: NodeDescription(
        module='barc_sim.nodes.controller',
        class_name='CruiseController',
        purpose='holds the speed, and the lane; answers each state with a command',
        publishes=(
            topics.ECU,
            topics.PID_STATE,
            topics.CONTROLLER_STATE,
            topics.LANE_STATE,
            topics.PREDICTION,
        ),
        subscribes=(topics.STATE, topics.SPEED_REFERENCE),
        serves=(services.RESET_CONTROLLER,),
    ),
    SIMULATOR: NodeDescription(
        module='barc_sim.nodes.simulator',
        class_name='VehicleSimulator',
        purpose='owns time, and steps the car with the commands that it receives',
        publishes=(
            topics.CLOCK,
            topics.STATE,
            topics.STATE_ERROR,
            topics.TRACK_STATE,
            topics.ENVIRONMENT,
            topics.APPLIED_COMMAND,
        ),
        subscribes=(topics.ECU, topics.INITIAL_POSE),
        serves=(
            services.RESET_SIMULATOR,
            services.PAUSE_SIMULATOR,
            services.STEP_SIMULATOR,
        ),
        calls=(services.RESET_CONTROLLER, services.RESET_RELAY),
    ),
    'view': NodeDescription(
        module='barc_sim.nodes.view',
        class_name='ViewNode',
        purpose='serves the live page, and passes its requests to the other nodes',
        publishes=(topics.CMD_VEL,),
        subscribes=(
            topics.STATE,
            topics.STATE_ERROR,
            topics.TRACK_STATE,
            topics.ENVIRONMENT,
            topics.ECU,
            topics.PID_STATE,
            topics.CONTROLLER_STATE,
            topics.LANE_STATE,
            topics.PREDICTION,
        ),
        calls=(
            services.RESET_SIMULATOR,
            services.PAUSE_SIMULATOR,
            services.RESET_CONTROLLER,
        ),
    ),
    'mirror': NodeDescription(
        module='barc_sim.nodes.mirror',
        class_name='MirrorNode',
        purpose="publishes the simulator's states as the standard messages of ROS's own tools",
        publishes=(
            topics.ODOM,
            topics.TF,
            topics.PATH,
            topics.MARKERS,
            topics.ROAD_MARKERS,
            topics.TRACK_PATH,
            topics.DIAGNOSTICS,
        ),
        subscribes=(topics.STATE,),
    ),
    'bag_recorder': NodeDescription(
        module='barc_sim.nodes.recorder',
        class_name='BagRecorder',
        purpose='records every selected topic into a bag',
        serves=(
            services.PAUSE_RECORDER,
            services.RESUME_RECORDER,
            services.SPLIT_RECORDER,
            services.SNAPSHOT_RECORDER,
        ),
    ),
    'bag_player': NodeDescription(
        module='barc_sim.nodes.player',
        class_name='BagPlayer',
        purpose='publishes the messages of bags on their topics',
        serves=(
            services.PAUSE_PLAYER,
            services.RESUME_PLAYER,
            services.TOGGLE_PLAYER,
            services.STEP_PLAYER,
            services.STOP_PLAYER,
        ),
        needs_arguments=True,
    ),
}
#: Those that run alone, by `barc node NAME` and `ros2 run barc_sim NAME`.
ALONE = {name: node for name, node in NODES.items() if not node.needs_arguments}


def subscriptions_of(node_class: Callable[..., object]) -> tuple[str, ...]:
    """Return the topics that a node of this class subscribes to; none: it is not in the table."""
    for node in NODES.values():
        if (node.module, node.class_name) == (node_class.__module__, node_class.__qualname__):
            return node.subscribes
    return ()
