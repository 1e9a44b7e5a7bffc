"""The composition of a run: its nodes, and how they end."""

from __future__ import annotations

import gc
import sys
import time
from typing import TYPE_CHECKING, Any

from rclpy.parameter import Parameter
from rclpy.task import Future

from barc_sim.errors import UserError
from barc_sim.interfaces.nodes import subscriptions_of
from barc_sim.lab.files import UserCodeError
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.runs.ros_arguments import warn_of_unused
from barc_sim.runs.run_bag import RunBag
from barc_sim.vehicle.bike_model import bikeFE

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Mapping
    from types import TracebackType

    from rclpy.executors import Executor
    from typing_extensions import Self

    from barc_sim.page.run_page import RunPage
    from barc_sim.ros.carrier import Carrier
    from barc_sim.runs.inputs import RunInputs
    from barc_sim.runs.terminal import Display

#: [s] after which a thread that runs Python code gives way to the thread that steps the simulator;
#: the default, 5 ms, is a quarter of a step. Lock-step keeps the default: it has no deadlines, and
#: the recorder is faster with fewer interruptions.
_SWITCH_INTERVAL = 1e-4
#: [s] for mirrors and pages to read the last states.
_READING_TIMEOUT = 2.0
#: The parameters of the simulator that both runs have as options.
_SIMULATOR_OPTIONS = ('realtime_factor', 'seed', 'integrator', 'dynamics', 'clock')


