"""Conducts a run from its command line to its exit code."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from barc_sim.bags.recording import check_root
from barc_sim.cli.process import check_clock, report
from barc_sim.errors import UserError
from barc_sim.lab.user_code.loading import UserCode, find_files, load_files
from barc_sim.lab.user_code.source import UserCodeError
from barc_sim.runs.composition import Setup
from barc_sim.runs.engine import uses_ros
from barc_sim.runs.terminal.user_output import UserOutput
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Iterator

    from barc_sim.cli.signals import StopSignals
    from barc_sim.runs.composition import Run
    from barc_sim.runs.engine import Engine


def conduct(create: Callable[[Setup], Run], options: Namespace, stop: StopSignals) -> int:
    """Spin the run that `create` returns until it ends or `stop` is requested.

    Returns
    -------
    int
        The exit code: 1 if user code or the recorder failed, or an error ended the run after its
        first state. The bag then holds what was recorded.

    Raises
    ------
    UserError
        if an option, a user's file or a ROS argument cannot be used; no bag is left then.
    """
    ros = uses_ros(options)
    check_clock()
    road = Road.named(options.road) if options.road else None
    if not options.no_bag:
        check_root(options.bag_dir)
    output = UserOutput(quiet=options.quiet)
    user_code = _load_user_code(options, output)
    quiet = ['--ros-args', '--log-level', 'warn'] if options.quiet else []
    if stop.requested.is_set():  # during the imports
        return 0
    page = None
    with _engine(options, [*quiet, *options.ros_args], ros=ros) as engine:
        run = create(Setup(options, road, user_code, output, engine))
        try:
            run.spin(stop)
            page = run.close(keep_page=not stop.requested.is_set())
        except (UserError, UserCodeError) as error:
            if not (run.has_begun or isinstance(error, UserCodeError)):
                run.discard()
                raise
            run.fail(str(error))
        finally:
            run.close()
    run.print_end()
    if page:
        from barc_sim.runs.ended_run import serve_ended_run  # noqa: PLC0415 (slow)

        serve_ended_run(page, run, stop)
    if run.failure:
        report(f'barc {options.mode}', run.failure)
    return 1 if run.failure or (run.bag and run.bag.recorder.failure) else 0


@contextmanager
def _engine(options: Namespace, ros_args: list[str], *, ros: bool) -> Iterator[Engine]:
    """Give the engine that carries the messages; only its modules are imported."""
    if not ros:
        from barc_sim.runs.local.engine import LocalEngine  # noqa: PLC0415

        yield LocalEngine(ros_args)
        return
    from barc_sim.ros.process import ros as started  # noqa: PLC0415
    from barc_sim.runs.ros_engine import RosEngine  # noqa: PLC0415

    with started(ros_args, network=options.network):
        yield RosEngine()


def _load_user_code(options: Namespace, output: UserOutput) -> UserCode:
    """Load the user's files that the command line names."""
    files = find_files(options.lab, options.parts) if options.lab else {}
    named = {part: getattr(options, part) for part in options.parts}
    return load_files(files | {part: file for part, file in named.items() if file}, output=output)
