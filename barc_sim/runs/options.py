"""The options of both runs, `acc` and `teleop`, and of other commands that show a page."""

from __future__ import annotations

import argparse
import sys
from argparse import ArgumentTypeError
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import MAX_PORT, number, whole
from barc_sim.cli.process import is_at_desktop
from barc_sim.lab.files import FILES
from barc_sim.runs.recording_options import add_recording_options
from barc_sim.simulation.stepper import REALTIME_FACTORS, StepperOptions
from barc_sim.vehicle.bicycles import DYNAMICS, INTEGRATORS
from barc_sim.vehicle.parameters import ROWS

if TYPE_CHECKING:
    from collections.abc import Sequence

#: The options that `--help` shows; `--help-all` shows the others, too.
USUAL = ('--road', '--realtime-factor', '--lab', '--view', '--no-bag', '--quiet')


def add_arguments(parser: argparse.ArgumentParser, *parts: str, road: str, view: str) -> None:
    """Add the options of a run; `road` is the default of `--road`.

    A user's files can replace the `parts`, names in `FILES`. `view` is the meaning of
    `--view auto`: `web`, or `offer`, a page that does not open itself.
    """
    _add_pace(parser, road)
    _add_files(parser, parts)
    _add_view(parser, view)
    _add_bag(parser)
    _add_model(parser)
    _add_messages(parser)
    add_recording_options(parser)
    parser.set_defaults(parts=parts)


def _add_pace(parser: argparse.ArgumentParser, road: str) -> None:
    """Add the road and the pace."""
    parser.add_argument(
        '--road',
        metavar='ROAD',
        help=f'lab, flat, or a CSV file: start_m,grade_deg ({road})',
    )
    parser.add_argument(
        '--realtime-factor',
        type=_factor,
        metavar='FACTOR',
        help='simulated seconds per second; max: at full speed '
        f'({StepperOptions().realtime_factor:g})',
    )


def _add_files(parser: argparse.ArgumentParser, parts: Sequence[str]) -> None:
    """Add the user's files."""
    parser.add_argument(
        '--lab', type=Path, metavar='DIR', help="folder with a lab's files (see `barc new`)"
    )
    for part in parts:
        if part in ('lane', 'raceline', 'identify'):
            continue  # `--lane` takes names, too; the others come only with a lab

        parser.add_argument(
            f'--{part}',
            type=Path,
            metavar='FILE',
            help=f'use this file in place of {FILES[part]}',
        )


def _add_view(parser: argparse.ArgumentParser, view: str) -> None:
    """Add the live page."""
    parser.set_defaults(view_auto=view)
    auto = 'at a desktop, the link to a page' if view == 'offer' else view
    parser.add_argument(
        '--view',
        choices=('auto', 'web', 'none'),
        default='auto',
        help=f'the live page (auto: {auto})',
    )
    add_address_options(parser)


def _add_bag(parser: argparse.ArgumentParser) -> None:
    """Add the folder of the bag, or none."""
    bag = parser.add_mutually_exclusive_group()
    bag.add_argument(
        '--bag-dir',
        type=Path,
        default=Path('bags'),
        metavar='DIR',
        help='folder for bags (bags)',
    )
    bag.add_argument('--no-bag', action='store_true', help='record nothing')


def _add_model(parser: argparse.ArgumentParser) -> None:
    """Add the noise, and how the car is stepped."""
    parser.add_argument(
        '--seed',
        type=whole(*ROWS['seed'].between),
        metavar='N',
        help=f'{ROWS["seed"].description} ({ROWS["seed"].default})',
    )

    parser.add_argument(
        '--integrator',
        choices=tuple(INTEGRATORS),
        help=f'method of each step ({ROWS["integrator"].default})',
    )
    parser.add_argument(
        '--dynamics', choices=tuple(DYNAMICS), help=f'bicycle model ({ROWS["dynamics"].default})'
    )


def _add_messages(parser: argparse.ArgumentParser) -> None:
    """Add what is printed, and how messages are carried and mirrored."""
    parser.add_argument('-q', '--quiet', action='store_true', help="print only the bag's path")

    parser.add_argument(
        '--network',
        action='store_true',
        help='let other machines see the run: sets ROS_AUTOMATIC_DISCOVERY_RANGE to SUBNET',
    )
    parser.add_argument(
        '--clock',
        action='store_true',
        default=None,
        help='publish the simulated time on /clock even if the real-time factor is 1, for nodes '
        'with use_sim_time',
    )

    parser.add_argument(
        '--engine',
        choices=('auto', 'ros', 'local'),
        default='auto',
        help='carry messages over ROS 2, or without it in queues of one process (auto: ROS 2 if '
        'it is installed)',
    )

    parser.add_argument(
        '--mirrors',
        action='store_true',
        help='also publish standard messages for RViz, Foxglove and PlotJuggler: odometry, tf, '
        'path, markers, diagnostics',
    )


def _factor(text: str) -> float:
    """Return the real-time factor; 0.0 stands for `max`."""
    if text == 'max':
        return 0.0

    try:
        return number(*REALTIME_FACTORS)(text)
    except ArgumentTypeError as error:
        raise ArgumentTypeError(f"{error}, nor 'max'") from None


def add_address_options(parser: argparse.ArgumentParser, *, can: str = 'drive') -> None:
    """Add `--view-port` and `--view-host`; `can` is what a page's visitor can do."""
    parser.add_argument(
        '--view-port',
        type=whole(0, MAX_PORT),
        default=0,
        metavar='PORT',
        help='port of the page (any that is free)',
    )

    parser.add_argument(
        '--view-host',
        default='127.0.0.1',
        metavar='ADDRESS',
        help='address of the page; 0.0.0.0 for a phone in the same network; '
        f'anyone with the link can {can} (127.0.0.1)',
    )


def page_of(options: argparse.Namespace) -> str:
    """Return the live page of a run: `web` if it opens itself, `offer` for its link, or `none`."""
    page = options.view_auto if options.view == 'auto' else options.view
    has_viewer = sys.stdout.isatty() and is_at_desktop() and options.realtime_factor != 0.0
    if page == 'offer' and (options.quiet or not has_viewer):
        return 'none'
    return str(page)
