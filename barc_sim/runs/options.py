"""The options of both runs, `acc` and `teleop`."""

from __future__ import annotations

from argparse import ArgumentTypeError
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import number, whole
from barc_sim.lab.user_code.loading import FILES
from barc_sim.runs.engine import add_engine_option
from barc_sim.runs.recording_options import add_recording_options
from barc_sim.runs.view_options import add_mirror_options, add_view_options
from barc_sim.vehicle.parameters import REALTIME_FACTORS

if TYPE_CHECKING:
    import argparse

_MAX_SEED = 2**53


def add_arguments(parser: argparse.ArgumentParser, *parts: str, road: str, view: str) -> None:
    """Add the options of a run.

    Parameters
    ----------
    parser
        The parser of the run's command.
    parts
        What a user's own code can replace: `model`, `controller`, `relay`.
    road
        The road without `--road`.
    view
        What `--view auto` stands for: `web` or `none`.
    """
    parser.add_argument(
        '--road',
        metavar='ROAD',
        help=f"'lab', 'flat', or a CSV file with the columns start_m,grade_deg ({road})",
    )
    parser.add_argument(
        '--realtime-factor',
        type=_factor,
        metavar='FACTOR',
        help="simulated seconds per second, from 0.001; 'max', for acc: as fast as possible (1)",
    )
    _add_user_code(parser, *parts)
    add_view_options(parser, on=view == 'web')
    bag = parser.add_mutually_exclusive_group()
    bag.add_argument(
        '--bag-dir',
        type=Path,
        default=Path('bags'),
        metavar='DIR',
        help='where bags are kept (bags)',
    )
    bag.add_argument('--no-bag', action='store_true', help='record nothing')
    parser.add_argument(
        '--seed', type=whole(0, _MAX_SEED), metavar='N', help='seed of the measurement noise (0)'
    )
    parser.add_argument('--integrator', choices=('euler', 'rk4'), help='of each step (euler)')
    parser.add_argument('--dynamics', choices=('kinematic', 'dynamic'), help='bicycle (kinematic)')
    parser.add_argument(
        '-q', '--quiet', action='store_true', help="print the bag's path, and nothing else"
    )
    parser.add_argument(
        '--network',
        action='store_true',
        help='visible to other machines, too: sets ROS_AUTOMATIC_DISCOVERY_RANGE to SUBNET',
    )
    parser.add_argument(
        '--clock',
        action='store_true',
        default=None,
        help='publish the simulated time on /clock also where the real-time factor is 1, for nodes '
        'that use_sim_time',
    )
    add_engine_option(parser)
    add_mirror_options(parser)
    add_recording_options(parser)


def _add_user_code(parser: argparse.ArgumentParser, *parts: str) -> None:
    files = ' and '.join(FILES[part] for part in parts)
    parser.add_argument(
        '--lab',
        type=Path,
        metavar='DIR',
        help=f"use the {files} of this folder; missing files fall back to barc_sim's own",
    )
    for part in parts:
        parser.add_argument(
            f'--{part}',
            type=Path,
            metavar='FILE',
            help=f'use this file in place of {FILES[part]}',
        )
    parser.set_defaults(parts=parts)


def _factor(text: str) -> float:
    """Return the real-time factor; 0.0 stands for `max`."""
    if text == 'max':
        return 0.0
    try:
        return number(*REALTIME_FACTORS)(text)
    except ArgumentTypeError as error:
        raise ArgumentTypeError(f"{error}, nor 'max'") from None
