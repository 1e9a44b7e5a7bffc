"""`play`: publishes the messages of a bag."""

from __future__ import annotations

import sys
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

from barc_sim.cli.parser import ROS_ARGS, accept_ros_args, add_bag, number
from barc_sim.errors import UserError
from barc_sim.runs.options import add_topic_choice

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser
    from barc_sim.nodes.player import BagPlayer

_RATES = (1e-3, 1e3)
_MAX_OFFSET = 1e9  #: [s]
_CLOCK_RATE = 40.0  #: [Hz] as in ros2 bag play


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Publish the messages of an MCAP bag of any recorder on their topics, with their quality '
        'of service and spacing, as `ros2 bag play` does.'
    )
    parser.epilog = 'Keys: space pauses and resumes, the right arrow steps one message, q ends.'
    add_bag(parser)
    parser.add_argument(
        '-r',
        '--rate',
        type=number(*_RATES),
        default=1.0,
        metavar='RATE',
        help='seconds of the bag per second (1)',
    )
    parser.add_argument(
        '-l', '--loop', action='store_true', help='begin again at the end, until Ctrl-C'
    )
    parser.add_argument(
        '--start-offset',
        type=number(0.0, _MAX_OFFSET),
        default=0.0,
        metavar='S',
        help='begin this long after the start of the bag',
    )
    parser.add_argument('-p', '--start-paused', action='store_true', help='begin paused')
    add_topic_choice(parser, 'play')
    parser.add_argument(
        '-m',
        '--remap',
        nargs='+',
        default=[],
        metavar='OLD:=NEW',
        help='publish a topic under another name, as in /ecu:=/car2/ecu',
    )
    parser.add_argument(
        '--clock',
        type=number(*_RATES),
        nargs='?',
        const=_CLOCK_RATE,
        metavar='HZ',
        help=f"publish the bag's time on /clock, in place of the bag's own ({_CLOCK_RATE:g})",
    )
    accept_ros_args(parser)


def run(options: Namespace) -> int:
    """Play the bag to its end or until a signal; return the exit code."""
    from barc_sim.bags.reader import newest  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.control.keyboard import Terminal  # noqa: PLC0415
    from barc_sim.nodes.player import BagPlayer, Playback  # noqa: PLC0415
    from barc_sim.ros.process import PLAYER_PROFILES, spin, use_profiles  # noqa: PLC0415

    use_profiles(profiles=PLAYER_PROFILES)
    bag = options.bag or newest()
    playback = Playback(**{name: getattr(options, name) for name in Playback._fields})
    made: list[BagPlayer] = []
    with ExitStack() as end:

        def create() -> BagPlayer:
            made.append(BagPlayer(bag, playback, _show))
            with suppress(UserError):  # without a terminal there are no keys
                end.enter_context(Terminal()).listen(made[0].on_key)
            return made[0]

        rules = [word for rule in options.remap for word in ('--remap', rule)]
        code = spin(create, [*options.ros_args, *([ROS_ARGS, *rules] if rules else [])])
    _show('')
    print(f'played {made[0].progress.strip()}')  # noqa: T201
    return code


def _show(line: str) -> None:
    if sys.stderr.isatty():
        print(f'\r\x1b[K{line}', end='', file=sys.stderr, flush=True)  # noqa: T201
