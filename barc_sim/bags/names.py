"""Names of topics, services and nodes, all relative, so that a namespace moves them; their graph.

A new node of ours has its topics here, and its line in `NODES`.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from barc_sim.bags import bounds, recording
from barc_sim.simulation import log

if TYPE_CHECKING:
    from collections.abc import Iterable

# The topics that a log is made of.
STATE, STATE_ERROR, TRACK_STATE = log.STATE, log.STATE_ERROR, log.TRACK_STATE
ECU, APPLIED_COMMAND = log.COMMAND, log.APPLIED_COMMAND
ENVIRONMENT = log.ENVIRONMENT
PID_STATE, CONTROLLER_STATE, LANE_STATE = log.PID_STATE, log.CONTROLLER_STATE, log.LANE_STATE
#: the stamp of each state, where the real-time factor is not 1, and with --clock
CLOCK = recording.CLOCK
#: the driver's input: linear.x and angular.z from -1 to 1; a negative linear.z brakes
CMD_VEL = 'cmd_vel'
PREDICTION = 'prediction'  #: the path that the lane controller plans, at every fifth state
SPEED_REFERENCE = 'speed_reference'  #: the speed to hold [m/s], from an outer loop

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

# Services. Not `~/reset`: a remapped node keeps these names, so that its clients find them.
#: resets the car, its noise, and every node that commands it
RESET_SIMULATOR = 'vehicle_simulator/reset'
PAUSE_SIMULATOR = 'vehicle_simulator/pause'  #: pauses or resumes simulated time
STEP_SIMULATOR = 'vehicle_simulator/step'  #: takes one step while paused
RESET_CONTROLLER = 'controller/reset'  #: resets the controller
RESET_RELAY = 'relay/reset'  #: clears the driver's input and straightens the wheels
PAUSE_RECORDER = 'bag_recorder/pause'  #: pauses the recording
RESUME_RECORDER = 'bag_recorder/resume'  #: resumes the recording

# rclpy's default QoS, reliable, with a queue of one of these depths, in messages.
QOS = 100  #: of every topic of a run: one second at 100 Hz
#: Of a node that needs every state and that the simulator does not wait for: in lock-step many
#: states arrive during one of its callbacks.
QOS_ALL = 10_000
QOS_NEWEST = 1  #: of a subscription that needs only the newest message

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


#: ROS's own topics, which every node publishes; figures name them, but do not draw them.
EVERYONES = ('/rosout', '/parameter_events')

Link = tuple[str, str]


@dataclass(frozen=True)
class NodeGraph:
    """The nodes of a system with their topics, all by their full names, sorted."""

    nodes: tuple[str, ...]
    topics: dict[str, str]  #: the type of each
    publications: tuple[Link, ...]  #: node and topic
    subscriptions: tuple[Link, ...]  #: topic and node

    def to_json(self) -> str:
        """Return the graph as JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> NodeGraph:
        """Return the graph from the JSON of `to_json`."""
        values = bounds.from_json(text)
        try:
            graph = cls(
                nodes=tuple(map(_name, values['nodes'])),
                topics={_name(topic): _name(kind) for topic, kind in values['topics'].items()},
                publications=_links(values['publications']),
                subscriptions=_links(values['subscriptions']),
            )
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(f'no graph: {error!r}') from None
        present = {*graph.nodes, *graph.topics}
        links = (*graph.publications, *graph.subscriptions)
        if len(present) > bounds.MAX_NODES or len(links) > bounds.MAX_LINKS:
            raise ValueError(f'a graph of {len(present)} nodes and topics, and {len(links)} links')
        if not present.issuperset(name for link in links for name in link):
            raise ValueError('a graph with a link to a node or topic that it lacks')
        return graph


def _name(value: object) -> str:
    if not isinstance(value, str) or len(value) > bounds.MAX_NAME:
        raise TypeError('a name')
    return value


def _links(pairs: Iterable[tuple[object, object]]) -> tuple[Link, ...]:
    return tuple((_name(source), _name(target)) for source, target in pairs)
