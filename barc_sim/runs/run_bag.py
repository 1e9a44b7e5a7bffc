"""The bag of a run: its recorder, and what describes the run beside the messages."""

from __future__ import annotations

import shlex
import shutil
from contextlib import suppress
from platform import platform, python_version
from typing import TYPE_CHECKING, Any

import yaml

from barc_sim import __version__
from barc_sim.bags.metadata import track_file
from barc_sim.control.cruise_control import GAINS
from barc_sim.interfaces.topics import MESSAGE_TYPES
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.recorder import BagRecorder
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.ros.peers import node_graph
from barc_sim.runs.engine import LOCAL
from barc_sim.runs.recording_options import recording

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterable, Sequence

    from rclpy.node import Node

    from barc_sim.lab.user_code.code import UserCode
    from barc_sim.ros.carrier import Carrier
    from barc_sim.vehicle.track import Track


class RunBag:
    """Records a run with its description: command line, parameters, graph, track, user code."""

    def __init__(self, options: Namespace, user_code: UserCode, carrier: Carrier) -> None:
        """Begin to record; UserError: the bag cannot be made."""
        metadata = user_code.describe()
        if options.engine == LOCAL:
            metadata = {**metadata, 'engine': carrier.name}

        self._root_is_new = not options.bag_dir.exists()
        self.recorder = BagRecorder(
            options.bag_dir, recording(options), metadata=metadata, carrier=carrier
        )
        self.recorder.attach(user_code.attachments())

    def expect(self, topics: Iterable[str], namespace: str) -> None:
        """Record these topics of a namespace from now on.

        A publisher may wait for the subscription of a new node, send one message, and end.
        """
        prefix = f'{namespace.rstrip("/")}/' if namespace else ''
        self.recorder.expect({prefix + name: MESSAGE_TYPES[name] for name in topics})

    def describe(self, argv: Sequence[str], nodes: Sequence[Node], track: Track | None) -> None:
        """Add the command line, the parameters, the graph and the track, and record all nodes."""
        self.recorder.discover()
        self.recorder.announce()
        self.recorder.add_metadata(
            {
                'command': shlex.join(['barc', *argv]),
                'barc_sim': __version__,
                'python': python_version(),
                'platform': platform(),
                'parameters': yaml.safe_dump(_parameters(nodes), sort_keys=False),
                **_settings(nodes),
            }
        )
        self._add_graph()

        if track:
            self.recorder.attach(track_file(track))

    def _add_graph(self) -> None:
        self.recorder.add_metadata({'graph': node_graph(self.recorder).to_json()})

    def add_failure(self, failure: str) -> None:
        """Add the error that ended the run."""
        self.recorder.add_metadata({'failure': failure})

    def add_results(self, *, states: int, missed: int, slipped: int) -> None:
        """Add the numbers of a run at its end, and its last graph."""
        self.recorder.add_metadata(
            {
                'steps': str(states),
                'missed_deadlines': str(missed),
                'slipped_periods': str(slipped),
            }
        )
        self._add_graph()

    def delete(self) -> None:
        """Delete the bag, and the folder of bags if the run has made it; the recorder has ended."""
        shutil.rmtree(self.recorder.path)
        if self._root_is_new:
            with suppress(OSError):  # another run has its bag there
                self.recorder.path.parent.rmdir()


def _parameters(nodes: Iterable[Node]) -> dict[str, Any]:
    """Return the parameters of all nodes, as `ros2 param load` reads them."""
    parameters: dict[str, Any] = {}
    for node in nodes:
        names = node.list_parameters(prefixes=[], depth=0).names
        values = {each.name: each.value for each in node.get_parameters(names)}
        parameters[node.get_fully_qualified_name()] = {'ros__parameters': values}
    return parameters


def _settings(nodes: Iterable[Node]) -> dict[str, str]:
    """Return the main settings of the first car: gains, lane, road and track."""
    settings: dict[str, Any] = {}
    for node in nodes:
        # By class, not by name: `-r __node:=car` gives all nodes one name.
        if isinstance(node, CruiseController):
            of_node = _of_controller(node)
        elif isinstance(node, VehicleSimulator):
            of_node = _of_simulator(node)
        else:
            continue

        for name, value in of_node.items():
            settings.setdefault(name, value)

    return {name: str(value) for name, value in settings.items()}


def _of_controller(node: CruiseController) -> dict[str, Any]:
    settings: dict[str, Any] = {}
    if not (node.lane and node.lane.plans_speed):
        settings |= {name: node.values[name] for name in GAINS if name in node.values}

    if node.lane and node.has_parameter('lane_type'):
        settings['lane'] = node.get_parameter('lane_type').value
    return settings


def _of_simulator(node: VehicleSimulator) -> dict[str, Any]:
    settings = {'road': node.values['road']}
    if node.track:
        settings['track'] = node.track.name
    return settings
