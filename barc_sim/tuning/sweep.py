"""The scores of closed loops with many gains, or many seeds of the noise.

Each run is the one that `simulate` or `lap` makes. Laws of ours are compiled; what a user has
written drives in Python. An executor shares the runs among processes or machines, in pieces of
about a second.
"""

from __future__ import annotations

import time
from copy import deepcopy
from dataclasses import dataclass, replace
from math import prod, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim import tuning
from barc_sim.cli.files import saving
from barc_sim.cli.packages import extra
from barc_sim.control.cruise_control import SPEED
from barc_sim.control.lane import LANE, LaneLQR, SpeedProfile
from barc_sim.control.pilots import LaneKeeping, as_lane_pilot, as_pilot
from barc_sim.control.speed import PID, check_values
from barc_sim.errors import UserError
from barc_sim.parallel.pieces import PieceSizes, finished_pieces, result_of, workers_of
from barc_sim.simulation.closed_loop import chosen_scenario, drive_scenario
from barc_sim.simulation.law_runs import LawRuns, laws_of
from barc_sim.simulation.rollout import scores_of_gains
from barc_sim.simulation.scenario import LIMITS, Scenario
from barc_sim.simulation.scores import scores_of_log
from barc_sim.vehicle.parameters import needs_track

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from concurrent.futures import Executor

    import pandas as pd
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.intp]

#: A loop fails to arrive if it takes longer than this many times the expected duration.
_MAX_DURATION_FACTOR = 3.0
_PART = 2**17  #: runs that this process makes at a time where it must not keep all scores
_ROWS = 2**20  #: runs in a row group of a Parquet file
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
    executor: Executor | None = None,
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
    executor
        Makes the runs, in pieces of about a second: any executor of `concurrent.futures`, such as a
        `ProcessPoolExecutor`, or `Client.get_executor()` of Dask for many machines. The scores are
        the same, to the last bit. By default this process makes them.
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
        if an argument is out of its limits, as in `simulate`; or a controller cannot be sent to
        another process, or that process ends.

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
    runs = _runs_of({'kp': kp, 'ki': ki, 'kd': kd}, controller, scenario, options)
    scores = np.empty((runs.count, len(runs.scores)))
    for part, of_part in _scored(runs, executor):
        scores[part.start : part.stop] = of_part
    return runs.as_sweep(scores)


def sweep_to_parquet(
    path: Path | str,
    kp: ArrayLike | None = None,
    ki: ArrayLike | None = None,
    kd: ArrayLike | None = None,
    *,
    controller: object | None = None,
    scenario: Scenario | None = None,
    executor: Executor | None = None,
    **options: Any,  # noqa: ANN401 (of `simulate`)
) -> int:
    """Drive the closed loops of `sweep`, write their scores to a Parquet file, return their number.

    The file has a row for each run, in the order of `Sweep.to_frame`, and the same bytes however
    the work was shared. Rows are written as they are ready, so that a hundred million runs need no
    more memory than a million.

    Parameters
    ----------
    path
        The file, which is replaced when all is written.
    kp, ki, kd, controller, scenario, executor, options
        As of `sweep`.

    Raises
    ------
    UserError
        as `sweep` does; or pyarrow is not installed, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sweep_to_parquet(f'{folder}/scores.parquet', kp=[10.0, 20.0, 30.0], noise=0.1)
    3
    """
    parquet = extra('pyarrow.parquet', 'sweep_to_parquet', 'cluster')
    arrow = extra('pyarrow', 'sweep_to_parquet', 'cluster')
    runs = _runs_of({'kp': kp, 'ki': ki, 'kd': kd}, controller, scenario, options)

    with saving(Path(path), 'path') as part:
        schema = arrow.table(runs.columns(range(0), np.empty((0, len(runs.scores))))).schema
        with parquet.ParquetWriter(part, schema) as writer:
            for rows, scores in _in_groups(_scored(runs, executor, ordered=True)):
                writer.write_table(arrow.table(runs.columns(rows, scores)))
    return runs.count


