"""Many cars at once: the laws of controller and vehicle for NumPy arrays, in step.

`PIDs` and `next_speeds` are `pid_step` and `next_speed` once more, to the last bit: in place, on
arrays that stay in a core's cache. Rare events (a limit reached, a car that stands or rolls back)
are detected with one reduction and handled apart. The search for gains and the environments for
learning both drive with them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.vehicle.bike_model import resistance

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from barc_sim.vehicle.bike_model import Vehicle

    Floats = NDArray[np.float64]


@dataclass
class PIDs:
    """`PID` for many cars; an array has an element for each, of a number all have the same."""

    low: float  #: [m/s²] limits of the output
    high: float
    dt: float  #: [s]
    kp: Floats | float
    ki: Floats | float
    minus_kd: Floats | float
    integral: Floats  #: [m/s²]
    previous: Floats  #: [m/s] the latest measurement; before the first step the present one

    def control(
        self, measured: Floats, reference: Floats | float, interval: Floats | float
    ) -> Floats:
        """Return the commands [m/s²]; `interval` is `dt`, or 0 where nothing is integrated yet."""
        error = reference - measured
        increment: Floats = self.ki * error
        increment *= interval
        derivative = measured - self.previous
        derivative *= self.minus_kd
        derivative /= self.dt
        wanted = self.kp * error
        for term in (self.integral, increment, derivative):
            wanted += term
        command: Floats = np.minimum(wanted, self.high)
        np.maximum(command, self.low, out=command)
        wanted -= command
        wanted *= increment
        into_limit = wanted > 0.0
        if into_limit.any():
            increment[into_limit] = 0.0
        self.integral += increment
        self.previous[:] = measured
        return command


def next_speeds(
    v: Floats, a: Floats, gravity_force: Floats | float, vehicle: Vehicle, ts: float
) -> Floats:
    """Return the speeds [m/s] one step of `ts` seconds after `v`: `next_speed` for arrays.

    The fields of `vehicle` may be arrays, too.
    """
    opposing: Any = resistance(v, vehicle)  # type: ignore[arg-type]  # arrays
    forwards = v.min() > 0.0
    if not forwards:
        opposing *= np.sign(v)
    after: Floats = v + ts * (a + (gravity_force - opposing) / vehicle.mass)
    if not forwards or after.min() < 0.0:
        # Resistance slows the car to a standstill and never pulls it backwards.
        free = v + ts * (a + gravity_force / vehicle.mass)
        np.maximum(after, np.minimum(free, 0.0), out=after, where=v > 0.0)
        np.minimum(after, np.maximum(free, 0.0), out=after, where=v < 0.0)
    return after
