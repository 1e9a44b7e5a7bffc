"""The search for gains, and the scores of closed loops with many of them.

The search is differential evolution, all of a generation at once: Storn and Price, "Differential
evolution: a simple and efficient heuristic for global optimization over continuous spaces", Journal
of Global Optimization 11 (1997), in its variant best/1/bin with dithered weights. It needs no
derivative, which a cost with limits and a road does not have, and it does not stop at local minima
or unstable gains.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from math import sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim import tuning
from barc_sim.cli.packages import extra
from barc_sim.control.cruise_control import SPEED
from barc_sim.control.lane import LANE, LaneLQR, SpeedProfile
from barc_sim.control.pilots import LaneKeeping, as_lane_pilot, as_pilot
from barc_sim.control.speed import PID, check_values
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import chosen_scenario, drive_scenario
from barc_sim.simulation.law_runs import LawRuns, laws_of
from barc_sim.simulation.rollout import scores_of_gains
from barc_sim.simulation.scenario import LIMITS, Scenario
from barc_sim.simulation.scores import scores_of_log
from barc_sim.vehicle.parameters import needs_track

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    import pandas as pd
    from numpy.typing import ArrayLike, NDArray

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
#: Those that a sweep on a track has in addition.
LANE_SCORES = {
    'rms_e_y': 'RMS distance from the centre line [m]',
    'max_e_y': 'Maximum distance from the centre line [m]',
    'best_lap': 'Best lap [s]',
}


class SearchResult(NamedTuple):
    """The best gains of a search."""

    gains: Floats  #: shape `(d,)`
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
) -> SearchResult:
    """Return the gains of minimum cost; the same arguments give the same gains.

    Parameters
    ----------
    cost
        A function that returns the costs, shape `(n,)`, of gains, shape `(n, d)`.
    low, high
        The ends of the range of each gain, shape `(d,)`.
    start
        One of the first gains that are tried, moved into the ranges; shape `(d,)`.
    seed
        of the random numbers.
    population
        number of gains of a generation, at least 4.
    generations
        after which the search ends, unless it has converged before.

    Returns
    -------
    SearchResult
        The best gains, with `DIGITS` significant digits.
    """
    random = np.random.default_rng(seed)
    places = rounded(_spread(random, population, low, high))
    places[0] = np.clip(start, low, high)
    costs = cost(places)
    evaluations = population

    for _ in range(generations):
        if _has_converged(costs):
            break
        trials = rounded(np.clip(_trials(random, places, costs), low, high))
        trial_costs = cost(trials)
        evaluations += population
        is_better = trial_costs <= costs
        places[is_better] = trials[is_better]
        costs[is_better] = trial_costs[is_better]

    best = np.argmin(costs)
    return SearchResult(places[best], float(costs[best]), evaluations)


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
    low, high = _WEIGHTS
    weight = random.uniform(low, high)

    # Two others, neither the same nor the one itself.
    one = (np.arange(number) + random.integers(1, number, number)) % number
    other = (one + random.integers(1, number - 1, number)) % number
    other = np.where(other == np.arange(number), (other + 1) % number, other)
    other = np.where(other == one, (other + 1) % number, other)

    mutants = places[np.argmin(costs)] + weight * (places[one] - places[other])
    crossed = random.random(places.shape) < _CROSSOVER
    crossed[np.arange(number), random.integers(0, gains, number)] = True  # at least one gain
    return np.where(crossed, mutants, places)


def _has_converged(costs: Floats) -> bool:
    """Return whether the costs of a population are close together."""
    minimum = costs.min()
    maximum = costs.max()
    return bool(np.isfinite(maximum)) and bool(maximum - minimum <= _TOLERANCE * abs(minimum))


class Sweep(np.recarray):
    """The scores of many loops, by the names of gains and scores; as many as there are gains."""

    def to_frame(self) -> pd.DataFrame:
        """Return a DataFrame with a row for each loop.

        Raises
        ------
        UserError
            if pandas is not installed.
        """
        pandas = extra('pandas', 'to_frame', 'pandas')
        names = self.dtype.names or ()
        frame: pd.DataFrame = pandas.DataFrame({name: self[name].ravel() for name in names})
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

    Each is the run that `simulate` makes with the same arguments, or with `laps` the one that `lap`
    makes. Where Numba is installed (`pip install 'barc_sim[fast]'`), the runs of the controllers
    `PID` and `LQR`, and on a track of the laws `LaneLQR`, `Stanley` and `PurePursuit`, are
    compiled, and use all cores. Your own controllers and models drive in Python.

    Parameters
    ----------
    kp, ki, kd
        Numbers or arrays of gains, broadcast against one another; by default those of `acc`.
    controller
        An object as in `simulate`, in place of the PID. Its gains, by name, are options.
    scenario
        The run but for its gains and its seed, in place of the options; its `max_duration` counts.
    options
        All other arguments of `simulate`, the gains of `lane` by name, and `laps`, the number of
        laps of a `track`, which end the run in place of the distance. A loop ends after
        `max_duration`, by default three times as long as it should take. `seed` can be an array,
        too, which is broadcast with the gains: `seed=range(1000)` scores a thousand runs that
        differ in their noise.

    Returns
    -------
    Sweep
        A record array of the broadcast shape. Its fields are the gains, the seed if it is an array,
        and the scores: `rms_error` and `max_error`, of the speed after the first 10 m [m/s],
        `overshoot`, a share of the speed, and `effort`, the RMS command [m/s²]. On a track there
        are `rms_e_y` and `max_e_y`, of the distance from the centre line [m], and `best_lap` [s],
        too. The scores of a loop that never arrives are infinite. A gain of `lane` whose name is
        one of the controller's has the field `lane.NAME`.

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
    >>> from barc_sim import Stanley
    >>> laps = sweep(track='oval', laps=2, lane=Stanley(), k=[0.5, 2.0, 8.0])
    >>> print([f'{each:.2f} m' for each in laps.max_e_y])
    ['0.10 m', '0.15 m', '0.16 m']
    """
    if controller is None:
        controller = PID() if scenario is None else scenario.controller or PID(**scenario.gains)
    speed = as_pilot(controller)
    lane = _lane_of(scenario, options)
    pilot = LaneKeeping(speed, as_lane_pilot(deepcopy(lane)))
    names = _fields_of(pilot)
    if not names:
        raise UserError('the controller has no gains to sweep: give it attributes such as kp')

    arguments = {'kp': kp, 'ki': ki, 'kd': kd}
    for name, full_name in names.items():
        for key in {name, full_name} & options.keys():
            arguments[name] = options.pop(key)

    present = pilot.gain_values
    axes: dict[str, Any] = {name: present[full_name] for name, full_name in names.items()}
    axes |= _checked(pilot, names, arguments)
    if np.ndim(options.get('seed', 0)):
        axes['seed'] = _seeds(options.pop('seed'))
    axes = _broadcast(axes)

    scenario = replace(_run_of(scenario, options), lane=lane)
    gains = {full_name: axes[name].ravel() for name, full_name in names.items()}
    seeds = axes['seed'].ravel() if 'seed' in axes else None
    scores = _scores_by_laws(scenario, pilot, gains, seeds)
    if scores is None:
        scores = _scores_in_python(scenario, pilot, gains, seeds)
    return _swept(axes, SCORES | LANE_SCORES if scenario.track else SCORES, scores)


