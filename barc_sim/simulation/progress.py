"""The rule that ends the run of a car that never arrives."""

from __future__ import annotations

from math import inf, isfinite

#: [s] of simulated time without progress, after which the run ends.
STALL_TIMEOUT = 20.0
#: The run ends once a car at the speed to hold would have driven the distance so many times.
MAX_DISTANCE_FACTOR = 10.0
_ADVANCE = 0.01  #: [m] that counts as progress
_STANDS = 0.05  #: [m/s] below which a car stands
_JUMP = 1.0  #: [m] in one step, beyond what its speed explains: the car was put elsewhere
_BETWEEN_JUMPS = 1.0  #: [s] a person needs to put the car elsewhere again
_BACKWARDS = 1.0  #: [m] behind the start


class Progress:
    """Follows a car towards the end of its road, state by state.

    Attributes
    ----------
    failure
        What the car does, in a sentence, where the run is to end; empty otherwise.
    """

    def __init__(self, distance: float) -> None:
        """Follow the car to `distance` [m]; with infinity, no run is ended."""
        self._distance = distance
        self._since = 0.0  # [s] of the last progress
        self._expected = 0.0  # [m] that a car at the speed to hold has driven
        self._best = self._x = -inf
        self._t = self._v = 0.0
        self._jumped = -inf  # [s]
        self._equal = 0  # latest states in a row whose position is a speed
        self._may_stand = False
        self.failure = ''

    def add(self, t: float, x: float, v: float, reference: float) -> bool:
        """Take a state, [s], [m], [m/s], [m/s]; return whether the run is to end.

        A car may stand while its reference is 0, once that was positive.
        """
        jumps = v == 0.0 and not abs(x - self._x) <= _JUMP + abs(self._v)
        placed = jumps and t - self._jumped > _BETWEEN_JUMPS
        if jumps:
            self._jumped = t
        self._expected += max(reference, 0.0) * (t - self._t)
        if placed:
            self._best, self._expected = x, 0.0
        if placed or x > self._best + _ADVANCE:
            self._best, self._since = x, t
        if self._may_stand and reference <= 0.0:
            self._since = t
        self._may_stand = self._may_stand or reference > 0.0
        self._equal = self._equal + 1 if x in (v, self._v) else 0
        moved = x != self._x
        self._t, self._x, self._v = t, x, v
        self.failure = ''
        if self._distance == inf or x >= self._distance:
            return False
        if t - self._since > STALL_TIMEOUT:
            end = f'it got no further for {STALL_TIMEOUT:g} s'
        elif self._expected > MAX_DISTANCE_FACTOR * self._distance:
            end = f'at the speed to hold it would have driven {MAX_DISTANCE_FACTOR:g} times the way'
        else:
            return False
        self.failure = f'the car {self._does(moved=moved)}; {end}'
        return True

    def _does(self, *, moved: bool) -> str:
        """Return what the car does, with the cause where the states show it."""
        x, v = self._x, self._v
        if not isfinite(x):
            return f'has no position: the model returns {x} for x'
        if self._equal > 1 and abs(v) > _STANDS:
            return f'stands at {x:.1f} m: the model returns the speed in place of x'
        if not moved:
            speed = f', and its speed is {v:.2f} m/s: the model does not change x'
            return f'stands at {x:.1f} m' + (
                speed if abs(v) > _STANDS else ': the commands do not move it'
            )
        if x < -_BACKWARDS and self._best < _BACKWARDS:
            return f'drives backwards, to {x:.4g} m: is the error speed_reference - speed_current?'
        if abs(v) <= _STANDS:
            return f'is at {x:.1f} m, and hardly moves: the commands do not move it'
        return f'is at {x:.1f} m, at {v:.2f} m/s, and was at {self._best:.1f} m'
