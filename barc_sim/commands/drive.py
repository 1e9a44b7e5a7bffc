"""`acc` and `teleop`: a run with the cruise control, and one by hand."""

from __future__ import annotations

from argparse import ArgumentTypeError
from importlib import import_module
from typing import TYPE_CHECKING

from barc_sim.cli.parser import accept_ros_args, number, whole
from barc_sim.cli.signals import StopSignals
from barc_sim.control.cruise_control import LIMIT, SPEED
from barc_sim.control.driver import INPUTS, PEDAL
from barc_sim.control.pid import ACCELERATION_LIMIT, PID, SPEED_REFERENCE
from barc_sim.control.types import DEFAULT_TYPE, GAINS, TYPES
from barc_sim.runs import options as run_options
from barc_sim.simulation.stepper import DISTANCE, LAPS

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser

_MAX_CARS = 100
_MODULES = {'acc': 'cruise_control', 'teleop': 'teleop'}  #: in `runs`


def add_arguments_acc(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Simulator, PID cruise controller and recorder, until the end of the road.'
    parser.set_defaults(mode='acc')
    parser.add_argument(
        '--speed',
        type=number(*SPEED.between),
        metavar='M/S',
        help=f'speed to hold ({SPEED_REFERENCE:g} m/s)',
    )
    parser.add_argument(
        '--reference',
        metavar='FILE',
        help='the speed to hold over time or place: a CSV file with the columns time_s,speed_mps '
        'or distance_m,speed_mps',
    )
    parser.add_argument(
        '--controller-type', choices=tuple(TYPES), help=f'what holds the speed ({DEFAULT_TYPE})'
    )
    for name, gain in PID.gains.items():
        parser.add_argument(
            f'--{name}',
            type=number(*gain.between),
            metavar='GAIN',
            help=f'{gain.meaning} ({gain.default:g} {gain.unit})'.replace(' -)', ')'),
        )
    parser.add_argument(
        '--acceleration-limit',
        type=number(*LIMIT.between),
        metavar='M/S²',
        help=f"of the controller's output ({ACCELERATION_LIMIT:g} m/s²; user code: none)",
    )
    parser.add_argument(
        '--gain',
        type=_gain,
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help=f'a gain of the controller; may be repeated ({"; ".join(map(_gains_of, TYPES))})',
    )
    parser.add_argument(
        '--distance',
        type=number(*DISTANCE.between),
        metavar='M',
        help='a lap ends here; 0: only at Ctrl-C (180 m)',
    )
    parser.add_argument(
        '--laps',
        type=whole(*LAPS.between),
        metavar='N',
        help='number of laps from standstill; 0: until Ctrl-C (1)',
    )
    parser.add_argument(
        '--cars',
        type=whole(1, _MAX_CARS),
        default=1,
        metavar='N',
        help='number of cars, each with a controller and a road of its own, in /car1, /car2, … (1)',
    )
    parser.add_argument(
        '--no-controller',
        action='store_true',
        help="start no controller of barc_sim's, and wait for another that publishes ecu",
    )
    run_options.add_arguments(parser, 'model', 'controller', road='lab', view='offer')
    accept_ros_args(parser)
    gains = (f'--{name}' for name in PID.gains)
    own = ('--speed', *gains, '--acceleration-limit', '--distance', '--laps')
    parser.shorten_help(*own, *run_options.USUAL)


def run_acc(options: Namespace) -> int:
    """Drive, and return the exit code."""
    with StopSignals() as stop:
        options.engine = run_options.choose_engine(options)
        if options.engine == 'local':
            from barc_sim.ros.local import install  # noqa: PLC0415

            install()  # before nodes are imported
        run = import_module(f'barc_sim.runs.{_MODULES[options.mode]}')  # slow
        return int(run.drive(options, stop))


run_teleop = run_acc


def add_arguments_teleop(parser: Parser) -> None:
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
    parser.shorten_help('--input', *run_options.USUAL)


def _gain(text: str) -> tuple[str, float]:
    """Return name and value of a gain."""
    name, equals, value = text.partition('=')
    if not equals or name not in GAINS:
        raise ArgumentTypeError(
            f'{text!r} is no gain: expected NAME=VALUE with a name of {", ".join(GAINS)}'
        )
    return name, number(*GAINS[name].between)(value)


def _gains_of(controller: str) -> str:
    return f'{controller}: {", ".join(TYPES[controller].gains)}'
