"""The rule that ends the run of a car that never arrives."""

from __future__ import annotations

from math import inf

#: [s] of simulated time without progress, after which the run ends.
PATIENCE = 20.0
#: So many times as long as the distance needs at the speed to hold, the run may take.
TIMES = 10.0
_ADVANCE = 0.01  #: [m] that counts as progress
_STANDS = 0.05  #: [m/s] below which a car stands
_JUMP = 1.0  #: [m] beyond a second's drive, in one step to rest: the car was put elsewhere


class Progress:
    """Follows a car towards the end of its road, state by state.

    Attributes
    ----------
    failure
        A sentence on what the car does, once it will not arrive; empty until then.
    """

    def __init__(self, distance: float) -> None:
        """Expect the car at `distance` [m]; infinity expects nothing."""
        self._distance = distance
        self._start = self._since = 0.0  # [s] of the first state, and of the last progress
        self._best = self._x = -inf
        self._v = 0.0
        self._as_speed = 0  # consecutive states whose position equals a speed
        self._may_stand = False
        self.failure = ''

    def add(self, t: float, x: float, v: float, reference: float) -> bool:
        """Take a state, [s], [m], [m/s], [m/s]; return whether the run is to end.

        While a reference that was positive is not, no time counts as lost.
        """
        placed = v == 0.0 and abs(x - self._x) > _JUMP + abs(self._v)
        if placed:
            self._start, self._best = t, x
        if placed or x > self._best + _ADVANCE or (self._may_stand and reference <= 0.0):
            self._best, self._since = max(x, self._best), t
        self._may_stand = self._may_stand or reference > 0.0
        self._as_speed = self._as_speed + 1 if x in (v, self._v) else 0
        moved = x != self._x
        self._x, self._v = x, v
        self.failure = ''
        if self._distance < inf and not x >= self._distance:  # NaN is not there, either
            taken = t - self._start
            needed = self._distance / reference if reference > 0.0 else inf
            if t - self._since > PATIENCE:
                end = f'it got no further for {PATIENCE:g} s'
            elif taken > TIMES * needed:
                end = f'{self._distance:g} m need {needed:.0f} s, and {taken:.0f} s have passed'
            else:
                return False
            self.failure = f'the car {self._does(moved=moved)}; {end}'
        return bool(self.failure)

    def _does(self, *, moved: bool) -> str:
        """Return what the car does, with the cause where the states show it."""
        x, v = self._x, self._v
        if self._as_speed > 1 and abs(v) > _STANDS:
            return f'stands at {x:.1f} m: the model returns the speed in place of x'
        if x < -_JUMP and self._best < _JUMP:
            return f'drives backwards, to {x:.4g} m: is the error speed_reference - speed_current?'
        if not moved and abs(v) > _STANDS:
            return f'stands at {x:.1f} m, and its speed is {v:.2f} m/s: the model does not change x'
        if abs(v) <= _STANDS:
            return f'stands at {x:.1f} m: the commands do not move it'
        return f'is at {x:.1f} m, at {v:.2f} m/s, and was at {self._best:.1f} m'
