"""Judges the closed loop: the user's controller in barc_sim's car, on several roads."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from math import inf, isfinite
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from barc_sim.control.pid import PID, speed_controller
from barc_sim.errors import UserError
from barc_sim.lab.check.code import judges
from barc_sim.lab.hills.model import TS
from barc_sim.lab.user_code.calls import NOT_WRITTEN
from barc_sim.simulation.closed_loop import DISTANCE, MAX_DURATION, closed_loop
from barc_sim.simulation.metrics import summary
from barc_sim.simulation.progress import Progress
from barc_sim.vehicle.bike_model import GRAVITY
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from barc_sim.lab.check.code import Judged, JudgedCode
    from barc_sim.lab.check.laws import Floats
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
class Thresholds:
    """Speed errors [m/s] after the run-up, for half of the marks each.

    Full marks up to `full_…`, none from `zero_…` on, linear in between.
    """

    full_rms: float = 0.15
    zero_rms: float = 1.5
    full_max: float = 0.5
    zero_max: float = 3.0


@dataclass(frozen=True)
class Conditions:
    """How a controller drives."""

    gains: ChosenGains | None  #: None: it chooses none
    limit: float = inf  #: [m/s²] of its output
    thresholds: Thresholds = field(default_factory=Thresholds)
    mended: str = ''  #: letters of terms, whose mistakes have cost points, as in `PI`

    def __str__(self) -> str:
        """Return them as text."""
        limit = f', limited to {self.limit:g} m/s²' if isfinite(self.limit) else ''
        return f'with {self.gains}{limit}'


class Stretch(NamedTuple):
    """A stretch of one grade, with the speed error on it."""

    start: float  #: [m]
    theta_deg: float
    rms_error: float  #: [m/s]
    max_error: float  #: [m/s] maximum absolute error
    remark: str  #: what the speed does


_MAX_SPEED = 40.0  #: [m/s] A figure ends there.


@dataclass(frozen=True, eq=False)
class Comparison:
    """The closed loop over one road, with the user's controller and with barc_sim's."""

    user: Log
    usual: Log
    stretches: tuple[Stretch, ...] = ()  #: of the user's

    def figure(self, title: str = '') -> Figure:
        """Draw both runs."""
        from barc_sim.figures.run_figures import plot  # noqa: PLC0415 (slow)

        figure = cast('Figure', plot(self.user, self.usual, labels=('your PID', "barc_sim's PID")))
        speed = figure.axes[0]
        low, high = speed.get_ylim()
        speed.set_ylim(max(low, -_MAX_SPEED), min(high, _MAX_SPEED))
        speed.set_title(title, loc='left', pad=26.0)
        return figure


@judges('loop.lab_road')
def judge_lab_road(code: JudgedCode, conditions: Conditions) -> Judged:
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
    usual = _usual(conditions.limit)
    return drive.score, message, Comparison(drive.log, usual, tuple(drive.stretches))


_TRIED = (1.5, 3.0)  #: times a gain
_BETTER = 0.9  #: times the RMS error


def _advice(code: JudgedCode, drive: Drive) -> str:
    """Return the larger gain with which the same code holds the speed best; empty if none does."""
    conditions = drive.conditions
    if drive.score == 1.0 or drive.mended or not conditions.gains:
        return ''
    duration, best, advice = 2.0 * float(drive.log.t[-1]), drive, ''
    for name, gain in zip(PID.gains, conditions.gains[:3], strict=True):
        for factor in _TRIED if gain else ():
            changed: Any = {name: factor * gain}
            gains = conditions.gains._replace(**changed)
            try:
                other = _driven(
                    code, replace(conditions, gains=gains), Road.lab(), DISTANCE, duration
                )
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
    return closed_loop(controller=speed_controller(limit=limit), distance=DISTANCE)


@judges('loop.random_roads')
def judge_random_roads(code: JudgedCode, conditions: Conditions, seed: int) -> Judged:
    """Return the finding for random roads: the mean of their scores."""
    drives = [
        _drive(code, conditions, *random_road(seed, number)) for number in range(_RANDOM_ROADS)
    ]
    worst = min(drives, key=lambda drive: drive.score)
    message = f'the worst of {len(drives)} roads: {worst.describe()}{worst.worst_stretch()}'
    return float(np.mean([drive.score for drive in drives])), message


class _Limited(PID):
    """A user's controller, its output limited; terms of barc_sim's PID take the place of some."""

    def __init__(self, code: JudgedCode, conditions: Conditions, mended: str) -> None:
        assert conditions.gains  # noqa: S101 (there are some)
        gains = dict(zip('PID', conditions.gains[:3], strict=True))
        own = [0.0 if name in mended else gain for name, gain in gains.items()]
        super().__init__()  # a user's gains have no limits
        self.kp, self.ki, self.kd = (gains[name] if name in mended else 0.0 for name in gains)
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


def _drive(code: JudgedCode, conditions: Conditions, road: Road, distance: float) -> Drive:
    """Drive over a road; what follows from a wrong term is not taken off again.

    So the code drives with its wrong terms put right, too, and the better drive counts.
    """
    if conditions.gains is None:
        code.new_pid(0.0, 0.0, 0.0).acc_calculate(0.0, 0.0, TS)  # its own error, if there is one
        raise UserError(
            'controller.py chooses no gains: write the call PID(kp=…, ki=…, kd=…) with the tuned '
            'ones as its last line'
        )
    if not conditions.mended:
        return _driven(code, conditions, road, distance)
    try:
        own = _driven(code, conditions, road, distance)
    except UserError:
        return _driven(code, conditions, road, distance, mended=conditions.mended)
    mended = _driven(code, conditions, road, distance, mended=conditions.mended)
    return own if own.score >= mended.score else mended


def _driven(
    code: JudgedCode,
    conditions: Conditions,
    road: Road,
    distance: float,
    duration: float = MAX_DURATION,
    mended: str = '',
) -> Drive:
    """Drive over a road once; an error of the code on the way names the call."""
    plant = Plant(road=road)
    pid = _Limited(code, conditions, mended)
    progress = Progress(distance)
    try:
        log = closed_loop(plant, pid, distance=distance, max_duration=duration, progress=progress)
    except UserError as error:
        if NOT_WRITTEN in str(error):
            raise
        time = (pid.calls - 1) * plant.ts
        raise UserError(f'call {pid.calls}, after {time:.2f} s on the road: {error}') from error
    return Drive(log, progress.failure, conditions, mended)


@dataclass(frozen=True)
class Drive:
    """A drive over one road."""

    log: Log
    failure: str  #: what the car does that never arrives
    conditions: Conditions
    mended: str = ''  #: letters of the terms that were put right

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
        (rms, maximum), by = self.errors, self.conditions.thresholds
        shares = (
            (by.zero_rms - rms) / (by.zero_rms - by.full_rms),
            (by.zero_max - maximum) / (by.zero_max - by.full_max),
        )
        # NaN is no error that is small.
        return sum(min(1.0, share) if share > 0.0 else 0.0 for share in shares) / len(shares)

    def describe(self) -> str:
        """Return a sentence on the errors."""
        if self.failure:
            limit = f'; its output is {self.limit:g} m/s² at most' if isfinite(self.limit) else ''
            return f'{self.failure}{limit}'
        (rms, maximum), by = self.errors, self.conditions.thresholds
        mended = f'with {" and ".join(self.mended)} put right: ' if self.mended else ''
        return (
            f'{mended}RMS error {rms:.3f} m/s after the first 10 m, at most {maximum:.3f} m/s '
            f'({by.full_rms:g} and {by.full_max:g} m/s are full marks)'
        )

    @property
    def stretches(self) -> list[Stretch]:
        """Each stretch of one grade."""
        log, limit = self.log, self.limit
        changes = np.flatnonzero(np.diff(log.theta_deg)) + 1
        stretches: list[Stretch] = []
        for first, last in pairwise([0, *changes.tolist(), len(log)]):
            part, error = slice(first, last), log.speed_error[first:last]
            remark = _of_stretch(log, part, limit) if first else _of_start(log, part, limit)
            stretches.append(
                Stretch(
                    start=float(log.distance[first]),
                    theta_deg=float(log.theta_deg[first]),
                    rms_error=float(np.sqrt(np.mean(error**2))),
                    max_error=float(np.abs(error).max()),
                    remark=remark,
                )
            )
        return stretches

    def worst_stretch(self) -> str:
        """Return a sentence on the stretch with the largest RMS error; empty at full marks."""
        if self.score == 1.0:
            return ''
        _, *later = stretches = self.stretches
        worst = max(later or stretches, key=lambda stretch: stretch.rms_error)
        return f'. From {worst.start:.0f} m on, at {worst.theta_deg:g}°: {worst.remark}'


_BACKWARDS = 'the car drives backwards: is the error speed_reference - speed_current?'
_HELD = 0.05  #: [m/s] An error up to this is negligible.
_NEAR = 0.02  #: share of the reference within which it counts as reached
_LONG_LIMIT = 0.1  #: [s] An output at its limit for a shorter time has no effect.
_OWN_LIMIT = 25  #: calls: code that returns its largest output for longer has a limit of its own
# Shares of the maximum error on a stretch:
_CARRIED = 0.6  #: that the stretch starts with
_SWINGS, _SWING = 4, 0.3  #: that a swing reaches, and how many count
_STEADY = 0.5  #: that is left at the end, or on the other side


def _of_start(log: Log, part: slice, limit: float) -> str:
    """Return what the speed does on the first stretch."""
    error, speed, reference = log.speed_error[part], log.speed[part], float(log.reference[0])
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


def _of_stretch(log: Log, part: slice, limit: float) -> str:
    """Return what the speed does after a change of grade: what was measured, and no advice."""
    error = log.speed_error[part]
    peak = float(np.abs(error).max())
    slopes = np.sin(np.radians(log.theta_deg[[part.start - 1, part.start]]))
    change = GRAVITY * float(np.diff(slopes)[0])
    needs = f'needs {abs(change):.1f} m/s² {"more" if change > 0.0 else "less"} at once'
    if peak <= _HELD:
        return f'{needs}: held within {_HELD:g} m/s'
    if limited := _of_output(log, part, limit):
        return f'{needs}: {limited}'
    if swings := _swings(error):
        return f'{needs}: {swings}'
    if abs(float(error[0])) >= _CARRIED * peak:
        return f'starts {abs(error[0]):.2f} m/s off, from the stretch before: {_end(error)}'
    return f'{needs}: {_of_error(error, np.sign(change))}'


def _of_output(log: Log, part: slice, limit: float) -> str:
    """Return how long the output was at its limit; empty if that was too short to matter."""
    saturated = np.abs(log.motor[part]) >= limit
    limited = log.motor[part][saturated]
    if _sign_changes(limited) >= _SWINGS:
        return f'the output jumps between its limits of {limit:g} m/s²'
    time, against = (
        float(np.count_nonzero(each)) * TS
        for each in (saturated, limited * log.speed_error[part][saturated] < 0.0)
    )
    if time <= _LONG_LIMIT:
        return ''
    counter = f', {against:.1f} s of it against the error' if against else ''
    return f'the output was at its limit of {limit:g} m/s² for {time:.1f} s{counter}'


def _swings(error: Floats) -> str:
    """Return how often and how far the speed swings; empty if it does not."""
    swings = _sign_changes(error[np.abs(error) > _SWING * np.abs(error).max()])
    if swings < _SWINGS:
        return ''
    return f'the speed swings {swings} times, by up to {np.abs(error).max():.2f} m/s'


def _of_error(error: Floats, sign: float) -> str:
    """Return how the error goes on; it begins with `sign`."""
    peak = float(np.abs(error).max())
    rest = float(np.mean(error[-max(len(error) // 5, 1) :]))
    if abs(rest) > _STEADY * peak:
        return f'{abs(rest):.2f} m/s too {"slow" if rest > 0.0 else "fast"} at its end'
    over = float(np.max(-sign * error))
    if over > max(_STEADY * peak, _HELD):
        return f'overshoots by {over:.2f} m/s'
    return f'{peak:.2f} m/s off, {_end(error)}'


def _sign_changes(values: Floats) -> int:
    return int(np.count_nonzero(np.diff(np.sign(values))))


def _end(error: Floats) -> str:
    """Return when the error was gone."""
    beyond = np.flatnonzero(np.abs(error) > max(0.1 * float(np.abs(error).max()), 0.01))
    if beyond.size and beyond[-1] + 1 == len(error):
        return 'not gone at the end of this one'
    return f'gone after {(beyond[-1] + 1 if beyond.size else 0) * TS:.1f} s'
