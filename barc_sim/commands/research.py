"""`tune`, `identify` and `raceline`: the best gains, a car's parameters, and a racing line."""

from __future__ import annotations

import argparse
import shlex
import time
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from barc_sim.cli.files import figure_path, saving, target
from barc_sim.cli.parser import barc_path, number, show, whole
from barc_sim.control.cruise_control import PROFILE, SPEED
from barc_sim.control.speed import ACCELERATION_LIMIT, KD, KI, KP, NO_LIMIT
from barc_sim.errors import UserError, escaped
from barc_sim.parallel.options import add_executor_options, interruptible_executor_of
from barc_sim.simulation.scenario import LIMITS, Scenario
from barc_sim.tuning import DISTANCE, MIN_RESAMPLES
from barc_sim.tuning import SPEED as TUNED_SPEED
from barc_sim.vehicle.bicycles import INTEGRATORS
from barc_sim.vehicle.parameters import ROWS

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence
    from concurrent.futures import Executor

    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.cli.parser import Parser
    from barc_sim.tuning.sweep import Sweep
    from barc_sim.vehicle.road import Road

    Floats = NDArray[np.float64]

#: By gain: the start, and the end of the searched range, which begins at zero.
GAINS = {'kp': (KP, 100.0), 'ki': (KI, 4000.0), 'kd': (KD, 2.0)}
#: The scores that --cost names.
COSTS = {'rms': 'rms_error', 'max': 'max_error', 'overshoot': 'overshoot', 'effort': 'effort'}
_MAX_GAIN = 1e6
_MAX_RESAMPLES = 10**6


def _add_numbers(parser: Parser, *rows: tuple[str, Callable[[str], float], Any, str, str]) -> None:
    """Add options: name, type, default (None: the meaning has it), unit and meaning."""
    for name, kind, default, unit, meaning in rows:
        text = meaning if default is None else f'{meaning} ({default:g})'.lstrip()
        parser.add_argument(f'--{name}', type=kind, default=default, metavar=unit, help=text)


