"""Chooses the engine of a run, ROS 2 or `ros/local` in its place, and starts it.

It is chosen once, before rclpy is imported, so that the nodes import either ROS's rclpy or what
stands in for it under the same name. The run and its recorder are given its `Carrier`.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from barc_sim.cli.process import has_only_rclpy, has_ros, needs_ros, require_ros
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator

    from barc_sim.ros.carrier import Carrier

ROS = 'ros'
LOCAL = 'local'
#: The options of a run that need ROS, each with the value that does not.
_ROS_OPTIONS = {'no_controller': False, 'no_relay': False, 'network': False}


def choose_and_install_engine(options: Namespace) -> str:
    """Return the engine of a run, `ros` or `local`.

    `local` is also installed: from now on `import rclpy`, and our messages, import the stand-ins of
    `ros/local`, which are put into `sys.modules`.

    UserError: an option needs ROS, and ROS is not installed or not chosen.
    """
    if options.engine == 'auto':
        if has_only_rclpy():
            raise UserError(f'{needs_ros("a run in ROS 2")}; or drive without ROS (--engine local)')
        engine = ROS if has_ros() else LOCAL
    else:
        engine = options.engine

    if engine == ROS:
        require_ros('--engine ros')
        return ROS

    for name, without in _ROS_OPTIONS.items():
        if getattr(options, name, without) != without:
            raise needs_ros(f'--{name.replace("_", "-")}')

    from barc_sim.ros.local import install  # noqa: PLC0415 (not beside rclpy)

    install()
    return LOCAL


@contextmanager
def start_engine(options: Namespace) -> Iterator[Carrier]:
    """Start the chosen engine, and give its carrier.

    UserError: the arguments after `--ros-args` cannot be used.
    """
    from barc_sim.ros.carrier import DdsCarrier, LocalCarrier  # noqa: PLC0415 (imports rclpy)

    carrier = DdsCarrier() if options.engine == ROS else LocalCarrier()
    arguments = ['--ros-args', '--log-level', 'warn'] if options.quiet else []
    with carrier.start([*arguments, *options.ros_args], network=options.network):
        yield carrier
