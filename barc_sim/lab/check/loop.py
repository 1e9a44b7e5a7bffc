"""Judges the closed loop: the user's controller in the reference's car, on several roads."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from math import inf, isfinite, nan
from random import Random
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.control.pid import PID, speed_controller
from barc_sim.errors import UserError
from barc_sim.lab.check.findings import NOT_A_CAR, Comparison, judges
from barc_sim.lab.check.stretches import Gains, describe_worst, explain
from barc_sim.lab.user_code.call import NOT_WRITTEN
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.metrics import summary
from barc_sim.simulation.progress import Progress
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.lab.check.code import JudgedCode, JudgedController
    from barc_sim.lab.check.findings import Judged
    from barc_sim.lab.user_code.gains import ChosenGains
    from barc_sim.simulation.log import Log


STEEPEST_DEG = 25.0
_STRETCHES = 5
_LEAST, _MOST = 15.0, 30.0  #: [m] of a stretch


def random_road(seed: int, number: int) -> tuple[Road, float]:
    """Return random road `number` and its length [m]: 20 m on the flat, then five grades.

    The car's motor can climb each of them.

    Examples
    --------
    >>> road, distance = random_road(seed=0, number=1)
    >>> road == random_road(seed=0, number=1)[0]
    True
    """
    random = Random(f'{seed} road {number}')  # noqa: S311 (a simulation, not a secret)
    starts, grades = [0.0], [0.0]
    end = 20.0
    for _ in range(_STRETCHES):
        starts.append(end)
        grades.append(round(random.uniform(-STEEPEST_DEG, STEEPEST_DEG), 1))
        end = round(end + random.uniform(_LEAST, _MOST), 1)
    return Road(tuple(starts), tuple(grades), name=f'random {number + 1}'), end


RANDOM_ROADS = 4
LAB_DISTANCE = 180.0  #: [m]


@dataclass(frozen=True)
class Thresholds:
    """Speed errors [m/s] after the run-up, for half of the marks each.

    Full marks up to `full_…`, none from `zero_…` on, linear in between.

    Examples
    --------
    >>> Thresholds().full_rms
    0.15
    """

    full_rms: float = 0.15
    zero_rms: float = 1.5
    full_max: float = 0.5
    zero_max: float = 3.0


@dataclass(frozen=True)
class Conditions:
    """How a controller drives."""

    gains: ChosenGains
    limit: float = inf  #: [m/s²] of its output
    thresholds: Thresholds = field(default_factory=Thresholds)
    factors: Sequence[float] = (1.0, 1.0, 1.0)  #: of its terms, as in a finding

    @property
    def effective(self) -> Gains:
        """The gains times the terms' factors."""
        kp, ki, kd = (g * f for g, f in zip(self.gains[:3], self.factors, strict=True))
        return kp, ki, kd

    def __str__(self) -> str:
        """Return them as text."""
        limit = f'limited to {self.limit:g} m/s²' if isfinite(self.limit) else 'without a limit'
        return f'with {self.gains}, {limit}'


class Drive(NamedTuple):
    """A drive over one road."""

    road: Road
    log: Log
    failure: str  #: what the car does that never arrives


class _Limited(PID):
    """A user's controller, its output limited."""

    def __init__(self, controller: JudgedController, limit: float) -> None:
        super().__init__(nan, nan, nan, output_min=-limit, output_max=limit)
        self.proportional = self.integral = self.derivative = nan
        self._controller = controller
        self.calls = 0

    def acc_calculate(
        self, speed_reference: float, speed_current: float, dt: float | None = None
    ) -> float:
        """Return the acceleration [m/s²]."""
        self.calls += 1
        dt = self.dt if dt is None else dt
        requested = self._controller.acc_calculate(speed_reference, speed_current, dt)
        output = min(max(requested, self.output_min), self.output_max)
        if abs(output) > NOT_A_CAR:
            raise UserError(f'it returned {output:.3g} m/s²: beyond {NOT_A_CAR:g} it is not a car')
        self.saturated = abs(requested) >= self.output_max
        return output


