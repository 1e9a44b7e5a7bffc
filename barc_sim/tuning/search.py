"""The search for gains: what it minimises, the scores of closed loops, and how it goes on.

The search is differential evolution, all of a generation at once: Storn and Price, "Differential
evolution: a simple and efficient heuristic for global optimization over continuous spaces", Journal
of Global Optimization 11 (1997), in its variant best/1/bin with dithered weights. It needs no
derivative, which a cost with limits and a road does not have, and it is not caught by local minima
and unstable gains.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.control.speed import PID, as_controller, gain_parameters, speed_controller
from barc_sim.errors import UserError
from barc_sim.simulation.log import import_pandas
from barc_sim.simulation.metrics import summary
from barc_sim.tuning.batch import Course, run_batch
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    import pandas as pd
    from numpy.typing import ArrayLike, NDArray

    from barc_sim.control.speed import Controller
    from barc_sim.simulation.log import Log
    from barc_sim.tuning.batch import Sums

    Floats = NDArray[np.float64]

#: Gains have so many significant digits: what is printed is what was driven.
DIGITS = 4
_WEIGHTS = (0.5, 1.0)  # of a difference, drawn anew in each generation
_CROSSOVER = 0.7  # how probable it is that a gain changes
#: It has converged where the costs in the population are as close together as this.
_TOLERANCE = 1e-4
#: A map reaches this many times as far as the farther of its points, ...
_MARGIN = 2.5
#: ... and over this share of a range at least.
_MIN_SHARE = 0.05


class Scores(NamedTuple):
    """How well loops did, shape `(n,)` each; infinite for those that never arrived."""

    rms: Floats  #: [m/s] RMS speed error after the run-up
    max: Floats  #: [m/s] maximum absolute one
    overshoot: Floats  #: share of the reference by which the first stretch's speed passes it
    effort: Floats  #: [m/s²] RMS of the command, over the whole run


_GAINS = ('kp', 'ki', 'kd')
#: The names of the scores in a `Sweep`, in their order.
_SCORES = ('rms_error', 'max_error', 'overshoot', 'effort')
#: Their labels, in their order.
LABELS = (
    'RMS speed error [m/s]',
    'Maximum speed error [m/s]',
    'Overshoot',
    'RMS command [m/s²]',
)


def scores(course: Course, sums: Sums) -> Scores:
    """Return the scores of loops over `course` with these sums."""
    arrived = sums.steps >= 0

    def where_arrived(values: Floats) -> Floats:
        return np.where(arrived, values, np.inf)

    with np.errstate(divide='ignore', invalid='ignore'):
        return Scores(
            rms=where_arrived(np.sqrt(sums.squares / sums.count)),
            max=where_arrived(sums.maximum),
            overshoot=where_arrived(np.maximum(sums.peak / course.speed_reference - 1.0, 0.0)),
            effort=where_arrived(np.sqrt(sums.effort / (sums.steps + 1))),
        )


class Cost(NamedTuple):
    """A score, and a weight of the effort beside it."""

    score: str = 'rms'  #: one of `Scores`
    effort: float = 0.0  #: weight

    def of(self, scored: Scores) -> Floats:
        """Return what each loop costs, shape `(n,)`."""
        cost: Floats = getattr(scored, self.score)
        # A weight of zero times an infinite score would be NaN.
        return cost + self.effort * scored.effort if self.effort else cost

    @property
    def label(self) -> str:
        """The label of an axis with this cost."""
        return f'Cost: {self}' if self.effort else LABELS[Scores._fields.index(self.score)]

    def __str__(self) -> str:
        """Return the sum in a line."""
        return f'{self.score} + {self.effort:g} effort' if self.effort else self.score


@dataclass(frozen=True)
class Goal:
    """The mean cost over courses; a call with gains returns what each costs."""

    courses: tuple[Course, ...]
    cost: Cost
    #: Makes a controller with the gains kp, ki and kd; without it, the PID drives.
    new_controller: Callable[[], Controller] | None = None

    def scores(self, course: Course, gains: Floats) -> Scores:
        """Return the scores over `course` for `gains`, shape `(n, 3)`: kp, ki, kd."""
        if not self.new_controller:
            return scores(course, run_batch(course, gains))
        return scores_of_runs(course, self.new_controller(), _GAINS, gains)

    def __call__(self, gains: Floats) -> Floats:
        """Return what each of `gains`, shape `(n, 3)`, costs, shape `(n,)`."""
        costs = [self.cost.of(self.scores(course, gains)) for course in self.courses]
        return np.asarray(np.mean(costs, axis=0))

    def log(self, course: Course, gains: Floats) -> Log:
        """Return the run over `course` with `gains`, shape `(3,)`."""
        new = self.new_controller or speed_controller
        return course.drive(with_gains(new(), _GAINS, gains))


def with_gains(controller: Controller, names: Iterable[str], gains: Floats) -> Controller:
    """Return `controller` with these gains."""
    for name, gain in zip(names, gains.tolist(), strict=True):
        setattr(controller, name, gain)
    return controller


def scores_of_runs(
    course: Course,
    controller: Controller,
    names: Iterable[str],
    gains: Floats,
    **options: Any,  # noqa: ANN401 (of `simulate`)
) -> Scores:
    """Return the scores of runs one by one, of `controller` with each row of `gains`."""
    rows = []
    for row in gains:
        log = course.drive(with_gains(controller, names, row), **options)
        rows.append(_scored(log) if log.distance[-1] >= course.distance else (np.inf,) * 4)
    return Scores(*np.array(rows).reshape(-1, len(Scores._fields)).T)


def _scored(log: Log) -> tuple[float, float, float, float]:
    """Return the scores of a run that has arrived."""
    found = summary(log)
    effort = float(np.sqrt(np.mean(np.square(log.motor))))
    return found.rms_error_after_run_up, found.max_error_after_run_up, found.overshoot, effort


class Found(NamedTuple):
    """Where a search ended."""

    gains: Floats  #: shape `(3,)`: kp, ki, kd
    cost: float  #: infinite where no gains in the ranges arrive
    evaluations: int


def search(
    cost: Callable[[Floats], Floats],
    low: Floats,
    high: Floats,
    start: Floats,
    *,
    seed: int = 0,
    population: int = 256,
    generations: int = 80,
    on_generation: Callable[[int, float], object] = lambda *_: None,
) -> Found:
    """Return the gains of minimum `cost` between `low` and `high`, shape `(d,)`.

    The same arguments give the same gains. `cost` returns the costs, shape `(n,)`, of gains, shape
    `(n, d)`. `start`, moved between `low` and `high`, is one of the first gains tried. A generation
    has `population` gains, at least 4. After each, `on_generation` is called with the number of
    those before it and the minimum cost up to now.
    """
    random = np.random.default_rng(seed)
    places = rounded(_spread(random, population, low, high))
    places[0] = np.clip(start, low, high)
    costs = cost(places)
    evaluations = population
    for generation in range(generations):
        on_generation(generation, float(costs.min()))
        if _converged(costs):
            break
        trials = rounded(np.clip(_trials(random, places, costs), low, high))
        trial_costs = cost(trials)
        evaluations += population
        better = trial_costs <= costs
        places[better], costs[better] = trials[better], trial_costs[better]
    best = np.argmin(costs)
    return Found(places[best], float(costs[best]), evaluations)


def rounded(gains: Floats) -> Floats:
    """Return `gains` with `DIGITS` significant digits."""
    return np.array([float(f'{gain:.{DIGITS}g}') for gain in gains.flat]).reshape(gains.shape)


def _spread(random: np.random.Generator, number: int, low: Floats, high: Floats) -> Floats:
    """Return a Latin hypercube: one in each of `number` equal parts of every range."""
    parts = np.column_stack([random.permutation(number) for _ in low])
    return low + (parts + random.random(parts.shape)) / number * (high - low)


def _trials(random: np.random.Generator, places: Floats, costs: Floats) -> Floats:
    """Return a rival for each of `places`."""
    number, gains = places.shape
    weight = random.uniform(*_WEIGHTS)
    # Two others, neither the same nor the one itself.
    one = (np.arange(number) + random.integers(1, number, number)) % number
    other = (one + random.integers(1, number - 1, number)) % number
    other = np.where(other == np.arange(number), (other + 1) % number, other)
    other = np.where(other == one, (other + 1) % number, other)
    mutants = places[np.argmin(costs)] + weight * (places[one] - places[other])
    crossed = random.random(places.shape) < _CROSSOVER
    crossed[np.arange(number), random.integers(0, gains, number)] = True
    return np.where(crossed, mutants, places)


def _converged(costs: Floats) -> bool:
    minimum, maximum = costs.min(), costs.max()
    return bool(np.isfinite(maximum)) and bool(maximum - minimum <= _TOLERANCE * abs(minimum))


class Surface(NamedTuple):
    """The cost over a grid of two gains; the third is that of the found point."""

    axes: tuple[int, int]  #: which gains: 0, 1 or 2 for kp, ki or kd
    right: Floats  #: those of the first, shape `(m,)`
    up: Floats  #: those of the second, shape `(n,)`
    cost: Floats  #: shape `(n, m)`; infinite where the car never arrives


def free_axes(low: Floats, high: Floats) -> tuple[int, int]:
    """Return the first two gains whose ranges are wider than a point."""
    free = np.flatnonzero(low < high)
    if len(free) < 2:  # noqa: PLR2004 (a map's)
        raise UserError(
            'the figure of --save is a map over two gains: give two of --kp-range, --ki-range and '
            '--kd-range a width'
        )
    return int(free[0]), int(free[1])


def surface(
    cost: Callable[[Floats], Floats],
    low: Floats,
    high: Floats,
    start: Floats,
    found: Floats,
    size: int,
) -> Surface:
    """Return the cost of `size` x `size` gains, in the plane of `found`.

    No more of the ranges from `low` to `high` is taken than shows both points well.
    """
    axes = free_axes(low, high)
    far = np.maximum(_MARGIN * np.maximum(start, found), low + _MIN_SHARE * (high - low))
    high = np.minimum(high, far)
    right, up = (np.linspace(low[axis], high[axis], size) for axis in axes)
    gains = np.tile(found, (size * size, 1))
    for axis, grid in zip(axes, np.meshgrid(right, up), strict=True):
        gains[:, axis] = grid.ravel()
    return Surface(axes, right, up, cost(gains).reshape(size, size))


class Sweep(np.recarray):
    """The scores of many loops, by the names of gains and scores; as many as there are gains."""

    def to_frame(self) -> pd.DataFrame:
        """Return a DataFrame with a row for each loop; needs pandas."""
        frame: pd.DataFrame = import_pandas().DataFrame(
            {n: self[n].ravel() for n in self.dtype.names or ()}
        )
        return frame


def sweep(
    kp: ArrayLike | None = None,
    ki: ArrayLike | None = None,
    kd: ArrayLike | None = None,
    *,
    controller: object | None = None,
    **options: Any,  # noqa: ANN401 (of `simulate`)
) -> Sweep:
    """Drive one closed loop for each of the gains, and return the scores of all.

    Each is the run that `simulate` makes with the same arguments. Loops of the PID whose delay is
    a multiple of the step are driven all at once: 10,000 take some seconds.

    Parameters
    ----------
    kp, ki, kd
        Numbers or arrays of gains, broadcast against one another; those of `acc` where not given.
    controller
        An object as in `simulate`, in the place of the PID. Its gains, by name, are options.
    options
        All other arguments of `simulate`. A loop ends after `max_duration`, by default three times
        as long as it should take.

    Returns
    -------
    A record array of the broadcast shape. Its fields are the gains and the scores: `rms_error` and
    `max_error`, of the speed after the first 10 m [m/s], `overshoot`, a share of the speed, and
    `effort`, the RMS command [m/s²]. The scores of a loop that never arrives are infinite.

    Raises
    ------
    UserError
        where an argument is out of its limits, as in `simulate`.

    Examples
    --------
    >>> import numpy as np
    >>> found = sweep(kp=np.linspace(1.0, 60.0, 200), ki=20.0, kd=0.0)
    >>> best = found[found.rms_error.argmin()]
    >>> print(f'{best.kp:.1f} {best.rms_error:.3f}')
    60.0 0.037
    """
    drives = PID() if controller is None else deepcopy(as_controller(controller))
    given = {'kp': kp, 'ki': ki, 'kd': kd} | {
        name: options.pop(name) for name in drives.gains if name in options
    }
    axes = _axes(drives, {name: gain for name, gain in given.items() if gain is not None})
    options['road'] = Road.of(options.get('road', 'lab'))
    of_course = {
        each.name: options.pop(each.name) for each in fields(Course) if each.name in options
    }
    course = Course(**of_course)
    rows = np.column_stack([axis.ravel() for axis in axes.values()])
    if controller is None and not options and course.is_batchable:
        found = scores(course, run_batch(course, rows))
    else:
        found = scores_of_runs(course, drives, axes, rows, **options)
    columns = axes | dict(zip(_SCORES, found, strict=True))
    shape = next(iter(axes.values())).shape
    record = np.recarray(shape, dtype=[(name, np.float64) for name in columns]).view(Sweep)
    for name, column in columns.items():
        record[name] = column.reshape(shape)
    return record


def _axes(controller: Controller, given: Mapping[str, ArrayLike]) -> dict[str, Floats]:
    """Return all gains of `controller`, in the broadcast shape, with those that are `given`."""
    axes = {}
    for row in gain_parameters(controller):
        axes[row.name] = np.asarray(given.get(row.name, row.default), dtype=np.float64)
        for bound in (axes[row.name].min(), axes[row.name].max()):
            row.check(bound)
    if unknown := ', '.join(given.keys() - axes.keys()):
        raise UserError(f'{unknown}: the controller has no such gain, but {", ".join(axes)}')
    return dict(zip(axes, np.broadcast_arrays(*axes.values()), strict=True))
