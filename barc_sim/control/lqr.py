"""A linear-quadratic regulator of the speed, with an estimate of what hills and air do."""

from __future__ import annotations

from math import inf, isfinite, sqrt
from typing import TYPE_CHECKING

from barc_sim.control.controller import Gain, check_gains

if TYPE_CHECKING:
    from collections.abc import Mapping


def feedback_gain(speed_weight: float, effort_weight: float, dt: float) -> float:
    """Return K [1/s] that minimizes Σ q e² + r a² for e⁺ = e - dt a, by a = K e.

    The scalar Riccati equation P = q + P - (dt P)² / (r + dt² P) has one positive root::

        P = (q dt² + √(q² dt⁴ + 4 q r dt²)) / (2 dt²)      K = dt P / (r + dt² P)

    (Åström and Wittenmark, "Computer-Controlled Systems", 11.3.)
    """
    weighted = speed_weight * dt * dt
    cost = (weighted + sqrt(weighted * (weighted + 4.0 * effort_weight))) / (2.0 * dt * dt)
    return dt * cost / (effort_weight + dt * dt * cost)


class LQR:
    """A linear-quadratic regulator with a disturbance observer, and limited output.

    With the error e = reference - measurement, and d the acceleration that is not commanded
    (gravity along the road, drag, friction), each interval dt::

        d ← d + l (Δmeasurement / dt - u_before - d)      u = K e - d

    K is the solution of the scalar Riccati equation for the weights q = `speed_weight` of the
    error and r = `effort_weight` of the acceleration. The observer, with gain l = `observer_gain`
    from 0 to 1, uses the output after the limits, and so does not wind up (Åström and Wittenmark,
    "Computer-Controlled Systems", 11.4: a Luenberger observer of a constant disturbance).

    The first sample, and one after a sample that is not finite, has no predecessor: d stands still.

    Examples
    --------
    >>> from barc_sim import simulate, summary
    >>> log = simulate(controller=LQR(speed_weight=100.0))
    >>> print(f'{summary(log).rms_error_after_run_up:.3f} m/s')
    0.020 m/s
    """

    gains: Mapping[str, Gain] = {
        'speed_weight': Gain(400.0, '1/s²', 'weight of the speed error', 2000.0, (1e-3, 1e6)),
        'effort_weight': Gain(1.0, '-', 'weight of the acceleration', 10.0, (1e-3, 1e6)),
        'observer_gain': Gain(0.5, '-', 'gain of the disturbance observer', 1.0, (0.0, 1.0)),
    }
    terms: Mapping[str, str] = {
        'feedback': 'K times the error',
        'compensation': 'the estimated disturbance, negative',
    }

    def __init__(
        self,
        speed_weight: float = gains['speed_weight'].default,
        effort_weight: float = gains['effort_weight'].default,
        observer_gain: float = gains['observer_gain'].default,
        *,
        dt: float = 0.02,
        output_min: float = -inf,
        output_max: float = inf,
    ) -> None:
        """Start at rest; `dt` [s] is the interval that K is made for."""
        self.speed_weight = speed_weight
        self.effort_weight = effort_weight
        self.observer_gain = observer_gain
        self.dt = dt
        self.output_min = output_min
        self.output_max = output_max
        check_gains(self)
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next call is the first."""
        self.feedback = 0.0
        self.compensation = 0.0
        self.saturated = False
        self._output = 0.0
        self._previous: float | None = None

    def acc_calculate(
        self, speed_reference: float, speed_current: float, dt: float | None = None
    ) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        dt = self.dt if dt is None else dt
        if self._previous is not None and dt > 0.0:
            disturbance = (speed_current - self._previous) / dt - self._output
            if isfinite(disturbance):
                self.compensation -= self.observer_gain * (disturbance + self.compensation)
        error = speed_reference - speed_current
        self._previous = speed_current if isfinite(error) else None

        self.feedback = feedback_gain(self.speed_weight, self.effort_weight, self.dt) * error
        raw = self.feedback + self.compensation
        self._output = min(max(raw, self.output_min), self.output_max)
        self.saturated = raw < self.output_min or raw > self.output_max
        return self._output
