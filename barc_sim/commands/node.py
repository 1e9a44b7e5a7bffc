"""Runs one node alone in this process."""

from __future__ import annotations

from argparse import REMAINDER
from importlib import import_module
from typing import TYPE_CHECKING

from barc_sim.cli.parser import ROS_ARGS
from barc_sim.cli.process import call
from barc_sim.commands import NODES
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Run one node alone in this process, until Ctrl-C.'
    parser.add_argument('name', choices=NODES, metavar='NAME', help=', '.join(NODES))
    parser.add_argument(
        'arguments', nargs=REMAINDER, metavar='...', help='of ROS, such as --ros-args -p kp:=20.0'
    )


def run(options: Namespace) -> int:
    """Run the node, and return the exit code.

    Raises
    ------
    UserError
        where an argument is not ROS's.
    """
    if options.arguments and options.arguments[0] != ROS_ARGS:
        raise UserError(
            f'a node takes no {options.arguments[0]!r}: give its parameters to ROS, as in '
            f'{ROS_ARGS} -p kp:=20.0'
        )
    module, create = NODES[options.name]
    node = getattr(import_module(f'barc_sim.nodes.{module}'), create)
    from barc_sim.ros.process import spin  # noqa: PLC0415 (slow: not for --help)

    return call(options.name, lambda: spin(node, options.arguments))
