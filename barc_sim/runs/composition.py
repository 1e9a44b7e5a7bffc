"""Composes the nodes of a run in one process and one executor, and spins them to its end."""

from __future__ import annotations

import gc
import sys
from abc import ABC, abstractmethod
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.parameter import Parameter
from rclpy.task import Future

from barc_sim.page.desktop import open_page
from barc_sim.page.protocol import Status
from barc_sim.runs.bag import RunBag
from barc_sim.runs.mirror_nodes import mirrors
from barc_sim.runs.view_options import wants_page

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator, Sequence

    from rclpy.executors import Executor
    from rclpy.node import Node

    from barc_sim.cli.signals import StopSignals
    from barc_sim.lab.user_code.loading import UserCode
    from barc_sim.nodes.simulator.node import VehicleSimulator
    from barc_sim.nodes.view.node import ViewNode
    from barc_sim.runs.terminal.display import Display
    from barc_sim.runs.terminal.user_output import UserOutput
    from barc_sim.vehicle.road import Road

#: [s] A thread that runs Python code gives way to the one that steps the simulator after this
#: long; the default, 5 ms, is a quarter of a step.
_SWITCH_INTERVAL = 1e-4


class Setup(NamedTuple):
    """What a run is made of: the command line, and the values that it names."""

    options: Namespace
    argv: list[str]
    road: Road | None  #: of `--road`; None: that of the simulator's parameter
    user_code: UserCode
    output: UserOutput  #: takes what user code prints


class Run(ABC):
    """The recorder, the simulator of each car, and the nodes that drive and show them."""

    display: Display  #: what the terminal shows; `compose` sets it

    def __init__(self, setup: Setup) -> None:
        """Create the nodes, the recorder first: it records what the others publish at their start.

        Raises
        ------
        UserError
            if a parameter or the topic cannot be had; no bag is left then.
        """
        options = setup.options
        self.setup = setup
        self.failure: str | None = None  #: the error that ended the run
        self.bag = None if options.no_bag else RunBag(options, setup.user_code)
        self._nodes: list[Node] = [self.bag.recorder] if self.bag else []
        self._views: list[ViewNode] = []
        try:
            self.simulators = self.compose(setup)
            setup.output.show_with(self.display.print_line)
            recorder = self.bag.recorder if self.bag else None
            if recorder:
                recorder.use_sim_time = any(each.keeps_clock for each in self.simulators)
            for node in mirrors(options, self.simulators, recorder):
                self.add(node)
            if wants_page(options):
                self._views = [self.add(view) for view in self._serve(options)]
        except BaseException:
            self.discard()
            raise
        if self.bag:
            self.bag.begin(setup.argv, self._nodes)

    @abstractmethod
    def compose(self, setup: Setup) -> Sequence[VehicleSimulator]:
        """Create the nodes with `add`, and the display; return the simulators, one for each car."""

    @abstractmethod
    def print_result(self) -> None:
        """Print the results."""

    def _serve(self, options: Namespace) -> Iterator[ViewNode]:
        from barc_sim.nodes.view.node import ViewNode  # noqa: PLC0415 (a server, only if wanted)

        for number, simulator in enumerate(self.simulators):
            view = ViewNode(
                options.mode,
                host=options.view_host,
                port=options.view_port and options.view_port + number,
                status=partial(_status, simulator),
                road=simulator.road,
                namespace=simulator.get_namespace(),
            )
            if not options.quiet:
                print(f'live page  {view.url}', flush=True)  # noqa: T201
            open_page(view.url)
            yield view

    def add(self, node: Any) -> Any:  # noqa: ANN401 (the node's own type)
        """Spin `node` in this run, and destroy it at the end; return it."""
        self._nodes.append(node)
        return node

    def spin(self, stop: StopSignals, executor: Executor) -> None:
        """Spin until the run is finished or `stop` is requested."""
        for node in self._nodes:
            executor.add_node(node)
        # A full garbage collection takes half a step: exclude what lives as long as the run.
        gc.collect()
        gc.freeze()
        sys.setswitchinterval(_SWITCH_INTERVAL)
        stop.then(self.finish)
        if self.bag:
            self.bag.recorder.finished.add_done_callback(lambda _: self.finish())
        try:
            executor.spin_until_future_complete(self._finished())
        finally:
            executor.shutdown()
            self.setup.output.close()
            self.display.close()

    def _finished(self) -> Future:
        """Return a future that is done when every simulator has finished."""
        finished = Future()

        def check(_: Future) -> None:
            if all(simulator.finished.done() for simulator in self.simulators):
                finished.set_result(None)

        for simulator in self.simulators:
            simulator.finished.add_done_callback(check)
        return finished

    def finish(self) -> None:
        """End the run now; may be called from any thread."""
        for simulator in self.simulators:
            simulator.finish()

    @property
    def has_begun(self) -> bool:
        """Whether a state has been published."""
        return any(simulator.steps for simulator in self.simulators)

    @property
    def slipped(self) -> int:
        """Periods by which simulated time has fallen behind the wall clock, of all cars."""
        return sum(simulator.slipped for simulator in self.simulators)

    def fail(self, failure: str) -> None:
        """Keep the error that ended the run, also in the bag."""
        self.failure = failure
        if self.bag:
            self.bag.recorder.add_metadata({'failure': failure})

    def close(self) -> None:
        """Destroy the nodes, the recorder last, with the results in its bag; again, do nothing."""
        if self.bag and self._nodes:
            self.bag.end(self.simulators)
        for view in self._views if self._nodes else ():
            view.end('The run has ended.', bag=str(self.bag.recorder.path) if self.bag else '')
        self._destroy()

    def discard(self) -> None:
        """Destroy the nodes, and delete the bag."""
        self._destroy()
        if self.bag:
            self.bag.discard()

    def _destroy(self) -> None:
        while self._nodes:
            self._nodes.pop().destroy_node()

    def print_end(self) -> None:
        """Print the results and the bag, or only the bag's path if quiet."""
        if not self.setup.options.quiet:
            self.print_result()
            if self.bag:
                self.bag.print_commands()
        elif self.bag:
            print(self.bag.recorder.path)  # noqa: T201


def _status(simulator: VehicleSimulator) -> Status:
    return Status(simulator.missed, simulator.slipped, simulator.paused)


def overrides(**values: float | str | None) -> list[Parameter]:
    """Return the parameters that the command line sets; the others keep the nodes' defaults."""
    return [Parameter(name, value=value) for name, value in values.items() if value is not None]
