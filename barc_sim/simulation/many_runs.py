"""Scores many runs: groups those with the same noise, and shares them among the cores."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from math import ceil
from os import cpu_count
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.vehicle.law import is_compiled
from barc_sim.vehicle.plant import NoiseLevels, Sensor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.intp]
    #: Takes gains, a row for each run; normal numbers, shape `(states, 6)`, `(0, 6)` without noise;
    #: and the number of states after which a run ends. Returns a row of scores for each run, which
    #: are infinite where it has not arrived.
    ScoreRuns = Callable[[Floats, Floats, int], Floats]

_SIGNALS = len(NoiseLevels._fields)
_USUAL = 2048  #: states of a run, for which there is room at first
_MARGIN = 1.2  #: times the states of a car that drives at its reference
_MAX_PIECE = 4096  #: runs that a thread makes at a time


class _Job(NamedTuple):
    """Runs with the same noise that a thread makes."""

    sensor: Sensor
    runs: Ints  #: their numbers


def scores_of_many(
    score_runs: ScoreRuns,
    sensor: Sensor,
    gains: Floats,
    width: int,
    states: int,
    seeds: Ints | None = None,
    usual: int = 0,
    threads: int | None = None,
) -> Floats:
    """Return the scores of many runs, on all cores where they are compiled.

    Parameters
    ----------
    score_runs
        scores some of the runs; several threads call it.
    sensor
        of all runs, which differ in their seeds only.
    gains
        of each run, shape `(n, gains)`.
    width
        number of scores.
    states
        after which a run ends even if it has not arrived.
    seeds
        of the noise of each run, shape `(n,)`; by default the sensor's for all.
    usual
        number of states with which most runs arrive, if it is more than 2048.
    threads
        number of threads for compiled runs; by default one for each core.

    Returns
    -------
    ndarray
        The scores, shape `(n, width)`.
    """
    scores = np.empty((len(gains), width))

    def run(job: _Job) -> None:
        runs = job.runs
        rooms: Iterable[int] = rooms_for(states, usual)
        if is_compiled() and not job.sensor.is_noisy:
            rooms = [states]  # zeros that are not used take neither time nor memory
        normals = np.empty((0, _SIGNALS))
        for room in rooms:
            if job.sensor.is_noisy:
                normals = job.sensor.normals(room)
            scores[runs] = score_runs(gains[runs], normals, room)
            runs = runs[np.isinf(scores[runs, 0])]  # these have not arrived
            if not len(runs):
                break

    workers = (threads or cpu_count() or 1) if is_compiled() else 1
    jobs = _jobs(sensor, len(gains), seeds, workers)
    if len(jobs) == 1:
        run(jobs[0])
        return scores
    with ThreadPoolExecutor(workers) as pool:
        for done in [pool.submit(run, job) for job in jobs]:
            done.result()
    return scores


def _jobs(sensor: Sensor, count: int, seeds: Ints | None, workers: int) -> list[_Job]:
    """Return the jobs of `count` runs for this number of threads."""
    groups = [_Job(sensor, np.arange(count))]
    if seeds is not None and sensor.is_noisy:
        different, group = np.unique(seeds, return_inverse=True)
        runs = np.argsort(group, kind='stable')
        ends = np.cumsum(np.bincount(group))
        groups = [
            _Job(Sensor(sensor.noise, seed), of_seed)
            for seed, of_seed in zip(different.tolist(), np.split(runs, ends[:-1]), strict=True)
        ]

    size = max(min(ceil(count / workers), _MAX_PIECE), 1)
    return [
        group._replace(runs=group.runs[first : first + size])
        for group in groups
        for first in range(0, len(group.runs), size)
    ]


def rooms_for(states: int, usual: int = 0) -> Iterator[int]:
    """Yield how many states to make room for: first for a usual run, at last for `states`."""
    room = min(states, max(usual, _USUAL))
    yield room
    while room < states:
        room = min(4 * room, states)
        yield room


def usual_states(distance: float, speed: float, ts: float) -> int:
    """Return the states of most runs to a distance [m] at a speed [m/s], in steps of `ts` [s]."""
    return round(_MARGIN * distance / (speed * ts)) if speed > 0.0 else 0
