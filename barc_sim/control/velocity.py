"""Driving by velocity: turns a Twist in m/s and rad/s, as REP-103 has it, into commands.

The speed is tracked by a PI controller, within the car's limits::

    a = k_p e + ∫ k_i e dt          e = linear.x - v_x

The integral is for hills. It moves only where the speed is nearly constant, so that what is left to
speed up or to brake is not part of it, and the car does not overshoot.

The steering follows from the bicycle's geometry, whose yaw rate is v_x tan(δ) / L::

    δ = atan(L angular.z / linear.x)

The path has the curvature that is asked for while the car speeds up, too, because `linear.x` is
the speed in this equation. A car cannot turn on the spot: with a `linear.x` of zero it stops, and
its wheels turn as far as they go. A zero Twist stops the car with its wheels straight, and so does
silence for longer than `stale_after`.
"""

from __future__ import annotations

from math import atan2, copysign
from typing import TYPE_CHECKING

from barc_sim.control.driver import STANDSTILL, Driver, DriverInput, Limits, limited
from barc_sim.control.pid import PID
from barc_sim.vehicle.bike_model import L_F, L_R

if TYPE_CHECKING:
    from typing import Any

_KP = 8.0  #: [1/s] time constant of 0.125 s, two and a half of the relay's periods
_KI = 8.0  #: [1/s²] removes the effect of a hill in about 2 s
_STEADY = 0.5  #: [m/s²] With less, the speed is as good as constant.


class VelocityDriver(Driver):
    """Turns the latest velocity that is asked for into a command every `dt`.

    Attributes
    ----------
    wheelbase
        L, from axle to axle [m]; may be changed at any time.

    Examples
    --------
    >>> driver = VelocityDriver()
    >>> driver.receive(DriverInput(forward=3.0), t=0.0)
    >>> driver.command(t=0.05, speed=3.0).motor
    0.0
    >>> driver.command(t=5.0, speed=3.0).motor
    -8.0
    """

    def __init__(self, limits: Limits | None = None, **options: Any) -> None:  # noqa: ANN401
        """Begin at rest; the options are those of `Driver`."""
        self.wheelbase = L_F + L_R
        self._pi = PID(_KP, _KI, 0.0)
        super().__init__(limits, **options)

    def reset(self) -> None:
        """Forget the input, and put the wheel straight."""
        super().reset()
        self._pi.reset()

    def receive(self, request: DriverInput, t: float) -> None:
        """Store a usable `request` [m/s, rad/s], received at `t` [s]; the speed is limited."""
        self._latest = request._replace(
            forward=limited(request.forward, self.limits.speed),
            brake=limited(max(request.brake, 0.0), 1.0),
        )
        self._received = t

    def _steer(self, request: DriverInput) -> None:
        limits = self.limits
        servo = self._angle(request) if request.turn and not request.brake else 0.0
        change = limits.steering_rate * self.dt
        self.servo += limited(limited(servo, limits.steering) - self.servo, change)

    def _angle(self, request: DriverInput) -> float:
        """Return the steering angle [rad] that turns the car at the rate that is asked for."""
        direction = copysign(1.0, request.forward)
        return atan2(self.wheelbase * request.turn * direction, abs(request.forward))

    def _acceleration(self, request: DriverInput, speed: float) -> float:
        """Return the acceleration [m/s²] towards the speed that is asked for."""
        limits, pi = self.limits, self._pi
        if request.brake:
            pi.reset()
            return super()._acceleration(request, speed)
        forward = speed if abs(speed) > STANDSTILL else request.forward - speed
        pi.output_min, pi.output_max = -limits.deceleration, limits.acceleration
        if forward < 0.0:
            pi.output_min, pi.output_max = -limits.acceleration, limits.deceleration
        steady = pi.previous is not None and abs(speed - pi.previous) < _STEADY * self.dt
        return pi.acc_calculate(request.forward, speed, self.dt if steady else 0.0)
