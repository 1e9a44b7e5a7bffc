"""Prints the definition of a message or service, as `ros2 interface show` does."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Print the definition of a message or service, as `ros2 interface show` does; it needs '
        'neither ROS nor a run.'
    )
    parser.add_argument(
        'type', metavar='TYPE', help='such as ECU, std_msgs/Header or barc_interfaces/msg/ECU'
    )


def run(options: Namespace) -> None:
    """Print the definition.

    Raises
    ------
    UserError
        where there is no such type, or there are several.
    """
    from barc_sim.bags import schemas  # noqa: PLC0415 (slow: not for --help)

    for line in schemas.definition_lines(schemas.find_type(options.type)):
        print(line)  # noqa: T201
