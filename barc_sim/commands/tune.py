"""Searches the gains that hold the speed best."""

from __future__ import annotations

import shlex
import sys
import time
from contextlib import contextmanager
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.files import FIGURE_DPI, FIGURES, saving, target
from barc_sim.cli.parser import barc_path, number, whole
from barc_sim.control.speed import KD, KI, KP, SPEED_REFERENCE
from barc_sim.errors import UserError
from barc_sim.tuning import DISTANCE, SPEED
from barc_sim.vehicle.parameters import ROWS

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Iterator, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.cli.parser import Parser
    from barc_sim.tuning.batch import Course
    from barc_sim.tuning.search import Goal, Surface

    Floats = NDArray[np.float64]

#: Population, generations and points along a side of the map: for the PID, whose loops run as one
#: batch, and for user code, whose loops run one by one.
_BATCHED = (256, 80, 101)
_USER_CODE = (24, 40, 25)
#: By gain: the first guess, and the end of the searched range, which begins at zero.
GAINS = {'kp': (KP, 100.0), 'ki': (KI, 4000.0), 'kd': (KD, 2.0)}
_ROAD = 'lab'
_PERIOD = 0.02  #: [s] of a step
_MAX_GAIN = 1e6
#: Of the scores, in their order.
_FORMS = ('.4f', '.4f', '.2%', '.3f')


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Search the gains that hold the speed best.'
    parser.add_argument(
        '--cost',
        choices=('rms', 'max', 'overshoot', 'effort'),
        default='rms',
        help='what to minimise: rms or max, the speed error after the first 10 m [m/s]; '
        'overshoot, a share of the speed; or effort, the RMS command [m/s²] (rms)',
    )
    parser.add_argument(
        '--effort',
        type=number(0.0, _MAX_GAIN),
        default=0.0,
        metavar='WEIGHT',
        help='add this times the effort to the cost (0)',
    )
    parser.add_argument(
        '--road',
        nargs='+',
        action='extend',
        metavar='ROAD',
        help="'lab', 'flat', or CSV files with the columns start_m,grade_deg; of several, the mean "
        f'cost counts ({_ROAD})',
    )
    parser.add_argument(
        '--speed', type=number(*SPEED.between), default=SPEED_REFERENCE, metavar='M/S', help='(8)'
    )
    parser.add_argument(
        '--distance',
        type=number(*DISTANCE.between),
        default=DISTANCE.default,
        metavar='M',
        help='(180)',
    )
    parser.add_argument(
        '--noise',
        type=number(*ROWS['noise_v_x'].between),
        default=0.0,
        metavar='M/S',
        help="standard deviation of the measured speed's noise (0)",
    )
    parser.add_argument(
        '--delay',
        type=whole(0, 500),
        default=0,
        metavar='STEPS',
        help='of 20 ms, from a command to its effect (0)',
    )
    _add_gains(parser)
    parser.add_argument(
        '--seed',
        type=whole(*ROWS['seed'].between),
        default=0,
        metavar='N',
        help="of the search and of the noise; the noise is then that of a run's --seed (0)",
    )
    parser.add_argument(
        '--controller', type=Path, metavar='FILE', help='tune the class PID of this file'
    )
    parser.add_argument(
        '--save', metavar='FILE', help='draw a map of the cost, and the runs: .png, .pdf or .svg'
    )


def _add_gains(parser: Parser) -> None:
    for gain, (start, high) in GAINS.items():
        gain_type = number(0.0, _MAX_GAIN)
        parser.add_argument(
            f'--{gain}',
            type=gain_type,
            default=start,
            metavar='GAIN',
            help=f'to begin with ({start:g})',
        )
        parser.add_argument(
            f'--{gain}-range',
            type=gain_type,
            nargs=2,
            default=(0.0, high),
            metavar=('LOW', 'HIGH'),
            help=f'(0 to {high:g}); the same number twice holds it there',
        )


def run(options: Namespace) -> None:
    """Search, and print the gains with the lines to run them."""
    import numpy as np  # noqa: PLC0415 (slow: not for --help)

    from barc_sim.tuning import search  # noqa: PLC0415

    began = time.monotonic()
    path = target(options.save, FIGURES) if options.save is not None else None
    low, high = _ranges(options)
    if path:
        search.free_axes(low, high)
    start = np.array([getattr(options, gain) for gain in GAINS])
    goal = _goal(options)
    goal(start[np.newaxis])  # a mistake in the controller is reported from here
    population, generations, points = _USER_CODE if options.controller else _BATCHED
    with _progress(generations) as show:
        best = search.search(
            goal,
            low,
            high,
            start,
            seed=options.seed,
            population=population,
            generations=generations,
            on_generation=show,
        )
    if not np.isfinite(best.cost):
        raise UserError(
            f'no gains in these ranges drive {options.distance:g} m within '
            f'{goal.courses[0].max_duration:.0f} s on every road: widen the ranges, or choose '
            'roads that the car can climb'
        )
    plane = search.surface(goal, low, high, start, best.gains, points) if path else None
    took = time.monotonic() - began
    for course in goal.courses:
        _print_scores(goal, course, {'start': start, 'found': best.gains})
    print(f'{best.evaluations} closed loops per road in {took:.1f} s; to run it:')  # noqa: T201
    for command in _commands(options, best.gains.tolist()):
        print(command)  # noqa: T201
    if path and plane:
        _draw(path, plane, goal, (start, best.gains), _settings(options))
        print(path)  # noqa: T201


