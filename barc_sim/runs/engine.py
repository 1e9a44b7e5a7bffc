"""The engine of a run: what carries its messages, ROS or calls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from barc_sim.cli.ros_hint import has_ros, needs_ros

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from barc_sim.bags.node_graph import NodeGraph
    from barc_sim.bags.recording import Recording
    from barc_sim.control.controller import Controller
    from barc_sim.control.driver import Driver
    from barc_sim.control.keyboard.terminal import Terminal
    from barc_sim.page.run_page import RunPage
    from barc_sim.vehicle.bike_model import Model
    from barc_sim.vehicle.plant import Observation
    from barc_sim.vehicle.road import Road

#: The options of a run that need ROS, and the value with which each does not.
_ROS_OPTIONS = {
    'cars': 1,
    'no_controller': False,
    'no_relay': False,
    'foxglove': None,
    'mirrors': None,
    'network': False,
}


class Simulator(Protocol):
    """The node `vehicle_simulator`."""

    @property
    def road(self) -> Road:
        """The road."""

    @property
    def values(self) -> Mapping[str, Any]:
        """The parameters, by name."""

    @property
    def steps(self) -> int:
        """States published."""

    @property
    def missed(self) -> int:
        """Commands that had not arrived when they were due."""

    @property
    def slipped(self) -> int:
        """Periods by which simulated time has fallen behind the wall clock."""

    def end(self) -> None:
        """End the run once the present state is answered; call it in `on_step` only."""

    def finish(self) -> None:
        """End the run; may be called from any thread."""


class CarController(Protocol):
    """The node `controller`."""

    @property
    def acceleration_limit(self) -> float:
        """The greatest acceleration that it commands [m/s²]."""

    @property
    def speed_reference(self) -> float:
        """The speed to hold [m/s]."""


class Relay(Protocol):
    """The node `relay`."""

    @property
    def driver(self) -> Driver:
        """Makes the commands."""


class Recorder(Protocol):
    """The node `bag_recorder`."""

    path: Path
    failure: str | None

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages recorded, by topic."""

    @property
    def lost(self) -> dict[str, dict[str, int] | None]:
        """Number of messages lost, by topic and node."""

    @property
    def left_out(self) -> Mapping[str, str]:
        """Topics that cannot be recorded, and why."""

    def add_metadata(self, entries: Mapping[str, str]) -> None:
        """Add metadata of the run to the bag."""


class Engine(Protocol):
    """Makes the nodes of a run, carries their messages, and ends them; the recorder comes first.

    Where a method makes a node, it raises UserError for a parameter that is out of range.
    """

    name: str  #: as the first line of a run has it
    open: bool  #: whether nodes of other processes can join

    def recorder(
        self,
        directory: Path,
        recording: Recording,
        metadata: Mapping[str, str],
        attachments: Mapping[str, bytes],
    ) -> Recorder:
        """Return a recorder, which makes a bag in the folder `directory`."""

    def controller(
        self,
        controller: Controller | None,
        given: Mapping[str, Any],
        *,
        acceleration_limit: float,
        namespace: str = '',
    ) -> CarController:
        """Return a controller of the car in `namespace`, whose parameters are `given`.

        `acceleration_limit` [m/s²] is the default of that parameter.
        """

    def relay(self, driver: Driver | None, given: Mapping[str, Any]) -> Relay:
        """Return a relay, whose parameters are `given`; `driver` replaces barc_sim's own."""

    def keyboard(self, terminal: Terminal) -> None:
        """Add a keyboard, which drives and ends the run, after the simulator."""

    def simulator(
        self,
        *,
        road: Road | None,
        on_step: Callable[[float, Observation], None],
        model: Model,
        given: Mapping[str, Any],
        distance: float = 0.0,
        namespace: str = '',
        keeps_clock: bool = True,
    ) -> Simulator:
        """Return a simulator, after what commands it."""

    def show(self, options: Namespace) -> None:
        """Serve what the options ask for: a page, mirrors, the Foxglove app."""

    def begin_recording(self) -> None:
        """Record every topic of the nodes."""

    def parameters(self) -> Mapping[str, Mapping[str, Any]]:
        """Return the parameters of all nodes, by the nodes' full names."""

    def graph(self) -> NodeGraph:
        """Return the graph of nodes and topics."""

    def spin(self) -> None:
        """Run until every simulator has finished."""

    def close(self, *, keep_page: bool = False) -> RunPage | None:
        """End the nodes, the recorder last; a second call does nothing.

        With `keep_page`, the page of a run of one car stays open, and is returned.
        """


def add_engine_option(parser: ArgumentParser) -> None:
    """Add `--engine`."""
    parser.add_argument(
        '--engine',
        choices=('auto', 'ros', 'local'),
        default='auto',
        help='what carries the messages: ROS 2, or calls without it (auto: ROS 2 where it is '
        'installed)',
    )


def uses_ros(options: Namespace) -> bool:
    """Return whether ROS carries the messages of a run.

    Raises
    ------
    UserError
        if an option needs ROS, and there is none, or it is not to be used.

    Examples
    --------
    >>> from argparse import ArgumentParser
    >>> parser = ArgumentParser()
    >>> add_engine_option(parser)
    >>> uses_ros(parser.parse_args(['--engine', 'local']))
    False
    """
    ros = has_ros() if options.engine == 'auto' else options.engine == 'ros'
    if ros and not has_ros():
        raise needs_ros('--engine ros')
    for name, without in _ROS_OPTIONS.items():
        if not ros and getattr(options, name, without) != without:
            raise needs_ros(f'--{name.replace("_", "-")}')
    return ros
