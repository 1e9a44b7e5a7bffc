"""The nodes of a run in one process and one executor, from its start to its bag."""

from __future__ import annotations

import gc
import shlex
import shutil
import sys
from abc import ABC, abstractmethod
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.parameter import Parameter
from rclpy.task import Future

from barc_sim.bags.directory import check_root
from barc_sim.bags.losses import summary
from barc_sim.cli.parser import report
from barc_sim.errors import UserError
from barc_sim.lab.user_code.adapters import attachments
from barc_sim.lab.user_code.adapters import describe as user_code_metadata
from barc_sim.lab.user_code.loading import UserCodeError, find_files, load_files
from barc_sim.nodes.recorder.node import BagRecorder
from barc_sim.page.desktop import open_page
from barc_sim.page.protocol import Status
from barc_sim.ros.executor.executor import QuickExecutor
from barc_sim.ros.graph_observer import observe
from barc_sim.ros.process import NUM_THREADS, ros
from barc_sim.runs.metadata import describe
from barc_sim.runs.mirror_nodes import mirrors
from barc_sim.runs.recording_options import recording
from barc_sim.runs.terminal.printed import Printed
from barc_sim.runs.view_options import wants_page
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Iterator, Sequence

    from rclpy.executors import Executor
    from rclpy.node import Node

    from barc_sim.cli.signals import StopSignals
    from barc_sim.lab.user_code.loading import UserCode
    from barc_sim.nodes.simulator.node import VehicleSimulator
    from barc_sim.nodes.view.node import ViewNode

#: [s] A thread that runs Python code gives way to the one that steps the simulator after this
#: long; the default, 5 ms, is a quarter of a step.
_SWITCH_INTERVAL = 1e-4


def conduct(
    create: Callable[[UserCode, Printed], Run],
    options: Namespace,
    ros_args: list[str],
    stop: StopSignals,
) -> int:
    """Do the run that `create` returns until it ends or `stop` is requested; return the exit code.

    Raises
    ------
    UserError
        where an option, a user's file or a ROS argument can't be used; nothing is left behind
        then. What user code does wrong later ends the run, with all up to there in the bag.
    """
    if options.road:
        Road.named(options.road)
    if not options.no_bag:
        check_root(options.bag_dir)
    printed = Printed(quiet=options.quiet)
    user_code = load_user_code(options, printed)
    if options.quiet:
        ros_args = ['--ros-args', '--log-level', 'warn', *ros_args]
    if stop.requested.is_set():  # while all that was imported
        return 0
    with ros(ros_args, network=options.network):
        run = create(user_code, printed)
        try:
            run.spin(stop, QuickExecutor(num_threads=NUM_THREADS))
        except UserCodeError as error:
            run.fail(str(error))
        except UserError:  # nothing was driven
            run.discard()
            raise
        finally:
            run.close()
    if not options.quiet:
        run.print_result()
        run.print_bag()
    elif run.recorder:
        print(run.recorder.path)  # noqa: T201
    if run.failure:
        report('barc_sim.run', run.failure)
    return 1 if run.failure or (run.recorder and run.recorder.failure) else 0


def load_user_code(options: Namespace, printed: Printed) -> UserCode:
    """Load the user's files that the command line names.

    Raises
    ------
    UserCodeError
        where one of them can't be used.
    """
    files = find_files(options.lab, options.parts) if options.lab else {}
    named = {part: getattr(options, part) for part in options.parts}
    return load_files(files | {part: file for part, file in named.items() if file}, output=printed)


