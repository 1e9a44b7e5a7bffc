"""`tune`, `identify` and `raceline`: the best gains, the car that made bags, and a racing line."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.files import FIGURE_DPI, FIGURES, saving, target
from barc_sim.cli.parser import barc_path, number, whole
from barc_sim.control.cruise_control import PROFILE, SPEED
from barc_sim.control.speed import KD, KI, KP, SPEED_REFERENCE
from barc_sim.errors import UserError
from barc_sim.tuning import DISTANCE
from barc_sim.tuning import SPEED as TUNED_SPEED
from barc_sim.vehicle.parameters import ROWS

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterable, Iterator, Sequence

    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from barc_sim.cli.parser import Parser
    from barc_sim.tuning.search import Sweep

    Floats = NDArray[np.float64]

#: By gain: the start, and the end of the searched range, which begins at zero.
GAINS = {'kp': (KP, 100.0), 'ki': (KI, 4000.0), 'kd': (KD, 2.0)}
#: The scores that --cost names.
COSTS = {'rms': 'rms_error', 'max': 'max_error', 'overshoot': 'overshoot', 'effort': 'effort'}
_ROAD = 'lab'
_PERIOD = 0.02  #: [s] of a step
_MAX_GAIN = 1e6


def add_arguments_tune(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Search the gains that hold the speed best.'
    parser.add_argument(
        '--cost',
        choices=COSTS,
        default='rms',
        help='what to minimise: rms or max, the speed error after the first 10 m [m/s]; '
        'overshoot, a share of the speed; or effort, the RMS command [m/s²] (rms)',
    )
    parser.add_argument(
        '--road',
        nargs='+',
        action='extend',
        metavar='ROAD',
        help="'lab', 'flat', or CSV files with the columns start_m,grade_deg; of several, the mean "
        f'cost counts ({_ROAD})',
    )
    noise, gain = number(*ROWS['noise_v_x'].between), number(0.0, _MAX_GAIN)
    for name, kind, default, unit, meaning in (
        ('effort', gain, 0.0, 'WEIGHT', 'add this times the effort to the cost '),
        ('speed', number(*TUNED_SPEED.between), SPEED_REFERENCE, 'M/S', ''),
        ('distance', number(*DISTANCE.between), DISTANCE.default, 'M', ''),
        ('noise', noise, 0.0, 'M/S', "standard deviation of the measured speed's noise "),
        ('delay', whole(0, 500), 0, 'STEPS', 'of 20 ms, from a command to its effect '),
        ('seed', whole(*ROWS['seed'].between), 0, 'N', 'of search and noise, as --seed of a run '),
    ):
        text = f'{meaning}({default:g})'
        parser.add_argument(f'--{name}', type=kind, default=default, metavar=unit, help=text)
    for name, (_, high) in GAINS.items():
        parser.add_argument(
            f'--{name}-range',
            type=gain,
            nargs=2,
            default=(0.0, high),
            metavar=('LOW', 'HIGH'),
            help=f'(0 to {high:g}); the same number twice holds it there',
        )
    parser.add_argument(
        '--controller', type=Path, metavar='FILE', help='tune the class PID of this file'
    )


def run_tune(options: Namespace) -> None:
    """Search, and print the gains with the lines to run them."""
    import numpy as np  # noqa: PLC0415 (slow: not for --help)

    from barc_sim.lab.user_code.adapters import controller_of  # noqa: PLC0415
    from barc_sim.tuning.search import search, sweep  # noqa: PLC0415

    began, roads = time.monotonic(), options.road or [_ROAD]
    ranges = [getattr(options, f'{gain}_range') for gain in GAINS]
    for gain, (first, last) in zip(GAINS, ranges, strict=True):
        if first > last:
            raise UserError(f'--{gain}-range {first:g} {last:g} must have the lower number first')
    low, high = zip(*ranges, strict=True)
    controller = controller_of(options.controller) if options.controller else None

    def scores(gains: Floats, road: str) -> Sweep:
        return sweep(
            *gains.T,
            controller=controller,
            road=road,
            speed_reference=options.speed,
            distance=options.distance,
            noise=options.noise,
            seed=options.seed,
            delay=options.delay * _PERIOD,
        )

    def cost(found: Sweep) -> Floats:
        value: Floats = found[COSTS[options.cost]]
        return value + options.effort * found.effort if options.effort else value

    start = np.array([first for first, _ in GAINS.values()])
    try:
        best = search(
            lambda gains: np.mean([cost(scores(gains, road)) for road in roads], axis=0),
            np.array(low),
            np.array(high),
            start,
            seed=options.seed,
            on_generation=_show_progress,
        )
    finally:  # also before an error's sentence
        _show('')
    if not np.isfinite(best.cost):
        raise UserError(
            f'no gains in these ranges drive {options.distance:g} m in thrice the time that it '
            'should take on every road: widen the ranges, or choose roads that the car can climb'
        )
    name = options.cost + (f' + {options.effort:g} effort' if options.effort else '')
    for road in roads:
        both = scores(np.array([start, best.gains]), road)
        _print_scores(road, both, f'cost: {name}', cost(both))
    took = time.monotonic() - began
    print(f'{best.evaluations} closed loops per road in {took:.1f} s; to run it:')  # noqa: T201
    for command in _commands(options, best.gains.tolist()):
        print(command)  # noqa: T201


def _commands(options: Namespace, gains: Sequence[float]) -> Iterator[str]:
    """Yield the command that runs `gains`, for each of the roads."""
    for road in options.road or [_ROAD]:
        words = ['acc']
        for name, gain in zip(GAINS, gains, strict=True):
            words += [f'--{name}', _typed(gain)]
        for name, value, default in (
            ('road', road, _ROAD),
            ('speed', _typed(options.speed), _typed(SPEED_REFERENCE)),
            ('distance', _typed(options.distance), _typed(float(DISTANCE.default))),
            ('controller', str(options.controller), str(None)),
            ('seed', str(options.seed if options.noise else 0), '0'),
        ):
            if value != default:
                words += [f'--{name}', value]
        parameters = {'noise_v_x': options.noise, 'motor_delay': options.delay * _PERIOD}
        if any(parameters.values()):
            words.append('--ros-args')
        for name, value in parameters.items():
            if value:
                words += ['-p', f'vehicle_simulator:{name}:={float(_typed(value))}']
        yield f'{barc_path()} {shlex.join(words)}'


def _typed(value: float) -> str:
    """Return a number as it is typed."""
    return f'{value:.12g}'


def _show_progress(generation: int, cost: float) -> None:
    minimum = f'minimum cost {cost:.4g}' if isfinite(cost) else 'none arrives yet'
    _show(f'generation {generation}, {minimum}')


def _show(text: str) -> None:
    """Show `text` in place of what was shown before, where somebody looks."""
    if sys.stderr.isatty():
        print(f'\r\033[K{text}', end='', file=sys.stderr, flush=True)  # noqa: T201


def _print_scores(road: str, found: Sweep, label: str, costs: Floats) -> None:
    """Print a table of the scores and costs of two runs."""
    from barc_sim.tuning.search import SCORES  # noqa: PLC0415

    rows: dict[str, Iterable[str]] = {f'road {road}': ('start', 'found')}
    rows |= {gain: map(_typed, found[gain]) for gain in GAINS}
    forms = '.4f', '.4f', '.2%', '.3f'
    values = [(SCORES[name], found[name], form) for name, form in zip(SCORES, forms, strict=True)]
    for text, pair, form in (*values, (label, costs, '.5g')):
        rows[text] = [f'{each:{form}}' if isfinite(each) else '-' for each in pair]
    width = max(map(len, rows))
    for name, (first, second) in rows.items():
        print(f'{name:{width}}  {first:>9}  {second:>9}')  # noqa: T201


def add_arguments_identify(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Find drag, rolling friction and motor delay of the car that made the bags, and, where it '
        'steered, its tyres and yaw inertia: each with an interval of 95 %.'
    )
    parser.epilog = (
        'A drive that shows much: `barc acc --controller-type prbs`, also steps and coast-down. '
        "Another robot's bag: --field v_x=/odom.twist.twist.linear.x --field motor=/cmd.accel"
    )
    parser.add_argument(
        'bags', nargs='*', type=Path, metavar='BAG', help='of one car (the newest in ./bags)'
    )
    parser.add_argument('--namespace', metavar='NS', help='the car, in a bag of several')
    parser.add_argument(
        '--field',
        action='append',
        type=_field,
        default=[],
        metavar='COLUMN=/TOPIC.FIELD',
        help='where a bag of another robot has v_x, motor, servo, psi_dot, v_y or theta_deg',
    )
    mass = ROWS['mass']
    parser.add_argument(
        '--mass',
        type=number(*mass.between),
        default=mass.default,
        help=f'[kg] of the car ({mass.default:g})',
    )
    parser.add_argument(
        '--integrator',
        choices=('euler', 'rk4'),
        default='euler',
        help='euler: as the simulator by default; rk4: for a real car (euler)',
    )
    parser.add_argument('--save', metavar='FILE', help='save a figure as .png, .pdf or .svg')


def _field(text: str) -> tuple[str, str]:
    column, _, field = text.partition('=')
    if not (column and field.startswith('/') and '.' in field):
        raise argparse.ArgumentTypeError(
            f'{text!r} must be a column and a field, as in v_x=/odom.twist.twist.linear.x'
        )
    return column, field


def run_identify(options: Namespace) -> None:
    """Read the bags, and print the parameters."""
    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.bags.convert import log_of_fields  # noqa: PLC0415
    from barc_sim.tuning.identification import identify  # noqa: PLC0415
    from barc_sim.vehicle.bike_model import Vehicle  # noqa: PLC0415

    path = _figure(options)
    fields = dict(options.field)
    if fields and not {'v_x', 'motor'} <= fields.keys():
        raise UserError(f'--field names {", ".join(fields)}: expected v_x and motor at least')
    bags = options.bags or [reader.newest()]
    logs = [
        log_of_fields(bag, fields) if fields else reader.read(bag, options.namespace)
        for bag in bags
    ]
    found = identify(*logs, vehicle=Vehicle(mass=options.mass), integrator=options.integrator)
    width = max(map(len, found.estimates))
    for name, each in found.estimates.items():
        print(f'{name:{width}}  {each!s:32} {each.meaning}')  # noqa: T201
    for remark in found.remarks:
        print(f'- {remark}')  # noqa: T201
    if path:
        from barc_sim.figures.identification_figure import identification_figure  # noqa: PLC0415

        title = ', '.join(bag.resolve().name for bag in bags)
        _save(path, identification_figure(found.signals, title=title))


def add_arguments_raceline(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Find the line of least curvature on a track, and the speed that it allows.'
    )
    parser.epilog = 'Drive it: `barc acc --track line.csv --speed-profile 3.5 2 --speed 12`'
    parser.add_argument(
        'track', metavar='TRACK', help='as --track of `barc acc`: L, oval, a CSV file, …'
    )
    accelerations = PROFILE[0].between
    for name, most, default, unit, meaning in (
        ('speed', SPEED.between[1], 12.0, 'm/s', 'maximum speed'),
        ('lateral', accelerations[1], 3.5, 'm/s²', 'maximum acceleration across'),
        ('longitudinal', accelerations[1], 2.0, 'm/s²', 'maximum acceleration along, either way'),
    ):
        parser.add_argument(
            f'--{name}',
            type=number(1e-3, most),
            default=default,
            metavar=unit.upper(),
            help=f'{meaning} ({default:g} {unit})',
        )
    parser.add_argument(
        '--margin',
        type=number(0.0, 1e3),
        metavar='M',
        help='distance to keep from both edges (a fifth of the width)',
    )
    parser.add_argument('-o', '--output', metavar='FILE', help='write the line as a track, a .csv')
    parser.add_argument('--save', metavar='FILE', help='save a figure as .png, .pdf or .svg')


def run_raceline(options: Namespace) -> None:
    """Print the lap's time, and write the line."""
    from barc_sim.control.lane import speed_profile  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.control.planning import lap_time, racing_line, write_line  # noqa: PLC0415
    from barc_sim.vehicle.track import Track  # noqa: PLC0415

    output = target(options.output, ('csv',)) if options.output else None
    path = _figure(options)
    track = Track.named(options.track)
    line = racing_line(track, margin=options.margin)
    limits = options.speed, options.lateral, options.longitudinal
    speeds = []
    for name, each in (('centre line', track), ('racing line', line)):
        speeds.append(speed_profile(each, *limits))
        radius = 1.0 / max(map(abs, each.curvatures))
        time = lap_time(each, speeds[-1])
        print(  # noqa: T201
            f'{name}  {time:6.2f} s  {each.length:7.1f} m  smallest radius {radius:5.1f} m'
        )
    if output:
        with saving(output, '--output') as part:
            write_line(part, track, line, speeds[1])
        print(output)  # noqa: T201
    if path:
        from barc_sim.figures.track_figure import line_figure  # noqa: PLC0415

        _save(path, line_figure(track, line, *speeds))


def _figure(options: Namespace) -> Path | None:
    """Return where a figure is to be saved."""
    return None if options.save is None else target(options.save, FIGURES)


def _save(path: Path, figure: Figure) -> None:
    with saving(path) as part:
        figure.savefig(part, dpi=FIGURE_DPI)
    print(path)  # noqa: T201
