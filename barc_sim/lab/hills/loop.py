"""Judges the closed loop: the user's controller in barc_sim's car, on several roads."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from math import inf, isfinite
from random import Random
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from barc_sim.control.speed import PID, speed_controller
from barc_sim.errors import UserError
from barc_sim.lab.check.code import judges
from barc_sim.lab.check.lab import Table, Thresholds
from barc_sim.lab.hills.model import TS
from barc_sim.lab.user_code.folder import NOT_WRITTEN
from barc_sim.simulation.closed_loop import DISTANCE, MAX_DURATION, Progress, closed_loop
from barc_sim.simulation.metrics import SegmentErrors, summary
from barc_sim.vehicle.bike_model import GRAVITY
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from barc_sim.lab.check.code import Judged
    from barc_sim.lab.check.laws import Floats
    from barc_sim.lab.hills.code import HillsCode
    from barc_sim.lab.user_code.source import ChosenGains
    from barc_sim.simulation.log import Log

LABELS = {
    'loop.lab_road': "Cruise control: the lab's road",
    'loop.random_roads': 'Cruise control: other roads',
}
STEEPEST_DEG = 25.0
NOT_A_CAR = 1e6  #: [m/s²]
_RANDOM_ROADS = 4
_GRADES = 5
_MIN_LENGTH, _MAX_LENGTH = 15.0, 30.0  #: [m] of a grade
_MAX_SPEED = 40.0  #: [m/s] A figure ends there.


def random_road(seed: int, number: int) -> tuple[Road, float]:
    """Return random road `number` and its length [m]: 20 m on the flat, then five grades.

    The car's motor can climb each of them.
    """
    random = Random(f'{seed} road {number}')  # noqa: S311 (a simulation, not a secret)
    starts, grades = [0.0], [0.0]
    end = 20.0
    for _ in range(_GRADES):
        starts.append(end)
        grades.append(round(random.uniform(-STEEPEST_DEG, STEEPEST_DEG), 1))
        end = round(end + random.uniform(_MIN_LENGTH, _MAX_LENGTH), 1)
    return Road(tuple(starts), tuple(grades), name=f'random {number + 1}'), end


@dataclass(frozen=True)
class Conditions:
    """How a controller drives."""

    gains: ChosenGains | None  #: None: it chooses none
    limit: float = inf  #: [m/s²] of its output
    thresholds: Thresholds = field(default_factory=Thresholds)
    mended: str = ''  #: letters of terms that barc_sim's replace, as in `PI`

    def __str__(self) -> str:
        """Return them as text."""
        limit = f', limited to {self.limit:g} m/s²' if isfinite(self.limit) else ''
        return f'with {self.gains}{limit}'


@judges('loop.lab_road')
def judge_lab_road(code: HillsCode, conditions: Conditions) -> Judged:
    """Return the finding for the lab's road, with what the speed does on each stretch of it.

    Where the score is not full, a gain is named with which the user's own code did better.
    """
    try:
        drive = _drive(code, conditions, Road.lab(), DISTANCE)
    except UserError as error:
        if NOT_WRITTEN in str(error) or not conditions.gains:
            raise
        raise UserError(f'{error} ({conditions})') from error
    message = f'{drive.describe()}, {conditions}{drive.worst_stretch()}{_advice(code, drive)}'
    return drive.score, message, drive


_TRIED = (1.5, 3.0)  #: times a gain
_BETTER = 0.9  #: times the RMS error


def _advice(code: HillsCode, drive: Drive) -> str:
    """Return the larger gain with which the same code holds the speed best; empty if none does."""
    conditions = drive.conditions
    if drive.score == 1.0 or conditions.mended or not conditions.gains:
        return ''
    duration, best, advice = 2.0 * float(drive.log.t[-1]), drive, ''
    for name, gain in zip(PID.gains, conditions.gains[:3], strict=True):
        for factor in _TRIED if gain else ():
            changed: Any = {name: factor * gain}
            tried = replace(conditions, gains=conditions.gains._replace(**changed))
            try:
                other = _driven(code, tried, Road.lab(), DISTANCE, duration)
            except UserError:
                continue
            (rms, _), (best_rms, _) = other.errors, best.errors
            arrives = other.log.distance[-1] >= DISTANCE and other.score > best.score
            if arrives and (drive.failure or rms < _BETTER * drive.errors[0]) and rms < best_rms:
                best = other
                advice = (
                    f'. With {name} {factor * gain:g} in place of {gain:g} the RMS error is '
                    f'{rms:.3f} m/s'
                )
    return advice


@cache
def _usual(limit: float) -> Log:
    """Return the run with barc_sim's controller."""
    return closed_loop(controller=speed_controller(limit=limit), distance=DISTANCE)


