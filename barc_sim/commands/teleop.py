"""Drives by hand until q or Ctrl-C."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.cli.parser import accept_ros_args
from barc_sim.cli.signals import StopSignals
from barc_sim.control.relay import INPUTS, PEDAL
from barc_sim.runs import options as run_options
from barc_sim.runs.carrier import choose_carrier

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Simulator, relay, keyboard and recorder, until q or Ctrl-C.'
    parser.set_defaults(mode='teleop')
    parser.add_argument(
        '--input',
        choices=tuple(INPUTS),
        help='what a Twist on cmd_vel means: shares of the limits (pedal), or m/s and rad/s as in '
        f'REP-103, for Nav2 and teleop_twist_keyboard (velocity) ({PEDAL})',
    )
    parser.add_argument(
        '--no-relay',
        action='store_true',
        help="start no relay of barc_sim's, and wait for another that publishes ecu",
    )
    run_options.add_arguments(parser, 'model', 'relay', road='flat', view='web')
    accept_ros_args(parser)


def run(options: Namespace) -> int:
    """Drive, and return the exit code.

    Raises
    ------
    UserError
        where an option or a ROS argument cannot be used.
    """
    with StopSignals() as stop:
        choose_carrier(options)
        from barc_sim.runs.teleop import teleop  # noqa: PLC0415

        return teleop(options, stop)
