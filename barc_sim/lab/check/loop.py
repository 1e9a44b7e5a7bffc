"""Judges the closed loop: the user's controller in the reference's car, on several roads."""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.control.pid import ACCELERATION_LIMIT, PID, speed_controller
from barc_sim.errors import UserError
from barc_sim.lab.check.evidence import Comparison
from barc_sim.lab.check.finding import WHATEVER_COMES, Finding
from barc_sim.lab.check.roads import random_road
from barc_sim.lab.check.stretches import Gains, why, worst
from barc_sim.simulation.closed_loop import rollout
from barc_sim.simulation.metrics import summary
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from barc_sim.lab.check.code import Code, Controller
    from barc_sim.simulation.log import Log

RANDOM_ROADS = 4
LAB_DISTANCE = 180.0  #: [m]
#: [m/s] RMS of the speed's error after the run-up: up to `GOOD` is full marks, from `BAD` on none,
#: in between in proportion. The lab's published example has 0.10, the reference 0.02.
GOOD, BAD = 0.15, 1.5
#: [s] of simulated time: thrice what the reference takes for the lab's road.
_LONGEST = 70.0


class Drive(NamedTuple):
    """One road driven."""

    road: Road
    log: Log
    arrived: bool


class _Cut(PID):
    """A user's controller whose output the motor cuts at its limits."""

    def __init__(self, controller: Controller) -> None:
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
        wanted = self._controller.acc_calculate(speed_reference, speed_current, dt)
        output = min(max(wanted, self.output_min), self.output_max)
        self.saturated = abs(wanted) >= self.output_max
        return output


@WHATEVER_COMES
def judge_lab_road(code: Code, gains: Gains) -> Finding:
    """Return what is found of a run over the lab's road; tells why of each stretch of it."""
    try:
        drive = _drive(code, gains, Road.lab(), LAB_DISTANCE)
    except UserError as error:
        return Finding('loop.lab_road', 0.0, str(error))
    stretches = why(drive.log, gains)
    score = _score(drive)
    message = _said(drive)
    if score < 1.0:
        message += f'. {worst(stretches)}'
    reference = rollout(Plant(road=drive.road), speed_controller(*gains), distance=LAB_DISTANCE)
    return Finding(
        'loop.lab_road',
        score,
        message,
        {'gains': list(gains), 'stretches': [stretch._asdict() for stretch in stretches]},
        Comparison(drive.log, reference),
    )


@WHATEVER_COMES
def judge_random_roads(code: Code, gains: Gains, seed: int) -> Finding:
    """Return what is found of runs over random roads: the mean of their scores."""
    try:
        drives = [_drive(code, gains, *random_road(seed, number)) for number in range(RANDOM_ROADS)]
    except UserError as error:
        return Finding('loop.random_roads', 0.0, str(error))
    scores = [_score(drive) for drive in drives]
    poorest = drives[int(np.argmin(scores))]
    message = f'the poorest of {len(drives)} roads: {_said(poorest)}'
    if min(scores) < 1.0:
        message += f'. {worst(why(poorest.log, gains))}'
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


def _drive(code: Code, gains: Gains, road: Road, distance: float) -> Drive:
    plant = Plant(road=road)
    pid = _Cut(code.new_pid(*gains))
    log = rollout(plant, pid, distance=distance, max_duration=_LONGEST)
    return Drive(road, log, bool(plant.state.x >= distance))


def _rms(drive: Drive) -> float:
    return round(summary(drive.log).rms_error_after_run_up, 6)


def _score(drive: Drive) -> float:
    rms = _rms(drive)
    if not drive.arrived or not rms < BAD:
        return 0.0
    return min(1.0, (BAD - rms) / (BAD - GOOD))


def _said(drive: Drive) -> str:
    log = drive.log
    if not drive.arrived:
        return (
            f'the car is at {log.distance[-1]:.1f} m after {log.t[-1]:.0f} s, at '
            f'{log.speed[-1]:.2f} m/s: it does not get to the end of the road'
        )
    result = summary(log)
    return (
        f'RMS error {result.rms_error_after_run_up:.3f} m/s after the first 10 m, at most '
        f'{result.max_error_after_run_up:.3f} m/s ({GOOD:g} m/s RMS is full marks)'
    )
