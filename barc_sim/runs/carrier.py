"""What carries the messages of a run, with the same nodes: ROS 2, or `ros/local` without it."""

from __future__ import annotations

from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from barc_sim.cli.process import check_clock, has_ros, needs_ros
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace
    from collections.abc import Callable, Iterator

#: The options of a run that need ROS, and the value with which each does not.
_ROS_OPTIONS = {
    'no_controller': False,
    'no_relay': False,
    'foxglove': None,
    'network': False,
}


def add_engine_option(parser: ArgumentParser) -> None:
    """Add `--engine`."""
    parser.add_argument(
        '--engine',
        choices=('auto', 'ros', 'local'),
        default='auto',
        help='what carries the messages: ROS 2, or queues in one process without it (auto: ROS 2 '
        'where it is installed)',
    )


def uses_ros(options: Namespace) -> bool:
    """Return whether ROS carries the messages of a run.

    Raises
    ------
    UserError
        if an option needs ROS, and there is none, or it is not to be used.
    """
    ros = has_ros() if options.engine == 'auto' else options.engine == 'ros'
    if ros and not has_ros():
        raise needs_ros('--engine ros')
    for name, without in _ROS_OPTIONS.items():
        if not ros and getattr(options, name, without) != without:
            raise needs_ros(f'--{name.replace("_", "-")}')
    return ros


def choose_carrier(options: Namespace) -> None:
    """Let `import rclpy` find what carries the messages; to be called before nodes are imported.

    Raises
    ------
    UserError
        as `uses_ros` does.
    """
    options.engine = 'ros' if uses_ros(options) else 'local'
    if options.engine == 'local':
        from barc_sim.ros.local import install  # noqa: PLC0415

        install()


@contextmanager
def carrier(options: Namespace) -> Iterator[Callable[[], Any]]:
    """Initialise rclpy with the options; give what makes a run's executor.

    Raises
    ------
    UserError
        The arguments after `--ros-args` cannot be used, or no message can hold the clock's time.
    """
    check_clock()
    quiet = ['--ros-args', '--log-level', 'warn'] if options.quiet else []
    arguments = [*quiet, *options.ros_args]
    if options.engine == 'ros':
        from barc_sim.ros.executor import QuickExecutor  # noqa: PLC0415 (of rclpy alone)
        from barc_sim.ros.process import NUM_THREADS, ros  # noqa: PLC0415

        with ros(arguments, network=options.network):
            yield partial(QuickExecutor, num_threads=NUM_THREADS)
        return
    import rclpy  # noqa: PLC0415 (what stands in for it)
    from rclpy.executors import MultiThreadedExecutor  # noqa: PLC0415
    from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415

    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise UserError(f'ROS cannot start with its arguments: {error}') from None
    try:
        yield MultiThreadedExecutor
    finally:
        rclpy.try_shutdown()