class Run:
    """The nodes of a run; the exit of `with` ends them in order.

    A UserError before the first state deletes the bag, and is raised again. A later one, or any
    error of user code, ends the run as its `failure`, which is stored in the bag, too.

    Attributes
    ----------
    nodes
        All nodes in the order of their creation; the recorder is the first.
    simulators
        The simulator of each car.
    bag
        None: the run records nothing.
    pages
        The live pages.
    display
        The live line in the terminal, which is closed at the end.
    finished
        Done when every simulator has finished.
    failure
        The error that ended the run, as a sentence.
    """

    def __init__(self, options: Namespace, inputs: RunInputs, carrier: Carrier) -> None:
        """Make the bag, unless there is none: it records the other nodes from their start.

        UserError: the bag cannot be made.
        """
        self.options = options
        self.inputs = inputs

        self.nodes: list[Any] = []
        self.simulators: list[VehicleSimulator] = []
        self.pages: list[RunPage] = []
        self.display: Display | None = None
        self.finished = Future()
        self.failure: str | None = None
        self._readers: list[tuple[Any, VehicleSimulator]] = []

        self.bag: RunBag | None = None
        if not options.no_bag:
            self.bag = RunBag(options, inputs.user_code, carrier)
            self.bag.recorder.finished.add_done_callback(lambda _: self.finish())
            self.nodes.append(self.bag.recorder)

    def add(
        self,
        kind: Callable[..., Any],
        parameters: Mapping[str, Any] | None = None,
        *,
        namespace: str = '',
        reads: VehicleSimulator | None = None,
        **options: Any,  # noqa: ANN401 (the node's)
    ) -> Any:  # noqa: ANN401 (of `kind`)
        """Add a node to the run.

        The topics that `NODES` lists as the node's subscriptions are recorded from its start, other
        topics once they are discovered.

        Parameters
        ----------
        kind
            The class of the node.
        parameters
            The node's parameters; one that is None keeps the node's default.
        namespace
            The node's namespace.
        reads
            A simulator whose states the node shows: the run waits at its end until the node's
            `latest`, the stamp of its newest state, is the stamp of the simulator's last state.
        options
            Further arguments of `kind`.

        Returns
        -------
        Any
            The node.

        Raises
        ------
        UserError
            A parameter is out of range, a topic is in use, or a remapping moves every car.
        """
        if self.bag:
            self.bag.expect(subscriptions_of(kind), namespace)

        overrides = []
        for name, value in (parameters or {}).items():
            if value is not None:
                overrides.append(Parameter(name, value=value))
        node = kind(namespace=namespace, parameter_overrides=overrides, **options)
        self.nodes.append(node)

        remapped = node.get_namespace()
        if namespace and remapped != f'/{namespace.strip("/")}':
            raise UserError(
                f'the namespace {remapped} would hold for every car: leave it out, as --cars gives '
                'each car a namespace of its own'
            )
        if reads:
            self._readers.append((node, reads))
        return node

    def add_simulator(self, parameters: Mapping[str, Any], **options: Any) -> VehicleSimulator:  # noqa: ANN401
        """Add and return a simulator, as `add` does, with the options that both runs have."""
        common = {name: getattr(self.options, name) for name in _SIMULATOR_OPTIONS}
        simulator: VehicleSimulator = self.add(
            VehicleSimulator,
            {**common, **parameters},
            model=self.inputs.user_code.model or bikeFE,
            **options,
        )

        self.simulators.append(simulator)
        simulator.finished.add_done_callback(lambda _: self._on_finished())
        if self.bag and simulator.clock_pub:
            self.bag.recorder.stamp_with_clock()
        return simulator

    def _on_finished(self) -> None:
        if all(each.finished.done() for each in self.simulators) and not self.finished.done():
            self.finished.set_result(None)

    def prepare(self) -> None:
        """Describe the run in the bag, and prepare the interpreter, once all nodes were added."""
        # A relay that is a program has its own parameters.
        if self.options.ros_args and not getattr(self.inputs.user_code.relay, 'ros', ''):
            warn_of_unused(self.options.ros_args, self.nodes)
        if self.bag:
            self.bag.describe(self.options.argv, self.nodes, self.simulators[0].track)

        # A full garbage collection takes half a step: exclude objects that live as long as the run.
        gc.collect()
        gc.freeze()
        if any(each.values['realtime_factor'] for each in self.simulators):
            sys.setswitchinterval(_SWITCH_INTERVAL)

    def finish(self) -> None:
        """End the run now; may be called from any thread."""
        for simulator in self.simulators:
            simulator.finish()

    def await_readers(self, executor: Executor) -> None:
        """Spin until mirrors and pages have the last state, which in lock-step may take a while."""
        for simulator in self.simulators:
            executor.remove_node(simulator)
        end = time.monotonic() + _READING_TIMEOUT
        while any(reader.latest < simulator.stepper.stamp for reader, simulator in self._readers):
            if time.monotonic() > end:
                return
            executor.spin_once(timeout_sec=0.1)

    def fail(self, failure: str) -> None:
        """Store the error that ended the run, also in the bag."""
        self.failure = failure
        if self.bag:
            self.bag.add_failure(failure)

    def __enter__(self) -> Self:
        """Begin."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> bool:
        """End the nodes, the recorder last."""
        if self.display:
            self.display.close()

        keeps_bag = error is None or self.states > 0 or isinstance(error, UserCodeError)
        is_failure = keeps_bag and isinstance(error, UserError)
        if is_failure:
            self.fail(str(error))
        if self.bag and keeps_bag:
            self.bag.add_results(states=self.states, missed=self.missed, slipped=self.slipped)

        path = str(self.bag.recorder.path) if self.bag else ''
        for page in self.pages:
            page.end('The run has ended.', path)
        while self.nodes:
            self.nodes.pop().destroy_node()
        if self.bag and not keeps_bag:
            self.bag.delete()
        return is_failure

    @property
    def states(self) -> int:
        """Published states, of all cars."""
        return sum(each.stepper.states for each in self.simulators)

    @property
    def missed(self) -> int:
        """Commands that missed their deadline, of all cars."""
        return sum(each.stepper.missed for each in self.simulators)

    @property
    def slipped(self) -> int:
        """Periods by which simulated time has fallen behind the wall clock, of all cars."""
        return sum(each.stepper.slipped for each in self.simulators)
