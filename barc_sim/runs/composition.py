"""The parts that both runs share: executor, nodes, mirrors and pages, bag, and the end."""

from __future__ import annotations

import gc
import shlex
import shutil
import sys
import time
from contextlib import contextmanager, suppress
from functools import partial
from itertools import pairwise
from platform import platform, python_version
from typing import TYPE_CHECKING, Any

import rclpy
import yaml
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import MultiThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from barc_sim import __version__
from barc_sim.bags.recording import track_file
from barc_sim.cli.parser import barc_path, report, warn
from barc_sim.control.cruise_control import GAINS
from barc_sim.errors import UserError
from barc_sim.lab.files import UserCodeError
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.recorder import BagRecorder
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.ros.peers import node_graph
from barc_sim.runs.options import page_of, recording
from barc_sim.vehicle.bike_model import bikeFE

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Iterator, Mapping
    from types import TracebackType

    from rclpy.executors import Executor
    from rclpy.node import Node
    from typing_extensions import Self

    from barc_sim.cli.process import StopSignals
    from barc_sim.nodes.mirror import Facts
    from barc_sim.nodes.view import ViewNode
    from barc_sim.runs.inputs import Inputs
    from barc_sim.runs.terminal import Display

#: [s] after which a thread that runs Python code gives way to the thread that steps the simulator;
#: the default, 5 ms, is a quarter of a step. Lock-step keeps the default: it has no deadlines, and
#: the recorder is faster with fewer interruptions.
_SWITCH_INTERVAL = 1e-4
#: [s] for mirrors and pages to read the last states.
_READING_TIMEOUT = 2.0
#: Options of a run that the command on the page repeats.
_COPIED = ('lab', 'model', 'controller', 'lane', 'policy', 'dynamics')
_ENGINES = {'ros': 'ROS 2 (rclpy)', 'local': 'local, without ROS'}


@contextmanager
def engine(options: Namespace) -> Iterator[Callable[[], Any]]:
    """Initialise rclpy, or `ros/local` in its place; give a function that makes an executor.

    UserError: the arguments after `--ros-args` cannot be used.
    """
    arguments = ['--ros-args', '--log-level', 'warn'] if options.quiet else []
    arguments += options.ros_args
    if options.engine == 'ros':
        from barc_sim.ros.executor import QuickExecutor  # noqa: PLC0415 (needs ROS's rclpy)
        from barc_sim.ros.process import NUM_THREADS, ros  # noqa: PLC0415

        with ros(arguments, network=options.network):
            yield partial(QuickExecutor, num_threads=NUM_THREADS)
        return
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise UserError(f'ROS cannot start with its arguments: {error}') from None
    try:
        yield MultiThreadedExecutor
    except InvalidTopicNameException as error:  # ROS refuses it before the first node
        raise UserError(str(error)) from None
    finally:
        rclpy.try_shutdown()


