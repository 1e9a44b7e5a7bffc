"""The engine `local`: the nodes of a run as objects in one thread, without ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from barc_sim.bags.node_graph import NodeGraph
from barc_sim.page.protocol import Status
from barc_sim.runs.local.driving import DriverTopic, LocalKeyboard, LocalRelay
from barc_sim.runs.local.host import LocalHost
from barc_sim.runs.local.nodes import LocalController, LocalSimulator
from barc_sim.runs.local.recorder import LocalRecorder
from barc_sim.runs.view_options import wants_page

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from barc_sim.bags.recording import Recording
    from barc_sim.control.controller import Controller
    from barc_sim.control.driver import Driver
    from barc_sim.control.keyboard import Terminal
    from barc_sim.page.run_page import RunPage


class LocalEngine:
    """Carries the messages of one car's run by calls.

    Examples
    --------
    >>> from barc_sim.control.pid import ACCELERATION_LIMIT
    >>> from barc_sim.vehicle.bike_model import bikeFE
    >>> engine = LocalEngine(['-p', 'realtime_factor:=0.0'])
    >>> controller = engine.controller(None, {}, acceleration_limit=ACCELERATION_LIMIT)
    >>> simulator = engine.simulator(
    ...     road=None, on_step=lambda t, seen: None, model=bikeFE, given={}, distance=50.0
    ... )
    >>> engine.spin()
    >>> simulator.stepper.states, simulator.stepper.missed
    (339, 0)
    >>> engine.close()
    """

    name = 'local, without ROS'
    open = False

    def __init__(self, ros_args: Iterable[str]) -> None:
        """Take parameters from `ros_args`.

        Raises
        ------
        UserError
            An argument is not understood, or needs ROS.
        """
        self._host = LocalHost(ros_args)
        self._recorder: LocalRecorder | None = None
        self._controller: LocalController | None = None
        self._relay: LocalRelay | None = None
        self._keyboard: LocalKeyboard | None = None
        self._page: RunPage | None = None

    def recorder(
        self,
        directory: Path,
        recording: Recording,
        metadata: Mapping[str, str],
        attachments: Mapping[str, bytes],
    ) -> LocalRecorder:
        """Return a recorder, which makes a bag in the folder `directory`."""
        metadata = {'engine': self.name, **metadata}
        self._recorder = LocalRecorder(
            self._host, directory, recording, metadata=metadata, attachments=attachments
        )
        return self._recorder

    def controller(
        self,
        controller: Controller | None,
        given: Mapping[str, Any],
        *,
        acceleration_limit: float,
        namespace: str = '',
    ) -> LocalController:
        """Return the node `controller`, which answers the simulator that is made next."""
        del namespace
        self._controller = LocalController(self._host, controller, given, acceleration_limit)
        return self._controller

    def relay(self, driver: Driver | None, given: Mapping[str, Any]) -> LocalRelay:
        """Return the node `relay`, which commands the simulator that is made next."""
        self._relay = LocalRelay(self._host, driver, given)
        return self._relay

    def keyboard(self, terminal: Terminal) -> None:
        """Add the node `keyboard`, which drives through the relay and ends the run."""
        assert self._relay  # noqa: S101 (a run without it is not driven by hand)
        simulator = self._simulator
        self._keyboard = LocalKeyboard(
            self._host, terminal, self._relay, simulator.reset, simulator.finish
        )

    def simulator(
        self,
        *,
        namespace: str = '',
        keeps_clock: bool = True,
        **options: Any,  # noqa: ANN401 (those of LocalSimulator)
    ) -> LocalSimulator:
        """Return the node `vehicle_simulator`."""
        del namespace, keeps_clock
        simulator = LocalSimulator(self._host, **options)
        if self._controller:
            simulator.on_state = self._controller.answer
            simulator.on_reset = self._controller.reset
        if self._relay:
            simulator.on_state = self._relay.take_state
            simulator.on_reset = self._relay.reset
            self._relay.on_command = simulator.command
        if self._recorder and simulator.keeps_clock:
            self._recorder.use_simulated_time()
        self._host.loop.soon(simulator.begin)
        self._simulator = simulator
        return simulator

    def parameters(self) -> dict[str, dict[str, Any]]:
        """Return the parameters of all nodes, by the nodes' full names."""
        return {f'/{node.name}': node.parameters for node in self._host.nodes}

    def graph(self) -> NodeGraph:
        """Return the graph of nodes and topics."""
        publishers = self._host.topics.publishers
        return NodeGraph(
            nodes=tuple(sorted(f'/{node.name}' for node in self._host.nodes)),
            topics=dict(sorted((each.name, each.type) for each in publishers)),
            publications=tuple(sorted((f'/{each.node}', each.name) for each in publishers)),
            subscriptions=tuple(sorted(self._links())),
        )

    def _links(self) -> set[tuple[str, str]]:
        """Return who is called with the messages of each topic."""
        readers = [('/ecu', 'vehicle_simulator')]
        if self._controller:
            readers += [('/z_vhcl', 'controller'), ('/ez_vhcl', 'controller')]
        if self._relay:
            readers += [('/z_vhcl', 'relay'), ('/cmd_vel', 'relay')]
        links = {(topic, f'/{node}') for topic, node in readers}
        if self._recorder:
            links |= {(each.name, '/bag_recorder') for each in self._host.topics.publishers}
        return links

    def show(self, options: Namespace) -> None:
        """Serve the live page, if the options ask for it.

        Raises
        ------
        UserError
            The port cannot be used.
        """
        if not wants_page(options):
            return
        from barc_sim.page.run_page import RunPage  # noqa: PLC0415 (a server, only if wanted)
        from barc_sim.runs.local.view import LocalClients, serve  # noqa: PLC0415

        simulator, host = self._simulator, self._host
        stepper = simulator.stepper
        self._page = page = RunPage(
            options.mode,
            options.view_host,
            options.view_port,
            lambda: Status(stepper.missed, stepper.slipped, stepper.paused),
            simulator.road,
            simulator.finish,
        )
        topic = DriverTopic(host, host.node('view').name, self._relay)
        clients = LocalClients(host, simulator, self._controller, page.call)
        serve(page, host, clients, topic.publish)
        if not options.quiet:
            print(f'live page  {page.url}', flush=True)  # noqa: T201
        from barc_sim.page.server import open_page  # noqa: PLC0415 (slow: only for a page)

        open_page(page.url)

    def spin(self) -> None:
        """Run until the simulator has finished."""
        recorder, simulator = self._recorder, self._simulator
        if recorder:
            self._host.loop.run(lambda: simulator.finished or recorder.keep_up())
        else:
            self._host.loop.run(lambda: simulator.finished)

    def close(self, *, keep_page: bool = False) -> RunPage | None:
        """Restore the terminal, and finish the bag; a second call does nothing."""
        if self._keyboard:
            self._keyboard.close()
            self._keyboard = None
        page, self._page = self._page, None
        if page:
            page.end('The run has ended.', str(self._recorder.path) if self._recorder else '')
            if not keep_page:
                page.close()
        if self._recorder:
            self._recorder.close()
        return page if keep_page else None
