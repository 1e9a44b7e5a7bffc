"""Explains the speed error on each stretch of a road, in the terms of the lab."""

from __future__ import annotations

from itertools import pairwise
from math import inf, isfinite, radians, sin
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.lab.check.model import TS
from barc_sim.vehicle.bike_model import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.simulation.log import Log

Gains = tuple[float, float, float]  #: kp, ki, kd

_HELD = 0.05  #: [m/s] An error up to this is negligible.
_LONG_LIMIT = 0.1  #: [s] An output at its limit for a shorter time has no effect.
_NEAR = 0.02  #: share of the reference within which it counts as reached
_CARRIED = 0.6  #: share of the greatest error that the stretch starts with
_SWINGS = 4
_SWING = 0.3  #: share of the greatest error that a swing reaches
_AGAINST = 0.2  #: share of the limited outputs that act against the error
_STEADY = 0.5  #: share of the greatest error that is left at the end


class Stretch(NamedTuple):
    """A stretch of road, with the speed error on it and its cause."""

    start: float  #: [m]
    end: float  #: [m]
    theta_deg: float
    rms_error: float  #: [m/s]
    max_error: float  #: [m/s] greatest absolute error
    cause: str


def explain(log: Log, gains: Gains, limit: float = inf) -> list[Stretch]:
    """Return each stretch of one grade, with the cause of its speed error.

    `limit` is that of the output [m/s²].
    """
    changes = np.flatnonzero(np.diff(log.theta_deg)) + 1
    edges = [0, *changes.tolist(), len(log)]
    explanations = []
    before = 0.0
    for first, last in pairwise(edges):
        part = slice(first, last)
        theta = float(log.theta_deg[first])
        error = log.speed_error[part]
        explanations.append(
            Stretch(
                start=float(log.distance[first]),
                end=float(log.distance[last - 1]),
                theta_deg=theta,
                rms_error=float(np.sqrt(np.mean(error**2))),
                max_error=float(np.max(np.abs(error))),
                cause=_Part(log, part, before, gains, limit).explain()
                if first
                else _explain_start(log, part, limit),
            )
        )
        before = theta
    return explanations


def describe_worst(stretches: Sequence[Stretch]) -> str:
    """Return a sentence on the stretch with the greatest RMS error, the first one left out."""
    stretch = max(stretches[1:] or stretches, key=lambda stretch: stretch.rms_error)
    return f'From {stretch.start:.0f} m on, at {stretch.theta_deg:g}°: {stretch.cause}'


def _explain_start(log: Log, part: slice, limit: float) -> str:
    speed, reference = log.speed[part], float(log.reference[part.start])
    error = log.speed_error[part]
    near = np.flatnonzero(np.abs(error) <= _NEAR * abs(reference))
    if not near.size:
        if speed.min() < -_HELD:
            return 'the car drives backwards: is the error speed_reference - speed_current?'
        return f'{reference:g} m/s is not reached: the greatest speed is {speed.max():.2f} m/s'
    text = f'{near[0] * TS:.2f} s to {reference:g} m/s'
    if isfinite(limit):
        text += f', where {limit:g} m/s² allow {reference / limit:.2f} s'
    over = -float(error.min())
    if over > _NEAR * reference:
        text += f'; then {over:.2f} m/s too fast: ' + (
            'the integral grew while the output was at its limit, or ki is large for this kp'
            if isfinite(limit)
            else 'ki or kp is large'
        )
    return text


class _Part:
    """A stretch of a run, with the acceleration that its grade needs."""

    def __init__(
        self, log: Log, part: slice, theta_before: float, gains: Gains, limit: float
    ) -> None:
        self.limit = limit
        self.error = log.speed_error[part]
        self.peak = float(np.max(np.abs(self.error)))
        limited = log.saturated[part]
        self.limited = log.motor[part][limited]  # [m/s²] the outputs at the limit
        self.against = int(np.count_nonzero(self.limited * self.error[limited] < 0.0))
        needed = GRAVITY * sin(radians(float(log.theta_deg[part.start])))
        self.change = needed - GRAVITY * sin(radians(theta_before))
        self.kp, self.ki, self.kd = gains

    def explain(self) -> str:
        needs = (
            f'needs {abs(self.change):.1f} m/s² {"more" if self.change > 0.0 else "less"} at once'
        )
        if self.peak <= _HELD:
            return f'{needs}: held within {_HELD:g} m/s'
        if np.count_nonzero(np.diff(np.sign(self.limited))) >= _SWINGS:
            return (
                f'the output jumps between its limits of {self.limit:g} m/s²: ki or kd is '
                'large for this kp'
            )
        carried = abs(float(self.error[0]))
        if carried >= _CARRIED * self.peak:
            time, end = self._settled(), len(self.error) * TS
            gone = f'gone after {time:.1f} s' if time < end else 'not gone at the end of this one'
            return f'starts {carried:.2f} m/s off, from the stretch before: {gone}'
        return f'{needs}: {self._cause()}'

    def _cause(self) -> str:
        if (time := len(self.limited) * TS) > _LONG_LIMIT:
            why = 'the motor cannot give more'
            if self.against > _AGAINST * len(self.limited):
                why = (
                    f'{self.against * TS:.1f} s of it against the error: the integral has wound up'
                )
            elif self.kp <= 0.0:
                why = 'with kp = 0 the integral alone swings: use kp'
            return f'the output was at its limit of {self.limit:g} m/s² for {time:.1f} s, {why}'
        if (swings := self._swings()) >= _SWINGS:
            return f'the speed swings {swings} times: ki or kd is large for this kp'
        if self.kp <= 0.0:
            return 'with kp = 0 the integral alone is slow, and swings: use kp'
        alone = f'kp = {self.kp:g} gives that at an error of {abs(self.change) / self.kp:.2f} m/s'
        rest = float(np.mean(self.error[-max(len(self.error) // 5, 1) :]))
        if abs(rest) > _STEADY * self.peak:
            return f'{alone}, {self._left(rest)}'
        over = float(np.max(-self.error if self.change > 0.0 else self.error))
        if over >= _STEADY * self.peak and over > _HELD:
            return f'overshoots by {over:.2f} m/s: use less ki, or more kp'
        return (
            f'{alone}, the integral removes the error in {self._settled():.1f} s: more kp makes '
            'the error smaller, more ki makes it shorter'
        )

    def _left(self, rest: float) -> str:
        if self.ki <= 0.0:
            return f'and with ki = 0 it stays at {rest:+.2f} m/s: use ki'
        gathered = self.ki * float(np.sum(self.error)) * TS
        return (
            f'the integral could add {gathered:+.1f} m/s² in these {len(self.error) * TS:.1f} s, '
            f'and {rest:+.2f} m/s are left: use more ki'
        )

    def _swings(self) -> int:
        """Return how often the error swings from one side to the other."""
        large = self.error[np.abs(self.error) > _SWING * self.peak]
        return int(np.count_nonzero(np.diff(np.sign(large))))

    def _settled(self) -> float:
        """Return the time [s] after which the error stays small."""
        beyond = np.flatnonzero(np.abs(self.error) > max(0.1 * self.peak, 0.01))
        return float(beyond[-1] + 1) * TS if beyond.size else 0.0