def _checked(
    pilot: LaneKeeping, names: Mapping[str, str], arguments: Mapping[str, ArrayLike | None]
) -> dict[str, Floats]:
    """Return the gains among the arguments, as arrays by the names of their fields.

    UserError: the pilot has no such gain, or a value is beyond its limits.
    """
    gains = {
        name: np.asarray(gain, np.float64) for name, gain in arguments.items() if gain is not None
    }
    for name, gain in gains.items():
        full_name = names.get(name, name)
        if gain.size:
            check_values(pilot.gains, {full_name: float(gain.min())})
            check_values(pilot.gains, {full_name: float(gain.max())})
    return gains


def _lane_of(scenario: Scenario | None, options: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Return what steers: as in `lap`, a `LaneLQR` does so in laps on a track."""
    if scenario is not None:
        lane = scenario.lane
        has_laps = scenario.laps and scenario.track
    else:
        lane = options.get('lane')
        has_laps = options.get('laps') and options.get('track')
    return LaneLQR() if has_laps and lane is None else lane


def _fields_of(pilot: LaneKeeping) -> dict[str, str]:
    """Return the names of a pilot's gains by those of their fields in a `Sweep`."""
    names = {name: name for name in pilot.speed.gains}
    for name in pilot.lane.gains:
        names[LANE + name if name in names else name] = LANE + name
    return names


def _run_of(scenario: Scenario | None, options: dict[str, Any]) -> Scenario:
    """Return the scenario of a sweep, but for its gains: `scenario`, or the one of the options.

    UserError: the car cannot reach its distance in time.
    """
    if options.get('laps'):
        options = {'distance': 0.0, **options}
    chosen = chosen_scenario(scenario, Scenario(**options))
    speed = chosen.speed_reference
    if chosen.laps > 1 and not chosen.track:
        raise needs_track(f'laps={chosen.laps}')
    end = chosen.end if chosen.laps else chosen.distance
    tuning.SPEED.check(speed)
    tuning.DISTANCE.check(end)

    if scenario is None and 'max_duration' not in options:
        expected = end / speed + speed / chosen.acceleration_limit
        longest = LIMITS['max_duration'].between[1]
        chosen = replace(chosen, max_duration=min(_MAX_DURATION_FACTOR * expected, longest))
    return replace(chosen, kp=None, ki=None, kd=None, controller=None)


def _scores_by_laws(
    scenario: Scenario, pilot: LaneKeeping, gains: Mapping[str, Floats], seeds: Ints | None
) -> Floats | None:
    """Return the scores of runs with these gains, by name, of the loops that call laws.

    None: something that is no law of ours decides, or moves the car.
    """
    plant = scenario.plant()
    limit = scenario.acceleration_limit
    laws = laws_of(pilot.speed, pilot.lane, limit)
    reference = _reference_of(scenario)
    if laws is None or reference is None or not plant.has_laws:
        return None

    of_speed = np.column_stack([gains[name] for name in pilot.speed.gains])
    steps = round(scenario.max_duration / plant.ts)
    if plant.has_fast_path and not laws.speed.is_lqr and not isinstance(reference, SpeedProfile):
        return scores_of_gains(plant, of_speed, limit, reference, scenario.end, steps, seeds)
    of_lane = [gains[LANE + name] for name in pilot.lane.gains]
    runs = LawRuns(plant, laws, reference, scenario.end, steps)
    return runs.scores(of_speed, np.column_stack([*of_lane]) if of_lane else None, seeds)


def _reference_of(scenario: Scenario) -> float | SpeedProfile | None:
    """Return the speed to hold [m/s] as loops take it; None: it is a function of the user's."""
    reference = scenario.reference
    if reference is None:
        return scenario.speed_reference
    if isinstance(reference, SpeedProfile) and reference.track == scenario.track:
        fastest = sqrt(max(reference.columns.squares))
        return reference if fastest <= SPEED.between[1] else None
    return None


def _scores_in_python(
    scenario: Scenario, pilot: LaneKeeping, gains: Mapping[str, Floats], seeds: Ints | None
) -> Floats:
    """Return the scores of runs with these gains, by name, with any controller and model."""
    speed = pilot.speed
    before = speed.gain_values
    scores = []
    try:
        for i in range(len(next(iter(gains.values())))):
            steering = as_lane_pilot(deepcopy(scenario.lane))
            LaneKeeping(speed, steering).set_gains(
                {name: float(values[i]) for name, values in gains.items()}
            )
            seed = scenario.seed if seeds is None else int(seeds[i])
            run = replace(scenario, controller=speed, seed=seed)
            if scenario.lane is not None:
                run = replace(run, lane=steering)
            scores.append(scores_of_log(drive_scenario(run), scenario.end))
    finally:
        speed.set_gains(before)
    return np.array(scores)


def _broadcast(values: Mapping[str, ArrayLike]) -> dict[str, NDArray[Any]]:
    """Return the arrays by name, each in the shape of all."""
    return dict(zip(values, np.broadcast_arrays(*values.values()), strict=True))


def _swept(axes: Mapping[str, NDArray[Any]], names: Iterable[str], scores: Floats) -> Sweep:
    """Return a sweep over arrays of one shape, with the scores of these names, in columns."""
    shape = next(iter(axes.values())).shape
    columns = scores.reshape(-1, len([*names])).T
    fields = {**axes, **dict(zip(names, columns, strict=True))}
    kinds = [(name, values.dtype) for name, values in fields.items()]
    swept = np.recarray(shape, dtype=kinds).view(Sweep)
    for name, values in fields.items():
        swept[name] = values.reshape(shape)
    return swept


def _seeds(seeds: ArrayLike) -> Ints:
    """Return seeds as an array of whole numbers; UserError: one is no seed."""
    numbers = np.asarray(seeds)
    if numbers.size:
        if not np.issubdtype(numbers.dtype, np.integer):
            raise UserError(f'seed {seeds!r} must be whole numbers, such as range(1000)')
        LIMITS['seed'].check(int(numbers.min()))
        LIMITS['seed'].check(int(numbers.max()))
    return numbers.astype(np.intp)