class Run:
    """The nodes of a run, its bag and its exit code; the exit of `with` ends the nodes in order.

    A UserError before the first state deletes the bag, and is raised again. A later one, or any
    error of user code, ends the run as its `failure`, which is stored in the bag, too.
    """

    def __init__(self, options: Namespace, inputs: Inputs, stop: StopSignals) -> None:
        """Make the recorder, unless there is no bag: it records the other nodes from their start.

        UserError: the bag cannot be made.
        """
        self.options, self.inputs, self._stop = options, inputs, stop
        self.nodes: list[Any] = []  #: the recorder is the first
        self.simulators: list[VehicleSimulator] = []
        self.finished = Future()  #: done when every simulator has finished
        self.failure: str | None = None
        self.recorder: BagRecorder | None = None
        self._display: Display | None = None
        self._views: list[ViewNode] = []
        self._readers: list[tuple[Any, VehicleSimulator]] = []
        if options.no_bag:
            return
        self._root_is_new = not options.bag_dir.exists()
        self.recorder = BagRecorder(
            options.bag_dir,
            recording(options),
            metadata=inputs.user_code.describe()
            | ({'engine': _ENGINES['local']} if options.engine == 'local' else {}),
        )
        self.recorder.attach(inputs.user_code.attachments())
        self.recorder.finished.add_done_callback(lambda _: self.finish())
        self.nodes.append(self.recorder)

    def add(
        self,
        kind: Callable[..., Any],
        parameters: Mapping[str, Any] | None = None,
        *,
        namespace: str = '',
        reads: VehicleSimulator | None = None,
        **options: Any,  # noqa: ANN401 (the node's)
    ) -> Any:  # noqa: ANN401 (of `kind`)
        """Add and return a node; a parameter that is None keeps the node's default.

        The topics in `kind.inputs` are recorded from the node's start, other topics once they are
        discovered. If the node `reads` a simulator, the run waits at its end until the node's
        `latest`, the stamp of its newest state, is the stamp of the simulator's last state.

        UserError: a parameter is out of range, a topic is in use, or a remapping moves every car.
        """
        if self.recorder:
            # A publisher may wait for the node's subscription, send one message, and end.
            prefix = namespace and f'{namespace.rstrip("/")}/'
            inputs = getattr(kind, 'inputs', {})
            self.recorder.expect({prefix + name: each for name, each in inputs.items()})
        overrides = [Parameter(k, value=v) for k, v in (parameters or {}).items() if v is not None]
        node = kind(namespace=namespace, parameter_overrides=overrides, **options)
        self.nodes.append(node)
        if namespace and (remapped := node.get_namespace()) != f'/{namespace.strip("/")}':
            raise UserError(
                f'the namespace {remapped} would hold for every car: leave it out, as --cars gives '
                'each car a namespace of its own'
            )
        if reads:
            self._readers.append((node, reads))
        return node

    def add_simulator(self, parameters: Mapping[str, Any], **options: Any) -> VehicleSimulator:  # noqa: ANN401
        """Add and return a simulator, as `add` does, with the options that both runs have."""
        names = ('realtime_factor', 'seed', 'integrator', 'dynamics', 'clock')
        parameters = {name: getattr(self.options, name) for name in names} | {**parameters}
        model = self.inputs.user_code.model or bikeFE
        simulator: VehicleSimulator = self.add(VehicleSimulator, parameters, model=model, **options)
        self.simulators.append(simulator)
        simulator.finished.add_done_callback(lambda _: self._on_finished())
        return simulator

    def _on_finished(self) -> None:
        if all(each.finished.done() for each in self.simulators) and not self.finished.done():
            self.finished.set_result(None)

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

    def prepare(self, display: Display | None) -> None:
        """Add mirrors and pages, describe the run in the bag, and end it at a stop signal.

        Call it after all other nodes were added; `display` is closed at the end.
        """
        options = self.options
        self._display = display
        self._print(f'engine     {_ENGINES[options.engine]}')
        if self.recorder and any(each.clock_pub for each in self.simulators):
            self.recorder.stamp_with_clock()
        if options.mirrors:
            self._add_mirrors()
        if page_of(options) != 'none':
            for number in range(len(self.simulators)):
                self._serve(number)
        # A relay that is a program has its own parameters.
        if options.ros_args and not getattr(self.inputs.user_code.relay, 'ros', ''):
            _warn_of_unused(options.ros_args, self.nodes)
        if self.recorder:
            self.recorder.discover()
            self.recorder.announce()
            self.recorder.add_metadata(_description(options.argv, self.nodes))
            self._record_graph(self.recorder)
            if track := self.simulators[0].track:
                self.recorder.attach(track_file(track))
        # A full garbage collection takes half a step: exclude objects that live as long as the run.
        gc.collect()
        gc.freeze()
        if any(each.values['realtime_factor'] for each in self.simulators):
            sys.setswitchinterval(_SWITCH_INTERVAL)
        self._stop.then(self.finish)

    def _record_graph(self, recorder: BagRecorder) -> None:
        recorder.add_metadata({'graph': node_graph(recorder).to_json()})

    def _add_mirrors(self) -> None:
        from barc_sim.nodes.mirror import MirrorNode  # noqa: PLC0415 (only if wanted)

        for simulator in self.simulators:
            self.add(
                MirrorNode,
                {'road': simulator.values['road']},
                namespace=simulator.get_namespace(),
                reads=simulator,
                road=simulator.road,
                track=simulator.track,
                facts=partial(_facts, simulator, self.recorder),
            )

    def _serve(self, number: int) -> None:
        """Serve the live page of a car."""
        from barc_sim.nodes.view import ViewNode  # noqa: PLC0415 (a server, only if wanted)
        from barc_sim.page.protocol import RunFacts, Status  # noqa: PLC0415

        options, simulator = self.options, self.simulators[number]
        namespace, stepper = simulator.get_namespace(), simulator.stepper
        controllers = [each for each in self.nodes if isinstance(each, CruiseController)]
        view = self.add(
            ViewNode,
            namespace=namespace,
            reads=simulator,
            mode=options.mode,
            host=options.view_host,
            port=options.view_port and options.view_port + number,
            run=RunFacts(
                lambda: simulator.values,
                next((c.control for c in controllers if c.get_namespace() == namespace), None),
                simulator.road,
                simulator.track,
                lambda: Status(stepper.missed, stepper.paused),
                self.finish,
                {name: str(value) for name in _COPIED if (value := getattr(options, name, None))},
            ),
        )
        self._views.append(view)
        self._print(f'live page  {view.url}')
        if page_of(options) == 'web':
            view.page.open_browser()

    def _print(self, text: str) -> None:
        if not self.options.quiet:
            print(text, flush=True)  # noqa: T201

    def fail(self, failure: str) -> None:
        """Store the error that ended the run, also in the bag."""
        self.failure = failure
        if self.recorder:
            self.recorder.add_metadata({'failure': failure})

    def __enter__(self) -> Self:
        """Begin."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> bool:
        """End the nodes, the recorder last."""
        if self._display:
            self._display.close()
        has_begun = any(each.stepper.states for each in self.simulators)
        keeps_bag = error is None or has_begun or isinstance(error, UserCodeError)
        is_failure = isinstance(error, (UserError, UserCodeError)) and keeps_bag
        if is_failure:
            self.fail(str(error))
        if self.recorder and keeps_bag:
            self.recorder.add_metadata(
                {
                    'steps': str(sum(each.stepper.states for each in self.simulators)),
                    'missed_deadlines': str(self.missed),
                    'slipped_periods': str(self.slipped),
                }
            )
            self._record_graph(self.recorder)
        bag = str(self.recorder.path) if self.recorder else ''
        for view in self._views:
            view.page.end('The run has ended.', bag)
        while self.nodes:
            self.nodes.pop().destroy_node()
        if self.recorder and not keeps_bag:
            shutil.rmtree(self.recorder.path)
            if self._root_is_new:
                with suppress(OSError):  # another run has its bag there
                    self.recorder.path.parent.rmdir()
        return is_failure

    def end(self, print_result: Callable[[], None]) -> int:
        """Print the results, and return the exit code.

        The code is 1 if user code or the recorder failed, or an error ended the run.
        """
        recorder = self.recorder
        if not self.options.quiet:
            print_result()
            if recorder:
                _print_commands(recorder)
        elif recorder:
            print(recorder.path)  # noqa: T201
        if self.failure:
            report(f'barc {self.options.mode}', self.failure)
        return 1 if self.failure or (recorder and recorder.failure) else 0

    @property
    def late(self) -> str:
        """The counts of missed deadlines and clock slips, to print."""
        return f'missed deadlines {self.missed}, clock slips {self.slipped}'

    @property
    def missed(self) -> int:
        """Commands that missed their deadline, of all cars."""
        return sum(each.stepper.missed for each in self.simulators)

    @property
    def slipped(self) -> int:
        """Periods by which simulated time has fallen behind the wall clock, of all cars."""
        return sum(each.stepper.slipped for each in self.simulators)


def _warn_of_unused(ros_args: list[str], nodes: list[Node]) -> None:
    """Warn of each parameter after `--ros-args` that no node has; ROS ignores it."""
    from barc_sim.ros.local.parameters import Arguments  # noqa: PLC0415 (of few runs)

    by_name = [(each.get_fully_qualified_name()[1:], each) for each in nodes]
    for option, text in pairwise(ros_args):
        source, rules = text if option == '--params-file' else '-p', []
        with suppress(RuntimeError):  # the two words are no option with its value
            rules = Arguments(['--ros-args', option, text]).parameters
        for node, name, _ in rules:
            owner = node.lstrip('/')
            named = [(full, each) for full, each in by_name if owner in ('', full, each.get_name())]
            is_set = any(each.has_parameter(name) for full, each in named if owner in ('', full))
            if not is_set and (named or source == '-p'):  # a file can have other systems' nodes
                warn(
                    f'{source} {owner}{":" * bool(owner)}{name} sets nothing, as no node has this '
                    'parameter; in a namespace, leave out the node after -p, and in a file name it '
                    'in full'
                )


def _facts(simulator: VehicleSimulator, recorder: BagRecorder | None) -> Facts:
    """Return the facts about a simulator and the bag that no topic carries."""
    from barc_sim.nodes.mirror import Facts  # noqa: PLC0415 (only if wanted)

    stepper, in_real_time = simulator.stepper, simulator.values['realtime_factor'] == 1.0
    lag = stepper.stamp_lag if in_real_time else None
    facts = Facts(stepper.missed, stepper.slipped, stamp_lag=lag)
    if not recorder:
        return facts
    lost = recorder.missing.total
    recorded, failure = sum(recorder.counts.values()), recorder.failure
    return facts._replace(recorded=recorded, lost=lost, failure=failure)


def _description(argv: list[str], nodes: list[Node]) -> dict[str, str]:
    """Return the metadata of a run, with its parameters as `ros2 param load` reads them."""
    parameters: dict[str, Any] = {}
    first_car: dict[str, Any] = {}
    for node in nodes:
        declared = node.get_parameters(node.list_parameters(prefixes=[], depth=0).names)
        name = node.get_fully_qualified_name()
        parameters[name] = {'ros__parameters': {each.name: each.value for each in declared}}
        # By class, not by name: `-r __node:=car` gives all nodes one name.
        if isinstance(node, CruiseController):
            acting = () if node.lane and node.lane.plans_speed else GAINS
            gains = {name: node.values[name] for name in acting if name in node.values}
            first_car = gains | first_car
            if node.lane and node.has_parameter('lane_type'):
                first_car.setdefault('lane', node.get_parameter('lane_type').value)
        elif isinstance(node, VehicleSimulator):
            first_car.setdefault('road', node.values['road'])
            if node.track:
                first_car.setdefault('track', node.track.name)
    return {
        'command': shlex.join(['barc', *argv]),
        'barc_sim': __version__,
        'python': python_version(),
        'platform': platform(),
        'parameters': yaml.safe_dump(parameters, sort_keys=False),
        **{name: str(value) for name, value in first_car.items()},
    }


def _print_commands(recorder: BagRecorder) -> None:
    """Print the bag's path, and the commands that read it."""
    barc, path = barc_path(), shlex.quote(str(recorder.path))
    print(recorder.summary)  # noqa: T201
    print(f'bag     {path}')  # noqa: T201
    print(f'plot    {barc} plot {path}')  # noqa: T201
    print(f'replay  {barc} replay {path}')  # noqa: T201
