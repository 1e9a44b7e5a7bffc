"""Starts ROS in a process, spins a node, and ends in order."""

from __future__ import annotations

import os
import re
import resource
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.logging import LoggingSeverity, get_logger_level, set_logger_level
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from barc_sim.cli.process import check_clock, check_limits
from barc_sim.cli.signals import StopSignals
from barc_sim.errors import UserError
from barc_sim.ros.executor import QuickExecutor
from barc_sim.ros.fast_dds import sweep, use_profiles

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.node import Node

#: Threads for callbacks that may block; the quick ones need none.
NUM_THREADS = 2
#: rcutils' own format, on a cleared line: the status line of a run may stand there.
_CONSOLE_FORMAT = '\r\x1b[K[{severity}] [{time}] [{name}]: {message}'


@contextmanager
def ros(args: list[str] | None, *, network: bool = False) -> Iterator[None]:
    """Initialise ROS with `args`, visible on this machine only unless the environment differs.

    This process may open as many files as the system allows. With `network` it is visible in the
    whole subnet. Segments of dead processes are removed.

    Raises
    ------
    UserError
        The clock or a limit of the process is unfit for ROS, the arguments after `--ros-args` are
        not ROS's, or DDS security is requested and not available.
    """
    check_clock()
    check_limits()
    secure = os.environ.get('ROS_SECURITY_ENABLE') == 'true'
    keystore = Path(os.environ.get('ROS_SECURITY_KEYSTORE', ''))
    if secure and not (keystore / 'enclaves').is_dir():
        # Unless ROS_SECURITY_STRATEGY is Enforce, rcl would continue without security.
        raise UserError(
            f'ROS_SECURITY_ENABLE is true, but ROS_SECURITY_KEYSTORE, {str(keystore)!r}, is no '
            'keystore: set it to one made by `ros2 security create_keystore`, or unset both'
        )
    if not any(os.environ.get(name) for name in ('HOME', 'ROS_HOME', 'ROS_LOG_DIR')):
        raise UserError('ROS has no folder for its logs: set HOME, or ROS_LOG_DIR to a folder')
    if network:
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    use_profiles()
    sweep()
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))  # thirty cars need more than 1024
    if sys.stderr.isatty():
        os.environ.setdefault('RCUTILS_CONSOLE_OUTPUT_FORMAT', _CONSOLE_FORMAT)
    # rcl raises what it logs about its arguments.
    set_logger_level('rcl', LoggingSeverity.FATAL)
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # noqa: BLE001 (rclpy raises several private kinds)
        raise UserError(f'ROS cannot start with its arguments: {_reason(error)}') from None
    if get_logger_level('rcl') == LoggingSeverity.FATAL:
        set_logger_level('rcl', LoggingSeverity.UNSET)
    try:
        if secure:
            _check_security()
        yield
    finally:
        rclpy.try_shutdown()


def _check_security() -> None:
    """Create a DDS participant, so that an error of DDS security is one sentence."""
    options = {'enable_rosout': False, 'start_parameter_services': False}
    try:
        rclpy.create_node('_security', **options).destroy_node()
    except Exception as error:  # noqa: BLE001 (rclpy raises a private kind)
        raise UserError(
            f'ROS_SECURITY_ENABLE is true, and DDS security cannot be had: {_reason(error)} (the '
            'ROS 2 from PyPI has none: source a ROS 2 Jazzy that has, or unset it)'
        ) from None


def _reason(error: Exception) -> str:
    """Return rcl's error without the line of its source."""
    return re.sub(r',? at /\S+:\d+', '', str(error))


def spin(create: Callable[[], Node], args: list[str] | None = None) -> int:
    """Spin the node that `create` returns until it is `finished` or a signal stops it.

    Returns
    -------
    int
        The exit code: 1 if the node has a `failure`.
    """
    with StopSignals() as stop, ros(args):
        node: Any = create()
        executor = QuickExecutor(num_threads=NUM_THREADS)
        executor.add_node(node)
        done = getattr(node, 'finished', None) or Future()
        stop.then(lambda: done.set_result(None))
        try:
            executor.spin_until_future_complete(done)
        finally:
            executor.shutdown()
            node.destroy_node()
    return 1 if getattr(node, 'failure', None) else 0
