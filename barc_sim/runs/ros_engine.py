"""The engine `ros`: the nodes of a run in one process and one executor."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.parameter import Parameter
from rclpy.task import Future

from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.keyboard import Keyboard
from barc_sim.nodes.recorder import BagRecorder
from barc_sim.nodes.relay import Relay
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.page.protocol import Status
from barc_sim.ros.executor import QuickExecutor
from barc_sim.ros.graph_observer import observe
from barc_sim.ros.process import NUM_THREADS
from barc_sim.runs.mirror_nodes import mirrors
from barc_sim.runs.view_options import wants_page

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from rclpy.node import Node

    from barc_sim.bags.node_graph import NodeGraph
    from barc_sim.bags.recording import Recording
    from barc_sim.control.controller import Controller
    from barc_sim.control.driver import Driver
    from barc_sim.control.keyboard import Terminal
    from barc_sim.nodes.view import ViewNode
    from barc_sim.page.run_page import RunPage


class RosEngine:
    """Makes nodes, spins them, and destroys them."""

    name = 'ROS 2 (rclpy)'
    open = True

    def __init__(self) -> None:
        """Begin without nodes."""
        self._nodes: list[Any] = []
        self._recorder: BagRecorder | None = None
        self._simulators: list[VehicleSimulator] = []
        self._views: list[ViewNode] = []

    def add(self, node: Any) -> Any:  # noqa: ANN401 (the node's own type)
        """Spin `node` in this run, and destroy it at the end; return it."""
        self._nodes.append(node)
        return node

    def recorder(
        self,
        directory: Path,
        recording: Recording,
        metadata: Mapping[str, str],
        attachments: Mapping[str, bytes],
    ) -> BagRecorder:
        """Return the node `bag_recorder`, which makes a bag in the folder `directory`."""
        recorder = BagRecorder(directory, recording, metadata=metadata, attachments=attachments)
        self._recorder = self.add(recorder)
        return recorder

    def controller(
        self,
        controller: Controller | None,
        given: Mapping[str, Any],
        *,
        acceleration_limit: float,
        namespace: str = '',
    ) -> CruiseController:
        """Return the node `controller` in `namespace`."""
        self._record(CruiseController.inputs, namespace)
        node: CruiseController = self.add(
            CruiseController(
                controller=controller,
                acceleration_limit=acceleration_limit,
                namespace=namespace,
                parameter_overrides=_overrides(given),
            )
        )
        return node

    def relay(self, driver: Driver | None, given: Mapping[str, Any]) -> Relay:
        """Return the node `relay`."""
        self._record(Relay.inputs)
        node: Relay = self.add(Relay(driver=driver, parameter_overrides=_overrides(given)))
        return node

    def keyboard(self, terminal: Terminal) -> None:
        """Add the node `keyboard`, which ends the run."""
        keyboard = self.add(Keyboard(terminal))
        keyboard.finished.add_done_callback(lambda _: self._finish())

    def simulator(
        self,
        *,
        given: Mapping[str, Any],
        namespace: str = '',
        **options: Any,  # noqa: ANN401 (those of VehicleSimulator)
    ) -> VehicleSimulator:
        """Return the node `vehicle_simulator`."""
        self._record(VehicleSimulator.inputs, namespace)
        simulator: VehicleSimulator = self.add(
            VehicleSimulator(namespace=namespace, parameter_overrides=_overrides(given), **options)
        )
        self._simulators.append(simulator)
        return simulator

    def _record(self, inputs: Mapping[str, type[Any]], namespace: str = '') -> None:
        """Record the topics that a node in `namespace` is going to subscribe to."""
        if self._recorder:
            prefix = namespace and f'{namespace}/'
            self._recorder.expect({prefix + name: kind for name, kind in inputs.items()})

    def show(self, options: Namespace) -> None:
        """Add the mirrors, the server of the Foxglove app, and a page for each car.

        The nodes are complete then: the recorder subscribes to every topic of them.
        """
        if self._recorder:
            self._recorder.use_sim_time = any(each.keeps_clock for each in self._simulators)
        for node in mirrors(options, self._simulators, self._recorder):
            self.add(node)
        if wants_page(options):
            self._views = [self.add(view) for view in self._serve(options)]
        if self._recorder:
            self._recorder.discover()

    def _serve(self, options: Namespace) -> Iterator[ViewNode]:
        from barc_sim.nodes.view import ViewNode  # noqa: PLC0415 (a server, only if wanted)

        for number, simulator in enumerate(self._simulators):
            view = ViewNode(
                options.mode,
                host=options.view_host,
                port=options.view_port and options.view_port + number,
                status=partial(_status, simulator),
                road=simulator.road,
                finish=self._finish,
                namespace=simulator.get_namespace(),
            )
            if not options.quiet:
                print(f'live page  {view.url}', flush=True)  # noqa: T201
            from barc_sim.page.server import open_page  # noqa: PLC0415 (slow: only for a page)

            open_page(view.url)
            yield view

    def parameters(self) -> dict[str, dict[str, Any]]:
        """Return the parameters of all nodes, by the nodes' full names."""
        return {node.get_fully_qualified_name(): _values(node) for node in self._nodes}

    def graph(self) -> NodeGraph:
        """Return the graph of nodes and topics, as any node sees it."""
        return observe(self._nodes[0])

    def spin(self) -> None:
        """Spin until every simulator has finished, or recording has failed for good."""
        executor = QuickExecutor(num_threads=NUM_THREADS)
        for node in self._nodes:
            executor.add_node(node)
        if self._recorder:
            self._recorder.finished.add_done_callback(lambda _: self._finish())
        try:
            executor.spin_until_future_complete(self._finished())
        finally:
            executor.shutdown()

    def _finish(self) -> None:
        for simulator in self._simulators:
            simulator.finish()

    def _finished(self) -> Future:
        """Return a future that is done when every simulator has finished."""
        finished = Future()

        def check(_: Future) -> None:
            if all(simulator.finished.done() for simulator in self._simulators):
                finished.set_result(None)

        for simulator in self._simulators:
            simulator.finished.add_done_callback(check)
        return finished

    def close(self, *, keep_page: bool = False) -> RunPage | None:
        """Destroy the nodes, the recorder last; a second call does nothing."""
        views = self._views if self._nodes else []
        bag = str(self._recorder.path) if self._recorder else ''
        for view in views:
            view.page.end('The run has ended.', bag)
        page = views[0].release_page() if keep_page and len(views) == 1 else None
        while self._nodes:
            self._nodes.pop().destroy_node()
        return page


def _status(simulator: VehicleSimulator) -> Status:
    return Status(simulator.stepper.missed, simulator.stepper.slipped, simulator.stepper.paused)


def _overrides(given: Mapping[str, Any]) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in given.items()]


def _values(node: Node) -> dict[str, Any]:
    names = node.list_parameters(prefixes=[], depth=0).names
    return {parameter.name: parameter.value for parameter in node.get_parameters(names)}