class Run(ABC):
    """A recorder, and of each car a simulator and the nodes that drive it, composed."""

    def __init__(
        self, options: Namespace, argv: list[str], user_code: UserCode, printed: Printed
    ) -> None:
        """Make the nodes, the recorder first: it is to hear what the others say at their start.

        `user_code` has user code, and `printed` takes what that prints.

        Raises
        ------
        UserError
            where a parameter or the topic can't be had; nothing is left behind then.
        """
        self._root_is_new = not options.bag_dir.exists()
        self.user_code = user_code
        self.failure: str | None = None  #: what user code did wrong
        self._printed = printed
        self.recorder = None if options.no_bag else self._record(options)
        self._nodes: list[Node] = [self.recorder] if self.recorder else []
        self._views: list[ViewNode] = []
        try:
            self.simulators = self.compose(options)
            if self.recorder:
                self.recorder.use_sim_time = any(each.keeps_clock for each in self.simulators)
            for node in mirrors(options, self.simulators, self.recorder):
                self.add(node)
            if wants_page(options):
                self._views = [self.add(view) for view in self._serve(options)]
        except BaseException:
            self.discard()
            raise
        if self.recorder:
            self.recorder.add_metadata(describe(argv, self._nodes))
            self.recorder.discover()
            self._keep_graph(self.recorder)

    def _record(self, options: Namespace) -> BagRecorder:
        return BagRecorder(
            options.bag_dir,
            recording(options),
            metadata=user_code_metadata(self.user_code),
            attachments=attachments(self.user_code),
        )

    @abstractmethod
    def compose(self, options: Namespace) -> Sequence[VehicleSimulator]:
        """Make the nodes with `add`, and return the simulators: one of each car."""

    @abstractmethod
    def close_display(self) -> None:
        """Leave the terminal's line in order."""

    @abstractmethod
    def print_result(self) -> None:
        """Print how it went."""

    def _serve(self, options: Namespace) -> Iterator[ViewNode]:
        from barc_sim.nodes.view.node import ViewNode  # noqa: PLC0415 (a server, where it is wanted)

        for number, simulator in enumerate(self.simulators):
            view = ViewNode(
                options.mode,
                host=options.view_host,
                port=options.view_port and options.view_port + number,
                status=partial(_status, simulator),
                namespace=simulator.get_namespace(),
            )
            if not options.quiet:
                print(f'live page  {view.url}', flush=True)  # noqa: T201
            open_page(view.url)
            yield view

    def add(self, node: Any) -> Any:  # noqa: ANN401 (as it came)
        """Have `node` spun and, at the end, destroyed; return it."""
        self._nodes.append(node)
        return node

    def spin(self, stop: StopSignals, executor: Executor) -> None:
        """Drive until the run is finished or `stop` is requested."""
        for node in self._nodes:
            executor.add_node(node)
        # A full garbage collection takes as long as half a step: spare it what is there for good.
        gc.collect()
        gc.freeze()
        sys.setswitchinterval(_SWITCH_INTERVAL)
        stop.then(self.finish)
        if self.recorder:
            self.recorder.finished.add_done_callback(lambda _: self.finish())
        try:
            executor.spin_until_future_complete(self._finished())
        finally:
            executor.shutdown()
            self._printed.close()
            self.close_display()

    def _finished(self) -> Future:
        """Return what is done when every car is where its run ends."""
        finished = Future()

        def note(_: Future) -> None:
            if all(simulator.finished.done() for simulator in self.simulators):
                finished.set_result(None)

        for simulator in self.simulators:
            simulator.finished.add_done_callback(note)
        return finished

    def finish(self) -> None:
        """End the run now; may be called from any thread."""
        for simulator in self.simulators:
            simulator.finish()

    def fail(self, failure: str) -> None:
        """Take note of what user code did wrong."""
        self.failure = failure
        if self.recorder:
            self.recorder.add_metadata({'failure': failure})

    @property
    def missed(self) -> int:
        """Commands that were not there when they were due."""
        return sum(simulator.missed for simulator in self.simulators)

    @property
    def slipped(self) -> int:
        """Periods by which simulated time has fallen behind the wall clock."""
        return sum(simulator.slipped for simulator in self.simulators)

    def close(self) -> None:
        """End the nodes, the recorder last, with the results in its bag; again, do nothing."""
        if self.recorder and self._nodes:
            results = {
                'steps': sum(simulator.steps for simulator in self.simulators),
                'missed_deadlines': self.missed,
                'slipped_periods': self.slipped,
            }
            self.recorder.add_metadata({name: str(value) for name, value in results.items()})
            self._keep_graph(self.recorder)
        for view in self._views if self._nodes else ():
            view.end('The run has ended.')
        self._destroy()

    def discard(self) -> None:
        """End the nodes, and leave nothing of the bag."""
        self._destroy()
        if self.recorder:
            shutil.rmtree(self.recorder.path)
            if self._root_is_new:
                self.recorder.path.parent.rmdir()

    @staticmethod
    def _keep_graph(recorder: BagRecorder) -> None:
        recorder.add_metadata({'graph': observe(recorder).to_json()})

    def _destroy(self) -> None:
        while self._nodes:
            self._nodes.pop().destroy_node()

    def print_bag(self) -> None:
        """Print the bag's path, and what to do with it."""
        if self.recorder:
            python = shlex.quote(_short(sys.executable))
            print(summary(self.recorder.counts, self.recorder.lost))  # noqa: T201
            path = shlex.quote(str(self.recorder.path))
            print(f'bag     {path}')  # noqa: T201
            print(f'plot    {python} -m barc_sim plot {path}')  # noqa: T201
            print(f'replay  {python} -m barc_sim replay {path}')  # noqa: T201


def _status(simulator: VehicleSimulator) -> Status:
    return Status(simulator.missed, simulator.slipped, simulator.paused)


def _short(path: str) -> str:
    """Return `path` relative to the current directory where it lies below it."""
    with suppress(ValueError):
        return str(Path(path).relative_to(Path.cwd()))
    return path


def overrides(**values: float | str | None) -> list[Parameter]:
    """Return the parameters that the command line gave; those it left out are the nodes' own."""
    return [Parameter(name, value=value) for name, value in values.items() if value is not None]
