"""Why the speed was off, stretch by stretch of the road, in the words of the lab."""

from __future__ import annotations

from itertools import pairwise
from math import radians, sin
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.control.pid import ACCELERATION_LIMIT
from barc_sim.lab.check.situations import TS
from barc_sim.vehicle.bike_model import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.simulation.log import Log

Gains = tuple[float, float, float]  #: kp, ki, kd

_HELD = 0.05  #: [m/s] An error that is no more is none to speak of.
_LONG_CUT = 0.1  #: [s] An output that is cut for no longer does no harm.
_NEAR = 0.02  #: share of the reference within which it counts as reached
_CARRIED = 0.6  #: share of the greatest error that is there from the beginning
_SWINGS = 4
_SWING = 0.3  #: share of the greatest error that a swing reaches
_ASTRAY = 0.2  #: share of the cut outputs that push the wrong way
_STEADY = 0.5  #: share of the greatest error that is still there at the end: it does not go away


class Explained(NamedTuple):
    """A stretch of road and what happened on it."""

    start: float  #: [m]
    end: float  #: [m]
    theta_deg: float
    rms_error: float  #: [m/s]
    max_error: float  #: [m/s] greatest absolute error
    why: str


def why(log: Log, gains: Gains) -> list[Explained]:
    """Return for each stretch of one grade why the speed's error on it was what it was."""
    changes = np.flatnonzero(np.diff(log.theta_deg)) + 1
    edges = [0, *changes.tolist(), len(log)]
    explained = []
    before = 0.0
    for first, last in pairwise(edges):
        part = slice(first, last)
        theta = float(log.theta_deg[first])
        error = log.speed_error[part]
        explained.append(
            Explained(
                start=float(log.distance[first]),
                end=float(log.distance[last - 1]),
                theta_deg=theta,
                rms_error=float(np.sqrt(np.mean(error**2))),
                max_error=float(np.max(np.abs(error))),
                why=_Part(log, part, before, gains).why() if first else _set_off(log, part),
            )
        )
        before = theta
    return explained


def worst(stretches: Sequence[Explained]) -> str:
    """Return what to say of the stretch with the greatest RMS, the first left out if possible."""
    stretch = max(stretches[1:] or stretches, key=lambda stretch: stretch.rms_error)
    return f'From {stretch.start:.0f} m on, at {stretch.theta_deg:g}°: {stretch.why}'


def _set_off(log: Log, part: slice) -> str:
    speed, reference = log.speed[part], float(log.reference[part.start])
    error = log.speed_error[part]
    near = np.flatnonzero(np.abs(error) <= _NEAR * abs(reference))
    if not near.size:
        if speed.min() < -_HELD:
            return 'the car drives backwards: is the error speed_reference - speed_current?'
        return f'{reference:g} m/s is not reached: the speed gets to {speed.max():.2f} m/s'
    said = (
        f'{near[0] * TS:.2f} s to {reference:g} m/s, where {ACCELERATION_LIMIT:g} m/s² allow '
        f'{reference / ACCELERATION_LIMIT:.2f} s'
    )
    over = -float(error.min())
    if over > _NEAR * reference:
        said += (
            f'; then {over:.2f} m/s too fast: the integral grew while the output was cut, or ki is '
            'large for this kp'
        )
    return said


class _Part:
    """A stretch of a run, with what its grade asks of the motor."""

    def __init__(self, log: Log, part: slice, theta_before: float, gains: Gains) -> None:
        self.error = log.speed_error[part]
        self.peak = float(np.max(np.abs(self.error)))
        cut = log.saturated[part]
        self.cut = log.motor[part][cut]  # [m/s²] the outputs that were cut
        self.astray = int(np.count_nonzero(self.cut * self.error[cut] < 0.0))
        needed = GRAVITY * sin(radians(float(log.theta_deg[part.start])))
        self.change = needed - GRAVITY * sin(radians(theta_before))
        self.kp, self.ki, self.kd = gains

    def why(self) -> str:
        needs = (
            f'needs {abs(self.change):.1f} m/s² {"more" if self.change > 0.0 else "less"} at once'
        )
        if self.peak <= _HELD:
            return f'{needs}: held within {_HELD:g} m/s'
        if np.count_nonzero(np.diff(np.sign(self.cut))) >= _SWINGS:
            return (
                f'the output jumps between its limits of {ACCELERATION_LIMIT:g} m/s²: ki or kd is '
                'large for this kp'
            )
        carried = abs(float(self.error[0]))
        if carried >= _CARRIED * self.peak:
            time, end = self._settled(), len(self.error) * TS
            gone = f'gone after {time:.1f} s' if time < end else 'not gone by the end of this one'
            return f'begins {carried:.2f} m/s off, from the stretch before: {gone}'
        return f'{needs}: {self._cause()}'

    def _cause(self) -> str:
        if (cut := len(self.cut) * TS) > _LONG_CUT:
            return (
                f'the output was cut at {ACCELERATION_LIMIT:g} m/s² for {cut:.1f} s, {self._cut()}'
            )
        if (swings := self._swings()) >= _SWINGS:
            return f'the speed swings {swings} times: ki or kd is large for this kp'
        if self.kp <= 0.0:
            return 'with kp = 0 the integral alone is slow, and swings: use kp'
        alone = (
            f'kp = {self.kp:g} alone gives that at an error of {abs(self.change) / self.kp:.2f} m/s'
        )
        rest = float(np.mean(self.error[-max(len(self.error) // 5, 1) :]))
        if abs(rest) > _STEADY * self.peak:
            return f'{alone}, {self._left(rest)}'
        over = float(np.max(-self.error if self.change > 0.0 else self.error))
        if over >= _STEADY * self.peak and over > _HELD:
            return f'taken up, then {over:.2f} m/s beyond: less ki, or more kp'
        return (
            f'{alone}, the integral takes up the rest in {self._settled():.1f} s: more kp makes '
            'the error smaller, more ki shorter'
        )

    def _cut(self) -> str:
        if self.astray > _ASTRAY * len(self.cut):
            return f'{self.astray * TS:.1f} s of it against the error: the integral has wound up'
        if self.kp <= 0.0:
            return 'with kp = 0 the integral alone swings: use kp'
        return 'more than that the motor can not do'

    def _left(self, rest: float) -> str:
        if self.ki <= 0.0:
            return f'and with ki = 0 it stays at {rest:+.2f} m/s: use ki'
        gathered = self.ki * float(np.sum(self.error)) * TS
        return (
            f'the integral could add {gathered:+.1f} m/s² in these {len(self.error) * TS:.1f} s, '
            f'and {rest:+.2f} m/s are left: more ki'
        )

    def _swings(self) -> int:
        """Return how often the error changes its sign between good parts of its peak."""
        large = self.error[np.abs(self.error) > _SWING * self.peak]
        return int(np.count_nonzero(np.diff(np.sign(large))))

    def _settled(self) -> float:
        """Return after which time [s] the error is small."""
        beyond = np.flatnonzero(np.abs(self.error) > max(0.1 * self.peak, 0.01))
        return float(beyond[-1] + 1) * TS
