"""The scores of a run: by laws over the states that a loop has stored, or from a log.

Both add up numbers in the order of the states, as `metrics.summary` does: the scores of a loop
and the scores of the run's log are equal to the last bit.
"""

from __future__ import annotations

from math import inf, nan, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import RUN_UP, rms, summary
from barc_sim.vehicle.law import law
from barc_sim.vehicle.road import Inclines, stretch_at

if TYPE_CHECKING:
    from barc_sim.simulation.log import Log

    Column = Any  #: a list of numbers in Python, an array in compiled code


class Driven(NamedTuple):
    """The states of a run as its log has them, in columns that can have room for more."""

    along: Column  #: [m] true distance
    speed: Column  #: [m/s] true speed
    reference: Column  #: [m/s]
    motor: Column  #: [m/s²] commands


class DrivenOnTrack(NamedTuple):
    """What the log of a run on a track has in addition."""

    e_y: Column  #: [m] true
    lap: Column
    lap_time: Column  #: [s]


class Scores(NamedTuple):
    """The scores of a run, as `metrics.summary` defines them; infinite if it did not arrive."""

    rms_error: float = inf  #: [m/s] beyond `RUN_UP`
    max_error: float = inf  #: [m/s]
    overshoot: float = inf  #: of the first grade's speed, as a share of the reference
    effort: float = inf  #: [m/s²] RMS command


class LaneScores(NamedTuple):
    """The scores that a run on a track has in addition; infinite if it did not arrive."""

    rms_e_y: float = inf  #: [m]
    max_e_y: float = inf  #: [m]
    best_lap: float = inf  #: [s] as `TrackLog.best`; infinite without a whole lap


@law
def first_states(inclines: Inclines, driven: Driven, count: int, lap: float) -> int:
    """Return the number of states before the grade or the reference changes.

    The road begins anew after each `lap` [m]; infinity: it does not.
    """
    theta = 0.0
    stretch = 0
    for k in range(count):
        x = driven.along[k]
        if lap < inf:
            x = x % lap
        stretch = stretch_at(inclines.starts, x, stretch)
        if k == 0:
            theta = inclines.thetas[stretch]
        if inclines.thetas[stretch] != theta or driven.reference[k] != driven.reference[0]:
            return k
    return count


@law
def score(driven: Driven, count: int, first: int) -> Scores:
    """Return the scores of a run of `count` states that has arrived.

    The `first` states are the step response.
    """
    along = driven.along
    speed = driven.speed
    reference = driven.reference
    motor = driven.motor
    squares = 0.0
    largest = 0.0
    counted = 0
    effort = 0.0
    for k in range(count):
        if along[k] >= RUN_UP:
            error = abs(reference[k] - speed[k])
            squares += error * error
            largest = max(largest, error)
            counted += 1
        command = motor[k]
        effort += command * command

    overshoot = nan
    if reference[0]:
        fastest = -inf
        for k in range(first):
            fastest = max(fastest, speed[k] / reference[0])
        overshoot = max(fastest - 1.0, 0.0)
    return Scores(sqrt(squares / counted), largest, overshoot, sqrt(effort / count))


@law
def score_lane(driven: DrivenOnTrack, count: int, period_ns: int) -> LaneScores:
    """Return the scores of the lane of a run of `count` states, `period_ns` apart."""
    squares = 0.0
    largest = 0.0
    for k in range(count):
        e_y = driven.e_y[k]
        squares += e_y * e_y
        largest = max(largest, abs(e_y))

    # A lap counts between the beginnings of two that follow one another; the first one only if
    # there is no other.
    best = inf
    only = inf
    laps = 0
    lap = driven.lap[0]
    began = 0.0 - driven.lap_time[0]
    for k in range(1, count):
        if driven.lap_time[k] < driven.lap_time[k - 1]:
            begins = k * period_ns / 1e9 - driven.lap_time[k]
            if driven.lap[k] - lap == 1.0:
                laps += 1
                if laps == 1:
                    only = begins - began
                else:
                    best = min(best, begins - began)
            lap = driven.lap[k]
            began = begins
    if laps == 1:
        best = only
    return LaneScores(sqrt(squares / count), largest, best)


def scores_of_log(log: Log, end: float) -> tuple[float, ...]:
    """Return the fields of `Scores` of a run that should arrive at `end` [m].

    On a track the fields of `LaneScores` follow.
    """
    of_speed = Scores()
    of_lane = LaneScores()
    if log.distance[-1] >= end:
        result = summary(log)
        of_speed = Scores(
            rms_error=result.rms_error_after_run_up,
            max_error=result.max_error_after_run_up,
            overshoot=result.overshoot,
            effort=rms(log.motor),
        )
        if isinstance(log, TrackLog):
            of_lane = LaneScores(rms(log.e_y), float(np.abs(log.e_y).max()), log.best)
    return (*of_speed, *of_lane) if isinstance(log, TrackLog) else of_speed
