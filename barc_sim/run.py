"""The runs: `python -m barc_sim.run acc` and `python -m barc_sim.run teleop`."""

from __future__ import annotations

import signal

if __name__ == '__main__':
    # Until StopSignals takes over: there is nothing to end in order yet, and no traceback needed.
    signal.signal(signal.SIGINT, signal.SIG_DFL)

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.option_types import number, whole
from barc_sim.cli.parser import Parser, call
from barc_sim.cli.signals import StopSignals
from barc_sim.control.pid import PID, SPEED_REFERENCE
from barc_sim.control.types import DEFAULT_TYPE, GAINS, TYPES
from barc_sim.lab.user_code.loading import FILES
from barc_sim.runs.recording_options import add_recording_options
from barc_sim.runs.view_options import add_mirror_options, add_view_options

if TYPE_CHECKING:
    from collections.abc import Callable

_PROG = 'barc_sim.run'
_EPILOG = (
    'What follows --ros-args goes to ROS, for example '
    '--ros-args -r __ns:=/car2 -p controller:acceleration_limit:=4.0'
)
_MAX_SPEED = 100.0
_MAX_DISTANCE = 1e6
_MAX_FACTOR = 1000.0
_MAX_SEED = 2**53
_MAX_CARS = 100


def main(argv: list[str] | None = None) -> int:
    """Run the command line `argv`; return the exit code."""
    argv = sys.argv[1:] if argv is None else argv
    return call(_PROG, lambda: _main(argv))


def acc() -> int:
    """Run the cruise control, as `ros2 run barc_sim acc` does."""
    return main(['acc', *sys.argv[1:]])


def teleop() -> int:
    """Drive by hand, as `ros2 run barc_sim teleop` does."""
    return main(['teleop', *sys.argv[1:]])


def _main(argv: list[str]) -> int:
    cut = argv.index('--ros-args') if '--ros-args' in argv else len(argv)
    options = parser().parse_args(argv[:cut])
    with StopSignals() as stop:
        return _run(options.mode)(options, argv, argv[cut:], stop)


def _run(mode: str) -> Callable[..., int]:
    # Imported here, as --help is to be quick.
    if mode == 'teleop':
        from barc_sim.runs.teleop import teleop  # noqa: PLC0415

        return teleop
    from barc_sim.runs.cruise_control import cruise_control  # noqa: PLC0415

    return cruise_control


def parser() -> Parser:
    """Return the parser of the command line, up to `--ros-args`."""
    parser = Parser(prog=f'python -m {_PROG}', description='Run the simulator.', epilog=_EPILOG)
    modes = parser.add_subparsers(dest='mode', required=True, metavar='MODE')
    _add_acc(modes)
    _add_teleop(modes)
    return parser


def _add_acc(modes: argparse._SubParsersAction[Parser]) -> None:
    mode = modes.add_parser(
        'acc',
        help='cruise control: the PID holds a speed over the hills',
        description='Simulator, PID cruise controller and recorder, until the end of the road.',
        epilog=_EPILOG,
    )
    mode.add_argument(
        '--speed',
        type=number(-_MAX_SPEED, _MAX_SPEED),
        metavar='M/S',
        help=f'speed to hold ({SPEED_REFERENCE:g})',
    )
    mode.add_argument(
        '--controller-type', choices=tuple(TYPES), help=f'what holds the speed ({DEFAULT_TYPE})'
    )
    for name, gain in PID.gains.items():
        mode.add_argument(
            f'--{name}', type=number(*gain.between), metavar='GAIN', help=f'({gain.default:g})'
        )
    mode.add_argument(
        '--gain',
        type=_gain,
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help=f'a gain of the controller; may be repeated ({"; ".join(map(_gains_of, TYPES))})',
    )
    mode.add_argument(
        '--distance',
        type=number(0.0, _MAX_DISTANCE),
        metavar='M',
        help='the run ends here; 0: it goes on until Ctrl-C (180)',
    )
    mode.add_argument(
        '--road',
        metavar='ROAD',
        help="'lab', 'flat', or a CSV file with the columns start_m,grade_deg (lab)",
    )
    mode.add_argument(
        '--realtime-factor',
        type=_factor,
        metavar='FACTOR',
        help="simulated seconds per second, or 'max' for as fast as it goes (1)",
    )
    mode.add_argument(
        '--cars',
        type=whole(1, _MAX_CARS),
        default=1,
        metavar='N',
        help='so many cars, each with a controller and a road of its own, in /car1, /car2, … (1)',
    )
    _add_user_code(mode, 'model', 'controller')
    mode.add_argument(
        '--no-controller',
        action='store_true',
        help='leave ours out, and wait for another that publishes ecu',
    )
    add_view_options(mode, on=False)
    _add_common(mode)


