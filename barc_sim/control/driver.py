"""Driving by hand: turns a driver's input into acceleration and steering, within the car's limits.

A `geometry_msgs/Twist` holds the driver's input in shares from -1 to 1: `linear.x` of the greatest
acceleration or deceleration, `angular.z` of the greatest steering rate. A negative `linear.z` is
the brake: that share of the greatest deceleration, against the direction of travel, down to a
standstill, while the wheel returns to straight. The brake stays on until the next input, even
after its Twist is stale. Zero is coasting.

An input against the motion (down while driving forward) brakes to a standstill and no further. To
reverse, release the key and press it again. The lab's car reverses at once.
"""

from __future__ import annotations

from math import copysign, inf, isfinite
from typing import NamedTuple

from barc_sim.vehicle.bike_model import Command

RATE = 20.0  #: [Hz] commands per second; the lab's template has dt = 0.05
STALE_AFTER = 0.5  #: [s] An older Twist is ignored.
#: [m/s] Slower than this the car may set off either way.
STANDSTILL = 0.05


class DriverInput(NamedTuple):
    """What a driver asks for, in shares from -1 to 1.

    Examples
    --------
    >>> DriverInput(forward=1.0)
    DriverInput(forward=1.0, turn=0.0, brake=0.0)
    """

    forward: float = 0.0  #: `linear.x`, of acceleration or deceleration
    turn: float = 0.0  #: `angular.z`, of the steering rate, positive to the left
    brake: float = 0.0  #: `linear.z` where negative, its opposite: from 0 to 1

    @property
    def usable(self) -> bool:
        """Whether all shares are finite."""
        return all(map(isfinite, self))


COAST = DriverInput()
FULL_BRAKE = DriverInput(brake=1.0)


class Limits(NamedTuple):
    """Limits of the car when it is driven by hand.

    Examples
    --------
    >>> Limits(speed=10.0).speed
    10.0
    """

    acceleration: float = 4.0  #: [m/s²] in the direction of travel
    deceleration: float = 8.0  #: [m/s²] against it
    speed: float = 20.0  #: [m/s] either way
    steering: float = 0.5  #: [rad] front steering angle, either way
    steering_rate: float = 1.0  #: [rad/s]
    self_centring: bool = True  #: the wheel returns to straight, at this rate, when released


class Driver:
    """Turns the driver's latest input into a command every `dt`.

    Attributes
    ----------
    limits
        May be replaced at any time.
    request
        The input that the latest command follows.
    servo
        [rad] the latest command's.

    Examples
    --------
    >>> driver = Driver()
    >>> driver.receive(DriverInput(forward=0.5), t=0.0)
    >>> driver.command(t=0.1, speed=3.0)
    Command(motor=2.0, servo=0.0)
    """

    def __init__(
        self,
        limits: Limits | None = None,
        *,
        dt: float = 1.0 / RATE,
        stale_after: float = STALE_AFTER,
    ) -> None:
        """Begin with the wheel straight, coasting.

        Parameters
        ----------
        limits
            The defaults unless given.
        dt
            [s] from one command to the next.
        stale_after
            [s] An input that is older is ignored.
        """
        self.limits = limits or Limits()
        self.dt = dt
        self.stale_after = stale_after
        self.reset()

    def reset(self) -> None:
        """Forget the input, and put the wheel straight."""
        self._latest = self.request = COAST
        self._received = -inf
        self.servo = 0.0
        self._braking = 0.0  # sign of the request that brakes the car, until it is released

    def receive(self, request: DriverInput, t: float) -> None:
        """Store a usable `request`, received at `t` [s]; shares are limited to -1 and 1."""
        self._latest = DriverInput(
            limited(request.forward, 1.0),
            limited(request.turn, 1.0),
            limited(max(request.brake, 0.0), 1.0),
        )
        self._received = t

    def command(self, t: float, speed: float) -> Command:
        """Return the command from `t` [s] on, at a true speed of `speed` [m/s]."""
        stale = t - self._received > self.stale_after
        self.request = request = COAST if stale and not self._latest.brake else self._latest
        self._steer(request)
        return Command(motor=self._acceleration(request, speed), servo=self.servo)

    def _steer(self, request: DriverInput) -> None:
        limits, turned = self.limits, self.limits.steering_rate * self.dt
        if request.brake or (limits.self_centring and not request.turn):
            self.servo -= limited(self.servo, turned)
        elif request.turn:
            self.servo += request.turn * turned
        self.servo = limited(self.servo, limits.steering)

    def _acceleration(self, request: DriverInput, speed: float) -> float:
        limits, forward = self.limits, request.forward
        if request.brake or not forward:
            self._braking = 0.0
            return self._towards(0.0, speed, request.brake * limits.deceleration)
        direction = copysign(1.0, forward)
        if speed * direction < -STANDSTILL:
            self._braking = direction
        elif self._braking != direction:
            self._braking = 0.0
        if self._braking:
            return self._towards(0.0, speed, abs(forward) * limits.deceleration)
        return self._towards(direction * limits.speed, speed, abs(forward) * limits.acceleration)

    def _towards(self, target: float, speed: float, limit: float) -> float:
        """Return the acceleration, up to `limit`, that leads to `target` and not past it.

        Half of what would do it in `dt`: a command may hold for a little longer than that.
        """
        return limited((target - speed) / (2.0 * self.dt), limit)


def limited(value: float, limit: float) -> float:
    """Return `value`, or the nearer of ±`limit` beyond it.

    Examples
    --------
    >>> limited(-3.0, 1.0)
    -1.0
    """
    return max(-limit, min(value, limit))