@judges('loop.lab_road')
def judge_lab_road(code: JudgedCode, conditions: Conditions) -> Judged:
    """Return the finding for the lab's road, with an explanation for each stretch of it."""
    try:
        drive = _drive(code, conditions, Road.lab(), LAB_DISTANCE)
    except UserError as error:
        if NOT_WRITTEN in str(error):
            raise
        raise UserError(f'{error} ({conditions})') from error
    stretches = explain(drive.log, conditions.effective, conditions.limit)
    score = _score(drive, conditions.thresholds)
    message = f'{_describe(drive, conditions.thresholds)}, {conditions}'
    if score < 1.0:
        message += f'. {describe_worst(stretches)}'
    details = {
        'gains': list(conditions.gains[:3]),
        'stretches': [stretch._asdict() for stretch in stretches],
    }
    return score, message, details, Comparison(drive.log, _reference(conditions.limit))


@cache
def _reference(limit: float) -> Log:
    return closed_loop(controller=speed_controller(limit=limit), distance=LAB_DISTANCE)


@judges('loop.random_roads')
def judge_random_roads(code: JudgedCode, conditions: Conditions, seed: int) -> Judged:
    """Return the finding for random roads: the mean of their scores."""
    drives = [
        _drive(code, conditions, *random_road(seed, number)) for number in range(RANDOM_ROADS)
    ]
    thresholds = conditions.thresholds
    scores = [_score(drive, thresholds) for drive in drives]
    worst_drive = drives[int(np.argmin(scores))]
    message = f'the worst of {len(drives)} roads: {_describe(worst_drive, thresholds)}'
    if min(scores) < 1.0:
        worst = explain(worst_drive.log, conditions.effective, conditions.limit)
        message += f'. {describe_worst(worst)}'
    roads = [
        {
            'starts': list(drive.road.starts),
            'grades_deg': list(drive.road.grades_deg),
            'rms_error': _errors(drive)[0],
            'score': score,
        }
        for drive, score in zip(drives, scores, strict=True)
    ]
    return float(np.mean(scores)), message, {'roads': roads}


def _drive(code: JudgedCode, conditions: Conditions, road: Road, distance: float) -> Drive:
    """Drive over a road; an error of the code on the way names the call."""
    plant = Plant(road=road)
    controller = code.new_pid(*conditions.gains[:3], limit=conditions.limit)
    pid = _Limited(controller, conditions.limit)
    progress = Progress(distance)
    try:
        log = closed_loop(plant, pid, distance=distance, progress=progress)
    except UserError as error:
        if NOT_WRITTEN in str(error):
            raise
        time = (pid.calls - 1) * plant.ts
        raise UserError(f'call {pid.calls}, after {time:.2f} s on the road: {error}') from error
    return Drive(road, log, progress.failure)


def _errors(drive: Drive) -> tuple[float, float]:
    """Return the RMS and the greatest error [m/s] after the run-up."""
    result = summary(drive.log)
    return round(result.rms_error_after_run_up, 6), round(result.max_error_after_run_up, 6)


def _score(drive: Drive, thresholds: Thresholds) -> float:
    if drive.failure:
        return 0.0
    rms, greatest = _errors(drive)
    shares = (
        (thresholds.zero_rms - rms) / (thresholds.zero_rms - thresholds.full_rms),
        (thresholds.zero_max - greatest) / (thresholds.zero_max - thresholds.full_max),
    )
    # NaN is no error that is small.
    return sum(min(1.0, share) if share > 0.0 else 0.0 for share in shares) / len(shares)


def _describe(drive: Drive, thresholds: Thresholds) -> str:
    if drive.failure:
        return drive.failure
    rms, greatest = _errors(drive)
    return (
        f'RMS error {rms:.3f} m/s after the first 10 m, at most {greatest:.3f} m/s '
        f'({thresholds.full_rms:g} and {thresholds.full_max:g} m/s are full marks)'
    )
