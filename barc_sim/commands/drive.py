"""`acc` and `teleop`: a run with the cruise control, and one by hand."""

from __future__ import annotations

from argparse import ArgumentTypeError
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import accept_ros_args, number, whole
from barc_sim.cli.process import StopSignals
from barc_sim.control.cruise_control import (
    DEFAULT_LANE,
    DEFAULT_TYPE,
    LANE_TYPES,
    LIMIT,
    PROFILE,
    SPEED,
    TYPES,
)
from barc_sim.control.speed import ACCELERATION_LIMIT, PID, SPEED_REFERENCE
from barc_sim.runs import options as run_options
from barc_sim.simulation.scenario import Scenario
from barc_sim.simulation.stepper import parameters
from barc_sim.vehicle.track import TRACKS

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Mapping

    from barc_sim.cli.parser import Parser
    from barc_sim.control.speed import Tunable
    from barc_sim.runs.inputs import RunInputs

_MAX_CARS = 100
#: Of the simulator on a road.
_PARAMETERS = {each.name: each for each in parameters(Scenario.distance)}


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
        help='speed to hold over time or distance: a CSV file with the columns time_s,speed_mps '
        'or distance_m,speed_mps',
    )
    parser.add_argument(
        '--controller-type', choices=tuple(TYPES), help=f'controller of the speed ({DEFAULT_TYPE})'
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
        help=f"limit of the controller's output ({ACCELERATION_LIMIT:g} m/s²; user code: none)",
    )
    _add_gains(parser, '--gain', 'controller', TYPES)
    _add_track_options(parser)
    parser.add_argument(
        '--policy',
        type=Path,
        metavar='FILE',
        help='drive with a trained policy, as in its Gymnasium environment (Lane-v0 or Race-v0 on '
        'a track, Hills-v0 on a road): an ONNX file, or a Python file with a function '
        'policy(observation)',
    )
    parser.add_argument(
        '--distance',
        type=number(*_PARAMETERS['distance'].between),
        metavar='M',
        help=f'end of a lap; 0: none, until Ctrl-C ({_PARAMETERS["distance"].default:g} m; on a '
        'track, the end of the last lap)',
    )
    parser.add_argument(
        '--laps',
        type=whole(*_PARAMETERS['laps'].between),
        metavar='N',
        help='number of laps, each from standstill on a road; 0: until Ctrl-C '
        f'({_PARAMETERS["laps"].default})',
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
        help="start no controller of barc_sim's; wait for another node that publishes ecu",
    )
    run_options.add_arguments(
        parser,
        'model',
        'controller',
        'lane',
        'raceline',
        'identify',
        road='lab; on a track flat',
        view='offer',
    )
    accept_ros_args(parser)
    gains = (f'--{name}' for name in PID.gains)
    own = ('--speed', *gains, '--track', '--distance')
    parser.shorten_help(*own, *run_options.USUAL)


def run_acc(options: Namespace) -> int:
    """Drive with the cruise control, and return the exit code."""
    with StopSignals() as stop:
        inputs = _prepare(options)
        from barc_sim.runs import acc  # noqa: PLC0415 (imports rclpy)

        return acc.run_nodes(options, inputs, stop)


def _prepare(options: Namespace) -> RunInputs:
    """Choose the engine, and read the inputs of a run; nothing has imported rclpy before."""
    from barc_sim.runs.engine import choose_and_install_engine  # noqa: PLC0415 (not for --help)
    from barc_sim.runs.inputs import read_inputs  # noqa: PLC0415

    options.engine = choose_and_install_engine(options)
    return read_inputs(options)


def add_arguments_teleop(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Simulator, relay, keyboard and recorder, until q or Ctrl-C.'
    parser.set_defaults(mode='teleop')
    parser.add_argument(
        '--no-relay',
        action='store_true',
        help="start no relay of barc_sim's; wait for another node that publishes ecu",
    )
    run_options.add_arguments(parser, 'model', 'relay', road='flat', view='web')
    accept_ros_args(parser)
    parser.shorten_help(*run_options.USUAL)


def run_teleop(options: Namespace) -> int:
    """Drive by hand, and return the exit code."""
    with StopSignals() as stop:
        inputs = _prepare(options)
        from barc_sim.runs import teleop  # noqa: PLC0415 (imports rclpy)

        return teleop.run_nodes(options, inputs, stop)


def _add_track_options(parser: Parser) -> None:
    parser.add_argument(
        '--track',
        metavar='TRACK',
        help=f'drive laps of a track: {", ".join(TRACKS)}, or a CSV file: length_m,radius_m (none)',
    )
    parser.add_argument(
        '--lane',
        type=_law,
        choices=tuple(LANE_TYPES),
        help=f'steering law on a track, unless --lab has a lane.py ({DEFAULT_LANE})',
    )
    _add_gains(parser, '--lane-gain', 'steering law', LANE_TYPES)
    parser.add_argument(
        '--speed-profile',
        type=number(1e-3, PROFILE[0].between[1]),
        nargs=2,
        metavar=('LATERAL', 'LONGITUDINAL'),
        help='drive as fast as these accelerations [m/s²] allow on the track, --speed at most',
    )


def _law(text: str) -> str:
    if text.endswith('.py'):
        raise ArgumentTypeError(f'{text!r} is a file: name the folder of your lane.py with --lab')
    return text


def _gain(text: str) -> tuple[str, float]:
    """Return name and value of a gain; the run checks that the controller has it."""
    name, equals, value = text.partition('=')
    if not equals:
        raise ArgumentTypeError(f'{text!r} is not a gain: expected NAME=VALUE')
    return name, number(-inf, inf)(value)


def _add_gains(
    parser: Parser, option: str, controller: str, types: Mapping[str, type[Tunable]]
) -> None:
    """Add the option for the gains of a controller, which is of one of the `types`."""
    names = '; '.join(f'{name}: {", ".join(kind.gains)}' for name, kind in types.items())
    parser.add_argument(
        option,
        type=_gain,
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help=f'a gain of the {controller}; may be repeated ({names})',
    )