@judges('loop.random_roads')
def judge_random_roads(code: HillsCode, conditions: Conditions, seed: int) -> Judged:
    """Return the finding for random roads: the mean of their scores."""
    roads = (random_road(seed, number) for number in range(_RANDOM_ROADS))
    drives = [_drive(code, conditions, *road) for road in roads]
    worst = min(drives, key=lambda drive: drive.score)
    message = f'the worst of {len(drives)} roads: {worst.describe()}{worst.worst_stretch()}'
    return float(np.mean([drive.score for drive in drives])), message


class _Limited(PID):
    """A user's controller, its output limited; terms of barc_sim's PID take the place of some."""

    def __init__(self, code: HillsCode, conditions: Conditions) -> None:
        assert conditions.gains  # noqa: S101 (there are some)
        gains = dict(zip('PID', conditions.gains[:3], strict=True))
        own = [0.0 if name in conditions.mended else gain for name, gain in gains.items()]
        super().__init__()  # a user's gains have no limits
        self.kp, self.ki, self.kd = (
            gain - mine for gain, mine in zip(gains.values(), own, strict=True)
        )
        self.limit = conditions.limit
        self._controller = code.new_pid(*own, limit=self.limit)
        self.calls = 0

    def acc_calculate(
        self, speed_reference: float, speed_current: float, dt: float | None = None
    ) -> float:
        """Return the acceleration [m/s²]."""
        self.calls += 1
        dt = self.dt if dt is None else dt
        requested = self._controller.acc_calculate(speed_reference, speed_current, dt)
        requested += super().acc_calculate(speed_reference, speed_current, dt)
        output = min(max(requested, -self.limit), self.limit)
        if abs(output) > NOT_A_CAR:
            raise UserError(
                f'it returned {output:.3g} m/s²: beyond {NOT_A_CAR:g} it is not a car'
                + (f'; {_BACKWARDS}' if speed_current < -_HELD else '')
            )
        self.saturated = abs(requested) >= self.limit
        return output


def _drive(code: HillsCode, conditions: Conditions, road: Road, distance: float) -> Drive:
    """Drive over a road; what follows from a wrong term is not taken off again.

    So the code drives with its wrong terms put right, too, and the better drive counts.
    """
    if conditions.gains is None:
        code.new_pid(0.0, 0.0, 0.0).acc_calculate(0.0, 0.0, TS)  # its own error, if there is one
        raise UserError(
            'controller.py chooses no gains: write the call PID(kp=…, ki=…, kd=…) with the tuned '
            'ones as its last line'
        )
    drives = []
    try:
        drives.append(_driven(code, replace(conditions, mended=''), road, distance))
    except UserError:
        if not conditions.mended:
            raise
    if conditions.mended:
        drives.append(_driven(code, conditions, road, distance))
    return max(drives, key=lambda drive: drive.score)