def _goal(options: Namespace) -> Goal:
    """Return the goal of a search with `options`."""
    from barc_sim.lab.user_code.adapters import controller_of  # noqa: PLC0415
    from barc_sim.tuning.batch import Course  # noqa: PLC0415
    from barc_sim.tuning.search import Cost, Goal  # noqa: PLC0415
    from barc_sim.vehicle.road import Road  # noqa: PLC0415 (--help need not wait for NumPy)

    courses = tuple(
        Course(
            road=Road.named(name),
            speed_reference=options.speed,
            distance=options.distance,
            noise=options.noise,
            seed=options.seed,
            delay=options.delay * _PERIOD,
        )
        for name in options.road or [_ROAD]
    )
    new = partial(controller_of, options.controller) if options.controller else None
    return Goal(courses, Cost(options.cost, options.effort), new)


def _ranges(options: Namespace) -> tuple[Floats, Floats]:
    """Return the minimum and maximum gains, shape `(3,)` each."""
    import numpy as np  # noqa: PLC0415

    for gain in GAINS:
        low, high = getattr(options, f'{gain}_range')
        if low > high:
            raise UserError(f'--{gain}-range {low:g} {high:g} must have the lower number first')
    low, high = np.array([getattr(options, f'{gain}_range') for gain in GAINS]).T
    return low, high


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


def _settings(options: Namespace) -> str:
    """Return the conditions of the loops in a line."""
    parts = [f'road {", ".join(options.road or [_ROAD])}', f'{options.speed:g} m/s']
    if options.noise:
        parts.append(f'noise {options.noise:g} m/s')
    if options.delay:
        parts.append(f'delay {options.delay} steps')
    if options.controller:
        parts.append(str(options.controller))
    return ' · '.join(parts)


@contextmanager
def _progress(generations: int) -> Iterator[Callable[[int, float], None]]:
    """Show a search's progress on stderr where that is a terminal."""
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: PLC0415

    shown = Progress(
        BarColumn(bar_width=24),
        TextColumn('{task.description}'),
        TimeElapsedColumn(),
        console=Console(stderr=True, highlight=False),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    task = shown.add_task('searching', total=generations)

    def show(generation: int, cost: float) -> None:
        minimum = f'minimum cost {cost:.4g}' if isfinite(cost) else 'none arrives yet'
        description = f'generation {generation} of at most {generations}, {minimum}'
        shown.update(task, completed=generation, description=description)

    with shown:
        yield show


def _print_scores(goal: Goal, course: Course, gains: dict[str, Floats]) -> None:
    """Print a table of the scores and costs over `course` of gains, shape `(3,)`, by name."""
    import numpy as np  # noqa: PLC0415
    from rich.console import Console  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    from barc_sim.tuning.search import LABELS  # noqa: PLC0415

    scores = goal.scores(course, np.array(list(gains.values())))
    table = Table(box=None, pad_edge=False)
    table.add_column(f'road {course.road.name}')
    for name in gains:
        table.add_column(name, justify='right')
    for axis, gain in enumerate(GAINS):
        table.add_row(gain, *(_typed(each[axis]) for each in gains.values()))
    for label, form, values in zip(LABELS, _FORMS, scores, strict=True):
        table.add_row(label, *(_figure(value, form) for value in values))
    table.add_row(f'cost: {goal.cost}', *(_figure(cost, '.5g') for cost in goal.cost.of(scores)))
    Console(highlight=False, markup=False).print(table)


def _figure(value: float, form: str) -> str:
    return format(value, form) if isfinite(value) else '–'  # noqa: RUF001 (what tables have there)


def _draw(
    path: Path, plane: Surface, goal: Goal, gains: tuple[Floats, Floats], settings: str
) -> None:
    from barc_sim.figures.tuning_figures import Point, tuning_figure  # noqa: PLC0415

    start, best = (Point(each, goal.log(goal.courses[0], each)) for each in gains)
    figure = tuning_figure(
        plane,
        start,
        best,
        cost=goal.cost.label,
        title=f'Gains for the minimum {goal.cost}',
        settings=settings,
    )
    with saving(path) as part:
        figure.savefig(part, dpi=FIGURE_DPI)