class _Piece(NamedTuple):
    """Some of the runs of a sweep, as they are sent to a worker."""

    scenario: Scenario
    pilot: LaneKeeping
    gains: dict[str, Floats]  #: by full name, shape `(n,)`
    seeds: Ints | None  #: shape `(n,)`
    runs: range  #: their numbers in the sweep


@dataclass(frozen=True)
class _Runs:
    """The runs of a sweep: what they have in common, and their gains and seeds."""

    scenario: Scenario
    pilot: LaneKeeping
    full_names: Mapping[str, str]  #: of the gains, by the names of their fields
    #: The gains, and the seed if it is an array, by field; broadcast against one another, which
    #: takes no memory.
    axes: Mapping[str, NDArray[Any]]

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the sweep."""
        return next(iter(self.axes.values())).shape

    @property
    def count(self) -> int:
        """The number of runs."""
        return prod(self.shape)

    @property
    def scores(self) -> list[str]:
        """The names of the scores."""
        return list(SCORES | LANE_SCORES if self.scenario.track else SCORES)

    def piece(self, runs: range) -> _Piece:
        """Return the runs with these numbers."""
        axes = self._axes_of(runs)
        return _Piece(
            self.scenario,
            self.pilot,
            {full_name: axes[name] for name, full_name in self.full_names.items()},
            axes.get('seed'),
            runs,
        )

    def _axes_of(self, runs: range) -> dict[str, NDArray[Any]]:
        """Return the gains and seeds of the runs with these numbers."""
        return {name: values.flat[runs.start : runs.stop] for name, values in self.axes.items()}

    def columns(self, runs: range, scores: Floats) -> dict[str, NDArray[Any]]:
        """Return gains, seeds and scores of the runs with these numbers, by the names of fields."""
        return self._axes_of(runs) | dict(zip(self.scores, scores.T, strict=True))

    def as_sweep(self, scores: Floats) -> Sweep:
        """Return the sweep, with the scores of all runs, a row for each."""
        fields = self.columns(range(self.count), scores)
        kinds = [(name, values.dtype) for name, values in fields.items()]
        swept = np.recarray(self.shape, dtype=kinds).view(Sweep)
        for name, values in fields.items():
            swept[name] = values.reshape(self.shape)
        return swept


def _runs_of(
    gains: Mapping[str, ArrayLike | None],
    controller: object | None,
    scenario: Scenario | None,
    options: dict[str, Any],
) -> _Runs:
    """Return the runs that the arguments of `sweep` ask for; UserError: one is out of limits."""
    if controller is None:
        controller = PID() if scenario is None else scenario.controller or PID(**scenario.gains)
    speed = as_pilot(controller)
    lane = _lane_of(scenario, options)
    pilot = LaneKeeping(speed, as_lane_pilot(deepcopy(lane)))
    names = _fields_of(pilot)
    if not names:
        raise UserError('the controller has no gains to sweep: give it attributes such as kp')

    arguments = dict(gains)
    for name, full_name in names.items():
        for key in {name, full_name} & options.keys():
            arguments[name] = options.pop(key)

    present = pilot.gain_values
    axes: dict[str, Any] = {name: present[full_name] for name, full_name in names.items()}
    axes |= _checked(pilot, names, arguments)
    if np.ndim(options.get('seed', 0)):
        axes['seed'] = _seeds(options.pop('seed'))

    chosen = replace(_run_of(scenario, options), lane=lane)
    return _Runs(chosen, pilot, names, _broadcast(axes))


def _scored(
    runs: _Runs, executor: Executor | None, *, ordered: bool = False
) -> Iterator[tuple[range, Floats]]:
    """Yield the scores of all runs in parts, as they are ready or in the order of their numbers."""
    if executor is None:
        size = _PART if ordered else max(runs.count, 1)
        for first in range(0, runs.count, size):
            part = range(first, min(first + size, runs.count))
            yield part, _scores_of(runs.piece(part))
        return

    sizes = PieceSizes(runs.count, workers_of(executor))
    pieces = (runs.piece(part) for part in sizes.ranges())
    for piece, future in finished_pieces(executor, _score_piece, pieces, ordered=ordered):
        scores, duration = result_of(future)
        sizes.measured(piece.runs, duration)
        yield piece.runs, scores


def _score_piece(piece: _Piece) -> tuple[Floats, float]:
    """Return the scores of runs, made by one thread, and the duration [s]; called by workers."""
    began = time.perf_counter()
    scores = _scores_of(piece, threads=1)
    return scores, time.perf_counter() - began


def _scores_of(piece: _Piece, threads: int | None = None) -> Floats:
    """Return the scores of runs; where they are compiled, with as many threads as cores."""
    scores = _scores_by_laws(piece, threads)
    return _scores_in_python(piece) if scores is None else scores


def _in_groups(scored: Iterable[tuple[range, Floats]]) -> Iterator[tuple[range, Floats]]:
    """Yield the scores of runs in their order, in groups of `_ROWS` runs."""
    first = 0
    count = 0
    waiting: list[Floats] = []
    for _, scores in scored:
        waiting.append(scores)
        count += len(scores)
        while count >= _ROWS:
            rows = np.concatenate(waiting)
            yield range(first, first + _ROWS), rows[:_ROWS]
            waiting = [rows[_ROWS:]]
            count -= _ROWS
            first += _ROWS
    if count:
        yield range(first, first + count), np.concatenate(waiting)


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


def _scores_by_laws(piece: _Piece, threads: int | None) -> Floats | None:
    """Return the scores of runs, made by the loops that call laws.

    None: something that is no law of ours decides, or moves the car.
    """
    scenario = piece.scenario
    pilot = piece.pilot
    gains = piece.gains
    plant = scenario.plant()
    limit = scenario.acceleration_limit
    laws = laws_of(pilot.speed, pilot.lane, limit)
    reference = _reference_of(scenario)
    if laws is None or reference is None or not plant.has_laws:
        return None

    of_speed = np.column_stack([gains[name] for name in pilot.speed.gains])
    steps = round(scenario.max_duration / plant.ts)
    if plant.has_fast_path and not laws.speed.is_lqr and not isinstance(reference, SpeedProfile):
        return scores_of_gains(
            plant, of_speed, limit, reference, scenario.end, steps, piece.seeds, threads
        )

    of_lane = [gains[LANE + name] for name in pilot.lane.gains]
    runs = LawRuns(plant, laws, reference, scenario.end, steps)
    lane_gains = np.column_stack([*of_lane]) if of_lane else None
    return runs.scores(of_speed, lane_gains, piece.seeds, threads)


def _reference_of(scenario: Scenario) -> float | SpeedProfile | None:
    """Return the speed to hold [m/s] as loops take it; None: it is a function of the user's."""
    reference = scenario.reference
    if reference is None:
        return scenario.speed_reference
    if isinstance(reference, SpeedProfile) and reference.track == scenario.track:
        fastest = sqrt(max(reference.columns.squares))
        return reference if fastest <= SPEED.between[1] else None
    return None


def _scores_in_python(piece: _Piece) -> Floats:
    """Return the scores of runs, with any controller and model."""
    scenario = piece.scenario
    speed = piece.pilot.speed
    before = speed.gain_values
    scores = []
    try:
        for i in range(len(piece.runs)):
            steering = as_lane_pilot(deepcopy(scenario.lane))
            LaneKeeping(speed, steering).set_gains(
                {name: float(values[i]) for name, values in piece.gains.items()}
            )
            seed = scenario.seed if piece.seeds is None else int(piece.seeds[i])
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


def _seeds(seeds: ArrayLike) -> Ints:
    """Return seeds as an array of whole numbers; UserError: one is no seed."""
    numbers = np.asarray(seeds)
    if numbers.size:
        if not np.issubdtype(numbers.dtype, np.integer):
            raise UserError(f'seed {seeds!r} must be whole numbers, such as range(1000)')
        LIMITS['seed'].check(int(numbers.min()))
        LIMITS['seed'].check(int(numbers.max()))
    return numbers.astype(np.intp)