def _driven(
    code: HillsCode,
    conditions: Conditions,
    road: Road,
    distance: float,
    duration: float = MAX_DURATION,
) -> Drive:
    """Drive over a road once; an error of the code on the way names the call."""
    plant = Plant(road=road)
    pid = _Limited(code, conditions)
    progress = Progress(distance)
    try:
        log = closed_loop(plant, pid, distance=distance, max_duration=duration, progress=progress)
    except UserError as error:
        if NOT_WRITTEN in str(error):
            raise
        time = (pid.calls - 1) * plant.ts
        raise UserError(f'call {pid.calls}, after {time:.2f} s on the road: {error}') from error
    return Drive(log, progress.failure, conditions)


@dataclass(frozen=True)
class Drive:
    """A drive over one road with the user's controller."""

    log: Log
    failure: str  #: what the car does that never arrives
    conditions: Conditions

    @property
    def errors(self) -> tuple[float, float]:
        """The RMS and the maximum error [m/s] after the run-up."""
        result = summary(self.log)
        return round(result.rms_error_after_run_up, 6), round(result.max_error_after_run_up, 6)

    @property
    def limit(self) -> float:
        """The limit [m/s²] of the output: the one given, or one at which it stays for long."""
        size = np.abs(self.log.motor)
        at_limit = np.concatenate([[0], size == size.max(), [0]])
        times = np.diff(np.flatnonzero(np.diff(at_limit)))[::2]
        own = float(size.max()) if times.max(initial=0) > _OWN_LIMIT and size.max() else inf
        return min(self.conditions.limit, own)

    @property
    def score(self) -> float:
        """The score, from 0 to 1."""
        if self.failure:
            return 0.0
        return self.conditions.thresholds.score(*self.errors)

    def describe(self) -> str:
        """Return a sentence on the errors."""
        if self.failure:
            limit = f'; its output is {self.limit:g} m/s² at most' if isfinite(self.limit) else ''
            return f'{self.failure}{limit}'
        (rms, maximum), by = self.errors, self.conditions.thresholds
        mended = self.conditions.mended
        return (
            (f'with {" and ".join(mended)} put right: ' if mended else '')
            + f'RMS error {rms:.3f} m/s after the first 10 m, at most {maximum:.3f} m/s '
            f'({by.full_rms:g} and {by.full_max:g} m/s are full marks)'
        )

    @property
    def stretches(self) -> list[tuple[SegmentErrors, str]]:
        """The errors on each stretch of one grade, and what the speed does there."""
        changes = np.flatnonzero(np.diff(self.log.theta_deg)) + 1
        parts = [slice(*each) for each in pairwise([0, *changes.tolist(), len(self.log)])]
        remarks = (_remark(self.log, part, self.limit) for part in parts)
        return [*zip(summary(self.log).stretches, remarks, strict=True)]

    @property
    def table(self) -> Table:
        """The stretches, as text."""
        header = ('from', 'grade', 'RMS', 'at most', 'the speed')
        rows = [
            (
                f'{errors.start:.0f} m',
                f'{errors.theta_deg:g}°',
                f'{errors.rms_error:.3f} m/s',
                f'{errors.max_error:.3f} m/s',
                remark,
            )
            for errors, remark in self.stretches
        ]
        return Table("the lab's road, stretch by stretch", header, rows)

    def worst_stretch(self) -> str:
        """Return a sentence on the stretch with the largest RMS error; empty at full marks."""
        if self.score == 1.0:
            return ''
        first, *later = self.stretches
        worst, remark = max(later or [first], key=lambda stretch: stretch[0].rms_error)
        return f'. From {worst.start:.0f} m on, at {worst.theta_deg:g}°: {remark}'

    def figure(self, title: str = '') -> Figure:
        """Draw the run beside that with barc_sim's controller."""
        from barc_sim.figures.run_figures import plot  # noqa: PLC0415 (slow)

        runs = {'your PID': self.log, "barc_sim's PID": _usual(self.conditions.limit)}
        figure = cast('Figure', plot(*runs.values(), labels=[*runs]))
        speed = figure.axes[0]
        low, high = speed.get_ylim()
        speed.set_ylim(max(low, -_MAX_SPEED), min(high, _MAX_SPEED))
        speed.set_title(title, loc='left', pad=26.0)
        return figure


