"""Driving by hand: what a driver wants -> acceleration and steering, limits and all.

A `geometry_msgs/Twist` is read as a driver's wish in shares from -1 to 1: `linear.x` of the
greatest acceleration or deceleration, `angular.z` of the greatest steering rate. A negative
`linear.z` is the brake: that share of the greatest deceleration against whichever way the car
moves, down to a standstill, with the wheel going straight. The brake stays on until something else
is wished for, even where its Twist has gone stale. Zero is coasting.

A wish against the motion (down while driving forward) brakes to a standstill and no further: to
reverse, let go and press again. The lab's car would reverse at once.
"""

from __future__ import annotations

from math import copysign, inf, isfinite
from typing import NamedTuple

from barc_sim.vehicle.bike_model import Input

RATE = 20.0  #: [Hz] commands per second; the lab's template has dt = 0.05
STALE_AFTER = 0.5  #: [s]
#: [m/s] Slower than this the car may set off either way.
STANDSTILL = 0.05


class Drive(NamedTuple):
    """A driver's wish, in shares from -1 to 1."""

    forward: float = 0.0  #: `linear.x`, of acceleration or deceleration
    turn: float = 0.0  #: `angular.z`, of the steering rate, positive to the left
    brake: float = 0.0  #: `linear.z` where negative, its opposite: from 0 to 1

    @property
    def usable(self) -> bool:
        """Whether every share is finite."""
        return all(map(isfinite, self))


COAST = Drive()
FULL_BRAKE = Drive(brake=1.0)


class Limits(NamedTuple):
    """What the car is allowed."""

    acceleration: float = 4.0  #: [m/s²] in the direction of travel
    deceleration: float = 8.0  #: [m/s²] against it
    speed: float = 20.0  #: [m/s] either way
    steering: float = 0.5  #: [rad] front steering angle, either way
    steering_rate: float = 1.0  #: [rad/s]
    self_centring: bool = True  #: the wheel returns to straight, at this rate, when let go


class Driver:
    """Turns the wishes heard into a command every `dt`.

    Attributes
    ----------
    limits
        May be replaced at any time.
    wish
        What is wished for as of the latest command.
    servo
        [rad] the latest command's.
    """

    def __init__(
        self,
        limits: Limits | None = None,
        *,
        dt: float = 1.0 / RATE,
        stale_after: float = STALE_AFTER,
    ) -> None:
        """Begin with the wheel straight and nothing wished for.

        Parameters
        ----------
        limits
            The defaults unless given.
        dt
            [s] from one command to the next.
        stale_after
            [s] A wish that is older counts no more.
        """
        self.limits = limits or Limits()
        self.dt = dt
        self.stale_after = stale_after
        self.reset()

    def reset(self) -> None:
        """Forget all that was heard, and put the wheel straight."""
        self._heard_wish = self.wish = COAST
        self._heard = -inf
        self.servo = 0.0
        self._braking = 0.0  # the sign of the wish that brought the car to where it is

    def hear(self, wish: Drive, t: float) -> None:
        """Take a usable `wish` at `t` [s]; what is beyond -1 and 1 is cut off."""
        self._heard_wish = Drive(
            _limited(wish.forward, 1.0),
            _limited(wish.turn, 1.0),
            _limited(max(wish.brake, 0.0), 1.0),
        )
        self._heard = t

    def command(self, t: float, speed: float) -> Input:
        """Return the command from `t` [s] on, at a true speed of `speed` [m/s]."""
        stale = t - self._heard > self.stale_after
        self.wish = wish = COAST if stale and not self._heard_wish.brake else self._heard_wish
        self._steer(wish)
        return Input(motor=self._acceleration(wish, speed), servo=self.servo)

    def _steer(self, wish: Drive) -> None:
        limits, turned = self.limits, self.limits.steering_rate * self.dt
        if wish.brake or (limits.self_centring and not wish.turn):
            self.servo -= _limited(self.servo, turned)
        elif wish.turn:
            self.servo += wish.turn * turned
        self.servo = _limited(self.servo, limits.steering)

    def _acceleration(self, wish: Drive, speed: float) -> float:
        limits, forward = self.limits, wish.forward
        if wish.brake or not forward:
            self._braking = 0.0
            return self._towards(0.0, speed, wish.brake * limits.deceleration)
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
        return _limited((target - speed) / (2.0 * self.dt), limit)


def _limited(value: float, limit: float) -> float:
    return max(-limit, min(value, limit))
