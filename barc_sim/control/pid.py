"""The PID speed controller."""

from __future__ import annotations

from math import inf, isfinite
from typing import TYPE_CHECKING

from barc_sim.control.controller import Gain, check_gains
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Mapping

#: The run's gains. On the lab's road: 0.021 m/s RMS and 0.126 m/s at most after the first 10 m.
KP, KI, KD = 30.0, 200.0, 0.1
#: Of a gain: a user's controller may have its error the other way round.
_EITHER_SIGN = (-1e6, 1e6)
SPEED_REFERENCE = 8.0
ACCELERATION_LIMIT = 8.0
#: [m/s²] Stands for none: the lab's car has no limit.
NO_LIMIT = 1e6
#: [s] dt of a controller's first call, which has no call before it: the lab's step.
FIRST_DT = 0.02


def pid_step(
    reference: float,
    measured: float,
    previous: float,
    integral: float,
    dt: float,
    kp: float,
    ki: float,
    kd: float,
    low: float,
    high: float,
) -> tuple[float, float, float, float, bool]:
    """Return output, P, I, D and whether the output is limited: one sample of the law of `PID`.

    Parameters
    ----------
    reference, measured, previous
        [m/s] wanted, measured and previously measured speed.
    integral
        [m/s²] I up to the previous sample.
    dt
        [s] since the previous sample; 0 for the first, to which `previous` does not matter.
    kp, ki, kd, low, high
        Gains, and limits of the output [m/s²].
    """
    error = reference - measured
    proportional = kp * error
    if dt > 0.0:
        increment = ki * error * dt
        derivative = -kd * (measured - previous) / dt
    else:
        increment = derivative = 0.0
    output = proportional + integral + increment + derivative
    saturated = False
    if output > high:
        output = high
        saturated = True
        increment = min(increment, 0.0)
    elif output < low:
        output = low
        saturated = True
        increment = max(increment, 0.0)
    return output, proportional, integral + increment, derivative, saturated


class PID:
    """A PID controller in parallel form, with limited output.

    With the error e = reference - measurement, over each interval dt::

        u = kp e + I + D      I = Σ ki e dt      D = -kd Δmeasurement / dt

    and the output is `u` limited to `[output_min, output_max]`.

    - Anti-windup is by conditional integration ("clamping"; Åström and Hägglund, "Advanced PID
      Control", 3.5): where the output is limited, the integral does not move further into
      the limit.
    - The derivative is that of the measurement, so that a changed reference does not kick, and the
      first sample, which has no predecessor, has no derivative and adds nothing to the integral.
    - The integral has the unit of the output: a changed `ki` applies from then on.
    - Where `dt` is not positive (two samples of one instant), I stands still and D is zero.
    - A sample that is not finite has no effect on later ones: `u` follows it (NaN gives NaN), but
      I stands still, and the next sample counts as the first.

    The arithmetic is `pid_step`. Gains and limits can be changed at any time.

    Attributes
    ----------
    proportional, integral, derivative, saturated
        [m/s²] the terms of the latest call, and whether its output was limited.
    previous
        [m/s] the latest measurement; None: the next call is the first.

    Examples
    --------
    >>> pid = PID(kp=2.0, ki=0.5, kd=0.0, output_max=8.0)
    >>> pid.acc_calculate(8.0, 7.0)
    2.0
    >>> pid.acc_calculate(8.0, 7.0, dt=0.02)
    2.01
    """

    gains: Mapping[str, Gain] = {
        'kp': Gain(KP, '1/s', 'proportional gain', 100.0, _EITHER_SIGN),
        'ki': Gain(KI, '1/s²', 'integral gain', 400.0, _EITHER_SIGN),
        'kd': Gain(KD, '-', 'derivative gain', 5.0, _EITHER_SIGN),
    }
    terms: Mapping[str, str] = {
        'proportional': 'kp times the error',
        'integral': 'the integral of ki times the error',
        'derivative': 'kd times the rate of change of the measured speed, negative',
    }

    #: Gains that show what each term does, by the name that the page's button has.
    presets: Mapping[str, Mapping[str, float]] = {
        'P': {'kp': 4.0, 'ki': 0.0, 'kd': 0.0},
        'PI': {'kp': 4.0, 'ki': 8.0, 'kd': 0.0},
        'PID': {'kp': 4.0, 'ki': 8.0, 'kd': 0.5},
        'Tuned': {'kp': KP, 'ki': KI, 'kd': KD},
        'Too much I': {'kp': 0.3, 'ki': 40.0, 'kd': 0.0},
    }

    def __init__(
        self,
        kp: float = KP,
        ki: float = KI,
        kd: float = KD,
        *,
        dt: float = 0.02,
        output_min: float = -inf,
        output_max: float = inf,
    ) -> None:
        """Start at rest; `dt` [s] is the interval between calls that do not give one.

        Raises
        ------
        UserError
            where a gain is not in its limits, or `output_min` not below `output_max`.
        """
        if not output_min < output_max:
            raise UserError(f'output_min={output_min!r} must be below output_max={output_max!r}')
        self.kp = kp
        self.ki = ki
        self.kd = kd
        self.dt = dt
        self.output_min = output_min
        self.output_max = output_max
        check_gains(self)
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next call is the first."""
        self.proportional = 0.0
        self.integral = 0.0
        self.derivative = 0.0
        self.saturated = False
        self.previous: float | None = None

    def acc_calculate(
        self, speed_reference: float, speed_current: float, dt: float | None = None
    ) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        dt = self.dt if dt is None else dt
        previous, dt = (self.previous, dt) if self.previous is not None else (0.0, 0.0)
        output, self.proportional, integral, self.derivative, self.saturated = pid_step(
            speed_reference,
            speed_current,
            previous,
            self.integral,
            dt,
            self.kp,
            self.ki,
            self.kd,
            self.output_min,
            self.output_max,
        )
        if isfinite(output):
            self.integral = integral
        self.previous = speed_current if isfinite(speed_reference - speed_current) else None
        return output


def speed_controller(
    kp: float = KP, ki: float = KI, kd: float = KD, limit: float = ACCELERATION_LIMIT
) -> PID:
    """Return the run's controller: a PID whose output is within ±`limit` [m/s²]."""
    return PID(kp, ki, kd, output_min=-limit, output_max=limit)