_BACKWARDS = 'the car drives backwards: is the error speed_reference - speed_current?'
_HELD = 0.05  #: [m/s] An error up to this is negligible.
_NEAR = 0.02  #: share of the reference within which it counts as reached
_LONG_LIMIT = 0.1  #: [s] An output at its limit for a shorter time has no effect.
_OWN_LIMIT = 25  #: calls: code that returns its largest output for longer has a limit of its own
# Shares of the maximum error on a stretch:
_CARRIED = 0.6  #: that the stretch starts with
_SWINGS, _SWING = 4, 0.3  #: that a swing reaches, and how many count
_STEADY = 0.5  #: that is left at the end, or on the other side


def _remark(log: Log, part: slice, limit: float) -> str:
    """Return what the speed does on a stretch: what was measured, and no advice."""
    error = log.speed_error[part]
    if part.start == 0:
        return _of_start(log.speed[part], error, limit)
    slopes = np.sin(np.radians(log.theta_deg[[part.start - 1, part.start]]))
    change = GRAVITY * float(np.diff(slopes)[0])
    at_limit = float(np.count_nonzero(np.abs(log.motor[part]) >= limit)) * TS
    what = _of_error(error, np.sign(change))
    if np.abs(error).max() > _HELD and at_limit > _LONG_LIMIT:
        what = f'the output was at its limit of {limit:g} m/s² for {at_limit:.1f} s'
    return f'needs {abs(change):.1f} m/s² {"more" if change > 0.0 else "less"} at once: {what}'


def _of_error(error: Floats, sign: float) -> str:
    """Return how the error goes on, which a change of grade begins with `sign`."""
    peak = float(np.abs(error).max())
    rest = float(np.mean(error[-max(len(error) // 5, 1) :]))
    over = float(np.max(-sign * error))
    swings = np.count_nonzero(np.diff(np.sign(error[np.abs(error) > _SWING * peak])))
    sentences = {
        f'held within {_HELD:g} m/s': peak <= _HELD,
        f'the speed swings {swings} times, by up to {peak:.2f} m/s': swings >= _SWINGS,
        f'starts {abs(error[0]):.2f} m/s off, {_end(error)}': abs(error[0]) >= _CARRIED * peak,
        f'{abs(rest):.2f} m/s too {"slow" if rest > 0.0 else "fast"} at its end': abs(rest)
        > _STEADY * peak,
        f'overshoots by {over:.2f} m/s': over > max(_STEADY * peak, _HELD),
        f'{peak:.2f} m/s off, {_end(error)}': True,
    }
    return next(sentence for sentence, applies in sentences.items() if applies)


def _of_start(speed: Floats, error: Floats, limit: float) -> str:
    reference = float(speed[0] + error[0])
    near = np.flatnonzero(np.abs(error) <= _NEAR * abs(reference))
    if not near.size:
        if speed.min() < -_HELD:
            return _BACKWARDS
        return f'{reference:g} m/s is not reached: the maximum speed is {speed.max():.2f} m/s'
    text = f'{near[0] * TS:.2f} s to {reference:g} m/s'
    if isfinite(limit):
        text += f', where {limit:g} m/s² allow {reference / limit:.2f} s'
    over = -float(error.min())
    return f'{text}; then {over:.2f} m/s too fast' if over > _NEAR * reference else text


def _end(error: Floats) -> str:
    """Return when the error was gone."""
    beyond = np.flatnonzero(np.abs(error) > max(0.1 * float(np.abs(error).max()), 0.01))
    if beyond.size and beyond[-1] + 1 == len(error):
        return 'not gone at the end of this one'
    return f'gone after {(beyond[-1] + 1 if beyond.size else 0) * TS:.1f} s'
