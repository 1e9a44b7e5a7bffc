"""Judges the closed loop: the user's controller in the reference's car, on several roads."""

from __future__ import annotations

from math import nan
from random import Random
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.control.pid import ACCELERATION_LIMIT, PID, speed_controller
from barc_sim.errors import UserError
from barc_sim.lab.check.findings import IGNORE_FLOAT_ERRORS, Comparison, Finding
from barc_sim.lab.check.stretches import Gains, describe_worst, explain
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.metrics import summary
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from barc_sim.lab.check.code import JudgedCode, JudgedController
    from barc_sim.simulation.log import Log


STEEPEST_DEG = 25.0
_STRETCHES = 5
_LEAST, _MOST = 15.0, 30.0  #: [m] of a stretch


def random_road(seed: int, number: int) -> tuple[Road, float]:
    """Return random road `number` and its length [m]: 20 m on the flat, then five grades.

    The car's motor can climb each of them.
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
#: [m/s] RMS speed error after the run-up: full marks up to `GOOD`, none from `BAD` on, linear in
#: between. The lab's published example has 0.10, the reference 0.02.
GOOD, BAD = 0.15, 1.5
#: [s] of simulated time: three times as long as the reference needs for the lab's road.
_LONGEST = 70.0


class Drive(NamedTuple):
    """A drive over one road."""

    road: Road
    log: Log
    arrived: bool


class _Limited(PID):
    """A user's controller, its output limited to what the motor can do."""

    def __init__(self, controller: JudgedController) -> None:
        super().__init__(
            nan, nan, nan, output_min=-ACCELERATION_LIMIT, output_max=ACCELERATION_LIMIT
        )
        self.proportional = self.integral = self.derivative = nan
        self._controller = controller

    def acc_calculate(
        self, speed_reference: float, speed_current: float, dt: float | None = None
    ) -> float:
        """Return the acceleration [m/s²]."""
        dt = self.dt if dt is None else dt
        requested = self._controller.acc_calculate(speed_reference, speed_current, dt)
        output = min(max(requested, self.output_min), self.output_max)
        self.saturated = abs(requested) >= self.output_max
        return output


@IGNORE_FLOAT_ERRORS
def judge_lab_road(code: JudgedCode, gains: Gains) -> Finding:
    """Return the finding for the lab's road, with an explanation for each stretch of it."""
    try:
        drive = _drive(code, gains, Road.lab(), LAB_DISTANCE)
    except UserError as error:
        return Finding('loop.lab_road', 0.0, str(error))
    stretches = explain(drive.log, gains)
    score = _score(drive)
    message = _describe(drive)
    if score < 1.0:
        message += f'. {describe_worst(stretches)}'
    reference = closed_loop(Plant(road=drive.road), speed_controller(*gains), distance=LAB_DISTANCE)
    return Finding(
        'loop.lab_road',
        score,
        message,
        {'gains': list(gains), 'stretches': [stretch._asdict() for stretch in stretches]},
        Comparison(drive.log, reference),
    )


@IGNORE_FLOAT_ERRORS
def judge_random_roads(code: JudgedCode, gains: Gains, seed: int) -> Finding:
    """Return the finding for random roads: the mean of their scores."""
    try:
        drives = [_drive(code, gains, *random_road(seed, number)) for number in range(RANDOM_ROADS)]
    except UserError as error:
        return Finding('loop.random_roads', 0.0, str(error))
    scores = [_score(drive) for drive in drives]
    worst_drive = drives[int(np.argmin(scores))]
    message = f'the worst of {len(drives)} roads: {_describe(worst_drive)}'
    if min(scores) < 1.0:
        message += f'. {describe_worst(explain(worst_drive.log, gains))}'
    roads = [
        {
            'starts': list(drive.road.starts),
            'grades_deg': list(drive.road.grades_deg),
            'rms_error': _rms(drive),
            'score': score,
        }
        for drive, score in zip(drives, scores, strict=True)
    ]
    return Finding('loop.random_roads', float(np.mean(scores)), message, {'roads': roads})


def _drive(code: JudgedCode, gains: Gains, road: Road, distance: float) -> Drive:
    plant = Plant(road=road)
    pid = _Limited(code.new_pid(*gains))
    log = closed_loop(plant, pid, distance=distance, max_duration=_LONGEST)
    return Drive(road, log, bool(plant.state.x >= distance))


def _rms(drive: Drive) -> float:
    return round(summary(drive.log).rms_error_after_run_up, 6)


def _score(drive: Drive) -> float:
    rms = _rms(drive)
    if not drive.arrived or not rms < BAD:
        return 0.0
    return min(1.0, (BAD - rms) / (BAD - GOOD))


def _describe(drive: Drive) -> str:
    log = drive.log
    if not drive.arrived:
        return (
            f'the car is at {log.distance[-1]:.1f} m after {log.t[-1]:.0f} s, at '
            f'{log.speed[-1]:.2f} m/s: it does not reach the end of the road'
        )
    result = summary(log)
    return (
        f'RMS error {result.rms_error_after_run_up:.3f} m/s after the first 10 m, at most '
        f'{result.max_error_after_run_up:.3f} m/s ({GOOD:g} m/s RMS is full marks)'
    )