def _add_teleop(modes: argparse._SubParsersAction[Parser]) -> None:
    mode = modes.add_parser(
        'teleop',
        help='drive by hand',
        description='Simulator, relay, keyboard and recorder, until q or Ctrl-C.',
        epilog=_EPILOG,
    )
    mode.add_argument(
        '--road',
        metavar='ROAD',
        help="'lab', 'flat', or a CSV file with the columns start_m,grade_deg (flat)",
    )
    mode.add_argument(
        '--realtime-factor',
        type=_factor,
        metavar='FACTOR',
        help='simulated seconds per second (1)',
    )
    _add_user_code(mode, 'model', 'relay')
    add_view_options(mode, on=True)
    _add_common(mode)


def _add_user_code(mode: Parser, *parts: str) -> None:
    files = ' and '.join(FILES[part] for part in parts)
    mode.add_argument(
        '--lab',
        type=Path,
        metavar='DIR',
        help=f'drive with the {files} of this folder, as far as it has them',
    )
    for part in parts:
        mode.add_argument(
            f'--{part}',
            type=Path,
            metavar='FILE',
            help=f'drive with this file in place of {FILES[part]}',
        )
    mode.set_defaults(parts=parts)


def _add_common(mode: Parser) -> None:
    bag = mode.add_mutually_exclusive_group()
    bag.add_argument(
        '--bag-dir',
        type=Path,
        default=Path('bags'),
        metavar='DIR',
        help='where bags are kept (bags)',
    )
    bag.add_argument('--no-bag', action='store_true', help='record nothing')
    mode.add_argument(
        '--seed', type=whole(0, _MAX_SEED), metavar='N', help='seed of the measurement noise (0)'
    )
    mode.add_argument('--integrator', choices=('euler', 'rk4'), help='how steps are made (euler)')
    mode.add_argument('--dynamics', choices=('kinematic', 'dynamic'), help='bicycle (kinematic)')
    mode.add_argument(
        '-q', '--quiet', action='store_true', help="print the bag's path, and nothing else"
    )
    mode.add_argument(
        '--network',
        action='store_true',
        help='seen by other machines, too: sets ROS_AUTOMATIC_DISCOVERY_RANGE to SUBNET',
    )
    mode.add_argument(
        '--clock',
        action='store_true',
        default=None,
        help='publish the simulated time on /clock also where the real-time factor is 1, for nodes '
        'that use_sim_time',
    )
    add_mirror_options(mode)
    add_recording_options(mode)


def _gain(text: str) -> tuple[str, float]:
    """Return name and value of a gain."""
    name, _, value = text.partition('=')
    if name not in GAINS:
        raise argparse.ArgumentTypeError(
            f'{text!r} is no gain: expected NAME=VALUE with a name of {", ".join(GAINS)}'
        )
    return name, number(*GAINS[name].between)(value)


def _gains_of(controller: str) -> str:
    return f'{controller}: {", ".join(TYPES[controller].gains)}'


def _factor(text: str) -> float:
    """Return the real-time factor; 0.0 stands for `max`."""
    if text == 'max':
        return 0.0
    value = number(0.0, _MAX_FACTOR)(text)
    if value == 0.0:
        raise argparse.ArgumentTypeError("0 is not a factor above 0, nor 'max'")
    return value


if __name__ == '__main__':
    sys.exit(main())
