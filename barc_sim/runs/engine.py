"""The engine of a run: what carries its messages, ROS or calls.

An engine makes the nodes of a run, carries their messages, and ends them. Its recorder comes first,
a simulator after what commands it, and a keyboard last. Both engines have the same methods. What
makes a node raises UserError for a parameter that is out of range.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.cli.process import has_ros, needs_ros

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace

    from barc_sim.runs.local.engine import LocalEngine
    from barc_sim.runs.ros_engine import RosEngine

    Engine = LocalEngine | RosEngine

#: The options of a run that need ROS, and the value with which each does not.
_ROS_OPTIONS = {
    'cars': 1,
    'no_controller': False,
    'no_relay': False,
    'foxglove': None,
    'mirrors': None,
    'network': False,
}


def add_engine_option(parser: ArgumentParser) -> None:
    """Add `--engine`."""
    parser.add_argument(
        '--engine',
        choices=('auto', 'ros', 'local'),
        default='auto',
        help='what carries the messages: ROS 2, or calls without it (auto: ROS 2 where it is '
        'installed)',
    )


def uses_ros(options: Namespace) -> bool:
    """Return whether ROS carries the messages of a run.

    Raises
    ------
    UserError
        if an option needs ROS, and there is none, or it is not to be used.

    Examples
    --------
    >>> from argparse import ArgumentParser
    >>> parser = ArgumentParser()
    >>> add_engine_option(parser)
    >>> uses_ros(parser.parse_args(['--engine', 'local']))
    False
    """
    ros = has_ros() if options.engine == 'auto' else options.engine == 'ros'
    if ros and not has_ros():
        raise needs_ros('--engine ros')
    for name, without in _ROS_OPTIONS.items():
        if not ros and getattr(options, name, without) != without:
            raise needs_ros(f'--{name.replace("_", "-")}')
    return ros
