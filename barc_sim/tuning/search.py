"""The search for gains, and the scores of closed loops with many of them.

The search is differential evolution, all of a generation at once: Storn and Price, "Differential
evolution: a simple and efficient heuristic for global optimization over continuous spaces", Journal
of Global Optimization 11 (1997), in its variant best/1/bin with dithered weights. It needs no
derivative, which a cost with limits and a road does not have, and it does not stop at local minima
or unstable gains.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim import tuning
from barc_sim.cli.packages import extra
from barc_sim.control.speed import PID, as_controller, set_gains
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import chosen_scenario, drive_scenario
from barc_sim.simulation.metrics import summary
from barc_sim.simulation.rollout import scores_of_gains
from barc_sim.simulation.scenario import LIMITS, Scenario

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import pandas as pd
    from numpy.typing import ArrayLike, NDArray

    from barc_sim.simulation.log import Log

    Floats = NDArray[np.float64]
    Ints = NDArray[np.intp]

#: Significant digits of the gains: the printed gains are those that were driven.
DIGITS = 4
_WEIGHTS = (0.5, 1.0)  # range of a difference's weight, drawn in each generation
_CROSSOVER = 0.7  # probability that a gain changes
#: The search has converged when the costs in the population are this close together.
_TOLERANCE = 1e-4
#: A loop fails to arrive if it takes longer than this many times the expected duration.
_MAX_DURATION_FACTOR = 3.0
#: The names of the scores in a `Sweep`, and their labels.
SCORES = {
    'rms_error': 'RMS speed error [m/s]',
    'max_error': 'Maximum speed error [m/s]',
    'overshoot': 'Overshoot',
    'effort': 'RMS command [m/s²]',
}


class Found(NamedTuple):
    """The result of a search."""

    gains: Floats  #: shape `(3,)`: kp, ki, kd
    cost: float  #: infinite if no gains in the ranges arrive
    evaluations: int


def search(
    cost: Callable[[Floats], Floats],
    low: Floats,
    high: Floats,
    start: Floats,
    *,
    seed: int = 0,
    population: int = 24,
    generations: int = 40,
) -> Found:
    """Return the gains of minimum `cost` between `low` and `high`, shape `(d,)`.

    The same arguments give the same gains. `cost` returns the costs, shape `(n,)`, of gains, shape
    `(n, d)`. `start`, moved between `low` and `high`, is one of the first gains tried. A generation
    has `population` gains, at least 4.
    """
    random = np.random.default_rng(seed)
    places = rounded(_spread(random, population, low, high))
    places[0] = np.clip(start, low, high)
    costs = cost(places)
    evaluations = population
    for _ in range(generations):
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
    """Return a Latin hypercube: one point in each of `number` equal parts of every range."""
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


class Sweep(np.recarray):
    """The scores of many loops, by the names of gains and scores; as many as there are gains."""

    def to_frame(self) -> pd.DataFrame:
        """Return a DataFrame with a row for each loop; needs pandas."""
        frame: pd.DataFrame = extra('pandas', 'to_frame', 'pandas').DataFrame(
            {n: self[n].ravel() for n in self.dtype.names or ()}
        )
        return frame


def sweep(
    kp: ArrayLike | None = None,
    ki: ArrayLike | None = None,
    kd: ArrayLike | None = None,
    *,
    controller: object | None = None,
    scenario: Scenario | None = None,
    **options: Any,  # noqa: ANN401 (of `simulate`)
) -> Sweep:
    """Drive one closed loop for each of the gains, and return the scores of all.

    Each is the run that `simulate` makes with the same arguments. Where Numba is installed
    (`pip install 'barc_sim[fast]'`), those of the PID on a road are compiled, and use all cores.

    Parameters
    ----------
    kp, ki, kd
        Numbers or arrays of gains, broadcast against one another; by default those of `acc`.
    controller
        An object as in `simulate`, in place of the PID. Its gains, by name, are options.
    scenario
        The run but for its gains and its seed, in place of the options; its `max_duration` counts.
    options
        All other arguments of `simulate`. A loop ends after `max_duration`, by default three times
        as long as it should take. `seed` can be an array, too, which is broadcast with the gains:
        `seed=range(1000)` scores a thousand runs that differ in their noise.

    Returns
    -------
    A record array of the broadcast shape. Its fields are the gains, the seed if it is an array, and
    the scores: `rms_error` and `max_error`, of the speed after the first 10 m [m/s], `overshoot`, a
    share of the speed, and `effort`, the RMS command [m/s²]. The scores of a loop that never
    arrives are infinite.

    Raises
    ------
    UserError
        if an argument is out of its limits, as in `simulate`.

    Examples
    --------
    >>> import numpy as np
    >>> found = sweep(kp=np.linspace(1.0, 60.0, 200), ki=20.0, kd=0.0)
    >>> best = found[found.rms_error.argmin()]
    >>> print(f'{best.kp:.1f} {best.rms_error:.3f}')
    60.0 0.037
    >>> many = sweep(kp=30.0, noise=0.1, seed=range(1000))
    >>> print(f'{many.rms_error.mean():.3f} ± {many.rms_error.std():.3f} m/s')
    0.085 ± 0.003 m/s
    """
    if controller is None and scenario is not None:
        controller = scenario.controller or PID(**scenario.gains)
    drives = as_controller(PID() if controller is None else controller)
    held = {name: getattr(drives, name) for name in drives.gains}
    if not held:
        raise UserError('the controller has no gains to sweep: give it attributes such as kp')
    named = {'kp': kp, 'ki': ki, 'kd': kd}
    named |= {name: options.pop(name) for name in held if name in options}
    passed = {name: np.asarray(gain, float) for name, gain in named.items() if gain is not None}
    for bound in (np.min, np.max):
        set_gains(drives, {name: float(bound(gain)) for name, gain in passed.items()})
    if np.ndim(options.get('seed', 0)):
        passed['seed'] = _seeds(options.pop('seed'))
    axes = _broadcast({**held, **passed})
    scenario = _run_of(scenario, options)
    scores = _empty_sweep(axes)
    shape = scores.shape
    plant = scenario.plant()
    if type(drives) is PID and plant.has_fast_path and scenario.reference is None:
        found = scores_of_gains(
            plant,
            np.column_stack([axes[name].ravel() for name in held]),
            scenario.acceleration_limit,
            scenario.speed_reference,
            scenario.distance,
            round(scenario.max_duration / plant.ts),
            axes['seed'].ravel() if 'seed' in axes else None,
        )
        for name, column in zip(SCORES, found.T, strict=True):
            scores[name] = column.reshape(shape)
        return scores

    for i in np.ndindex(shape):
        set_gains(drives, {name: float(axes[name][i]) for name in held})
        seed = int(axes['seed'][i]) if 'seed' in axes else scenario.seed
        log = drive_scenario(replace(scenario, controller=drives, seed=seed))
        for name, score in zip(SCORES, _scores(log, scenario.distance), strict=True):
            scores[name][i] = score
    set_gains(drives, held)
    return scores


def _run_of(scenario: Scenario | None, options: dict[str, Any]) -> Scenario:
    """Return the scenario of a sweep, but for its gains: `scenario`, or the one of the options.

    UserError: the car cannot reach its distance in time.
    """
    chosen = chosen_scenario(scenario, Scenario(**options))
    speed, distance = chosen.speed_reference, chosen.distance
    tuning.SPEED.check(speed)
    tuning.DISTANCE.check(distance)
    if scenario is None and 'max_duration' not in options:
        expected = distance / speed + speed / chosen.acceleration_limit
        longest = LIMITS['max_duration'].between[1]
        chosen = replace(chosen, max_duration=min(_MAX_DURATION_FACTOR * expected, longest))
    return replace(chosen, kp=None, ki=None, kd=None, controller=None)


def _broadcast(values: Mapping[str, ArrayLike]) -> dict[str, NDArray[Any]]:
    """Return the arrays by name, each in the shape of all."""
    return dict(zip(values, np.broadcast_arrays(*values.values()), strict=True))


def _empty_sweep(axes: Mapping[str, NDArray[Any]]) -> Sweep:
    """Return a sweep over these arrays of one shape, whose scores are not set yet."""
    kinds = [(name, axis.dtype) for name, axis in axes.items()]
    kinds += [(name, np.dtype(np.float64)) for name in SCORES]
    shape = next(iter(axes.values())).shape
    scores = np.recarray(shape, dtype=kinds).view(Sweep)
    for name, axis in axes.items():
        scores[name] = axis
    return scores


def _seeds(seeds: ArrayLike) -> Ints:
    """Return seeds as an array of whole numbers; UserError: one is no seed."""
    found = np.asarray(seeds)
    if found.size and not np.issubdtype(found.dtype, np.integer):
        raise UserError(f'seed {seeds!r} must be whole numbers, such as range(1000)')
    for bound in (found.min, found.max):
        if found.size:
            LIMITS['seed'].check(int(bound()))
    return found.astype(np.intp)


def _scores(log: Log, distance: float) -> tuple[float, ...]:
    """Return the scores of a run, which are infinite where it has not arrived."""
    if log.distance[-1] < distance:
        return (np.inf,) * len(SCORES)
    result = summary(log)
    effort = float(np.sqrt(np.mean(np.square(log.motor))))
    return result.rms_error_after_run_up, result.max_error_after_run_up, result.overshoot, effort