def add_arguments_tune(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Search for the gains that hold the speed best.'
    parser.add_argument(
        '--cost',
        choices=COSTS,
        default='rms',
        help='what to minimise: rms or max, the speed error after the first 10 m [m/s]; '
        'overshoot, relative to the speed; or effort, the RMS command [m/s²] (rms)',
    )
    parser.add_argument(
        '--road',
        nargs='+',
        action='extend',
        metavar='ROAD',
        help="'lab', 'flat', or CSV files with the columns start_m,grade_deg; with several, the "
        'mean cost counts (lab)',
    )
    noise = LIMITS['noise']
    delay = LIMITS['delay']
    sensor_delay = LIMITS['sensor_delay']
    seed = LIMITS['seed']
    gain = number(0.0, _MAX_GAIN)
    _add_numbers(
        parser,
        ('effort', gain, 0.0, 'WEIGHT', 'add this times the effort to the cost'),
        ('speed', number(*TUNED_SPEED.between), TUNED_SPEED.default, 'M/S', 'speed to hold'),
        ('distance', number(*DISTANCE.between), DISTANCE.default, 'M', 'length of a drive'),
        (
            'noise',
            number(*noise.between),
            noise.default,
            'M/S',
            "standard deviation of the measured speed's noise",
        ),
        ('delay', number(*delay.between), delay.default, 'S', 'time from a command to its effect'),
        (
            'sensor-delay',
            number(*sensor_delay.between),
            sensor_delay.default,
            'S',
            'age of a measurement at its stamp',
        ),
        ('seed', whole(*seed.between), seed.default, 'N', 'seed of the search and of the noise'),
    )
    for name, (_, high) in GAINS.items():
        parser.add_argument(
            f'--{name}-range',
            type=gain,
            nargs=2,
            default=(0.0, high),
            metavar=('LOW', 'HIGH'),
            help=f'range to search (0 to {high:g}); the same number twice fixes the gain',
        )
    parser.add_argument(
        '--controller', type=Path, metavar='FILE', help='tune the class PID of this file'
    )
    add_executor_options(parser, 'processes', 'this one, whose compiled runs use all cores')


def run_tune(options: Namespace) -> None:
    """Search, and print the gains with the lines to run them."""
    import numpy as np  # noqa: PLC0415 (slow: not for --help)
    from rich.console import Console  # noqa: PLC0415

    from barc_sim.lab.user_code.adapters import controller_of  # noqa: PLC0415
    from barc_sim.tuning.search import search  # noqa: PLC0415
    from barc_sim.tuning.sweep import sweep  # noqa: PLC0415
    from barc_sim.vehicle.road import Road  # noqa: PLC0415

    began = time.monotonic()
    names = options.road or ['lab']
    # Read before the working directory changes.
    roads = {name: Road.named(name) for name in names}
    ranges = [getattr(options, f'{gain}_range') for gain in GAINS]
    for gain, (first, last) in zip(GAINS, ranges, strict=True):
        if first > last:
            raise UserError(f'--{gain}-range {first:g} {last:g} must have the lower number first')
    lows = np.array([first for first, _ in ranges])
    highs = np.array([last for _, last in ranges])

    controller = controller_of(options.controller) if options.controller else None
    # As in a run: a user's controller limits its output itself.
    limit = NO_LIMIT if controller else ACCELERATION_LIMIT

    def scores(gains: Floats, road: Road, executor: Executor | None) -> Sweep:
        return sweep(
            *gains.T,
            executor=executor,
            controller=controller,
            road=road,
            speed_reference=options.speed,
            distance=options.distance,
            noise=options.noise,
            seed=options.seed,
            delay=options.delay,
            sensor_delay=options.sensor_delay,
            acceleration_limit=limit,
        )

    def cost(swept: Sweep) -> Floats:
        value: Floats = swept[COSTS[options.cost]]
        return value + options.effort * swept.effort if options.effort else value

    start = np.array([getattr(controller, name, first) for name, (first, _) in GAINS.items()])

    with (
        interruptible_executor_of(options) as executor,
        Console(stderr=True).status('searching'),
    ):

        def mean_cost(gains: Floats) -> Floats:
            costs = [cost(scores(gains, roads[name], executor)) for name in names]
            mean: Floats = np.mean(costs, axis=0)
            return mean

        best = search(mean_cost, lows, highs, start, seed=options.seed)
        if not np.isfinite(best.cost):
            raise UserError(
                f'no gains in these ranges drive {options.distance:g} m on every road within three '
                'times the usual time: widen the ranges, or choose roads that the car can climb'
            )
        both = np.array([start, best.gains])
        compared = {name: scores(both, road, executor) for name, road in roads.items()}

    label = f'cost: {options.cost}'
    if options.effort:
        label += f' + {options.effort:g} effort'
    for name in names:
        _print_scores(name, compared[name], label, cost(compared[name]))

    took = time.monotonic() - began
    print(f'{best.evaluations} closed loops per road in {took:.1f} s; to run it:')  # noqa: T201
    for name in names:
        print(_command(options, best.gains.tolist(), name))  # noqa: T201


def _command(options: Namespace, gains: Sequence[float], road: str) -> str:
    """Return the command that runs `gains` on a road."""
    numbers = dict(zip(GAINS, gains, strict=True))
    numbers |= {'speed': options.speed, 'distance': options.distance}
    words = ['acc', '--road', road]
    for name, value in numbers.items():
        words += [f'--{name}', f'{value:.12g}']
    if options.controller:
        words += ['--controller', str(options.controller)]

    parameters = {
        'noise_v_x': options.noise,
        'motor_delay': options.delay,
        'sensor_delay': options.sensor_delay,
    }
    if options.noise:
        words += ['--seed', str(options.seed)]
    if any(parameters.values()):
        words.append('--ros-args')
    for name, value in parameters.items():
        if value:
            words += ['-p', f'vehicle_simulator:{name}:={round(value, 12)}']
    return f'{barc_path()} {shlex.join(words)}'


def _print_scores(road: str, scores: Sweep, label: str, costs: Floats) -> None:
    """Print a table of the scores and costs of two runs."""
    from barc_sim.tuning.sweep import SCORES  # noqa: PLC0415

    forms = ('.4f', '.4f', '.2%', '.3f')
    rows = [(gain, scores[gain], '.12g') for gain in GAINS]
    rows += [(SCORES[name], scores[name], form) for name, form in zip(SCORES, forms, strict=True)]
    rows.append((label, costs, '.5g'))

    width = max(len(text) for text, *_ in rows)
    print(f'{"road " + road:{width}}  {"start":>9}  {"found":>9}')  # noqa: T201
    for text, pair, form in rows:
        cells = [f'{each:{form}}' if isfinite(each) else '-' for each in pair]
        print(f'{text:{width}}  {cells[0]:>9}  {cells[1]:>9}')  # noqa: T201


def add_arguments_identify(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Estimate drag, rolling friction and motor delay of the car that made the bags, and, if it '
        'steered, its tyres and yaw inertia: each with its 95 % confidence interval.'
    )
    parser.epilog = (
        'Drive a test signal first: `barc acc --controller-type prbs --road flat`, also steps and '
        'coast-down. '
        "Another robot's bag: --field v_x=/odom.twist.twist.linear.x --field motor=/cmd.accel"
    )
    parser.add_argument(
        'bags', nargs='*', type=Path, metavar='BAG', help='bags of one car (the newest in ./bags)'
    )
    parser.add_argument('--namespace', metavar='NS', help='the car, if the bag has several')
    parser.add_argument(
        '--field',
        action='append',
        type=_field,
        default=[],
        metavar='COLUMN=/TOPIC.FIELD',
        help='the field of a bag of another robot that holds v_x, motor, servo, psi_dot, v_y or '
        'theta_deg',
    )
    mass = ROWS['mass']
    _add_numbers(parser, ('mass', number(*mass.between), mass.default, 'KG', 'mass of the car'))
    parser.add_argument(
        '--integrator',
        choices=tuple(INTEGRATORS),
        default=Scenario.integrator,
        help="euler: the simulator's default; rk4: for a real car (euler)",
    )
    parser.add_argument('--save', metavar='FILE', help='save a figure as .png, .pdf or .svg')
    parser.add_argument(
        '--bootstrap',
        type=whole(MIN_RESAMPLES, _MAX_RESAMPLES),
        default=0,
        metavar='N',
        help='fit N resamples of the residuals, too, for intervals that are wider where residuals '
        'are correlated (none; 1000 is usual)',
    )
    add_executor_options(parser, 'processes that fit resamples', 'this one')


def _field(text: str) -> tuple[str, str]:
    column, _, field = text.partition('=')
    if not (column and field.startswith('/') and '.' in field):
        raise argparse.ArgumentTypeError(
            f'{text!r} must be a column and a field, as in v_x=/odom.twist.twist.linear.x'
        )
    return column, field


def run_identify(options: Namespace) -> None:
    """Read the bags, and print the parameters."""
    from rich.console import Console  # noqa: PLC0415 (slow: not for --help)

    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.bags.convert import log_of_fields  # noqa: PLC0415
    from barc_sim.tuning.identification import identify  # noqa: PLC0415
    from barc_sim.vehicle.bike_model import Vehicle  # noqa: PLC0415

    if not options.bootstrap and (options.jobs or options.scheduler):
        raise UserError('--jobs and --scheduler share the fits of --bootstrap: give it, too')
    path = figure_path(options.save)
    fields = dict(options.field)
    if fields and not {'v_x', 'motor'} <= fields.keys():
        raise UserError(f'--field names {", ".join(fields)}: expected v_x and motor at least')
    bags = options.bags or [reader.newest()]
    logs = [
        log_of_fields(bag, fields) if fields else reader.read(bag, options.namespace)
        for bag in bags
    ]

    vehicle = Vehicle(mass=options.mass)
    with interruptible_executor_of(options) as executor, Console(stderr=True).status('identifying'):
        identified = identify(
            *logs,
            vehicle=vehicle,
            integrator=options.integrator,
            bootstrap=options.bootstrap,
            executor=executor,
        )

    width = max(map(len, identified.estimates))
    for name, estimate in identified.estimates.items():
        print(f'{name:{width}}  {estimate!s:32} {estimate.meaning}')  # noqa: T201
    for remark in identified.remarks:
        show(f'- {remark}')
    if path:
        from barc_sim.figures.files import save_figure  # noqa: PLC0415
        from barc_sim.figures.run_figures import identification_figure  # noqa: PLC0415

        title = escaped(', '.join(bag.resolve().name for bag in bags))
        save_figure(path, identification_figure(identified.signals, title=title))


def add_arguments_raceline(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Find the minimum-curvature line on a track, and the speed that it allows.'
    parser.epilog = 'Drive it: `barc acc --track line.csv --speed-profile 3.5 2 --speed 12`'
    parser.add_argument(
        'track', metavar='TRACK', help='as --track of `barc acc`: L, oval, a CSV file, …'
    )
    acceleration = number(1e-3, PROFILE[0].between[1])
    speed = number(1e-3, SPEED.between[1])
    _add_numbers(
        parser,
        ('speed', speed, 12.0, 'M/S', 'maximum speed'),
        ('lateral', acceleration, 3.5, 'M/S²', 'maximum lateral acceleration'),
        ('longitudinal', acceleration, 2.0, 'M/S²', 'maximum longitudinal acceleration'),
        ('margin', number(0.0, 1e3), None, 'M', 'clearance to both edges (a fifth of the width)'),
    )
    parser.add_argument('-o', '--output', metavar='FILE', help='save the line as a track, a .csv')
    parser.add_argument('--save', metavar='FILE', help='save a figure as .png, .pdf or .svg')


def run_raceline(options: Namespace) -> None:
    """Print the lap times, and save the line."""
    from barc_sim.control.planning import lap_time, racing_line, write_line  # noqa: PLC0415 (slow)
    from barc_sim.vehicle.track import Track  # noqa: PLC0415

    output = target(options.output, ('csv',)) if options.output else None
    path = figure_path(options.save)
    track = Track.named(options.track)
    line = racing_line(track, margin=options.margin)

    limits = (options.speed, options.lateral, options.longitudinal)
    for name, path_driven in (('centre line', track), ('racing line', line)):
        seconds = lap_time(path_driven, limits)
        radius = 1.0 / max(map(abs, path_driven.curvatures))
        print(  # noqa: T201
            f'{name}  {seconds:6.2f} s  {path_driven.length:7.1f} m  '
            f'smallest radius {radius:5.1f} m'
        )

    if output:
        with saving(output, '--output') as part:
            write_line(part, track, line, limits)
        show(output)
    if path:
        from barc_sim.figures.files import save_figure  # noqa: PLC0415
        from barc_sim.figures.track_figure import line_figure  # noqa: PLC0415

        save_figure(path, line_figure(track, line, limits))
