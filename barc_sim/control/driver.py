"""Driving by hand: turns a driver's input into acceleration and steering, within the car's limits.

A `geometry_msgs/Twist` holds the driver's input in shares from -1 to 1: `linear.x` of the maximum
acceleration or deceleration, `angular.z` of the maximum steering rate. A negative `linear.z` is
the brake: that share of the maximum deceleration, against the direction of travel, down to a
standstill, while the wheel returns to straight. The brake stays on until the next input, even
after its Twist is stale. Zero is coasting.

An input against the motion (down while driving forward) brakes to a standstill and no further. To
reverse, release the key and press it again. The lab's car reverses at once.
"""

from __future__ import annotations

from math import copysign, inf, isfinite
from typing import TYPE_CHECKING, Annotated, NamedTuple

from barc_sim.interfaces.parameters import ParameterDeclaration, parameters_of
from barc_sim.interfaces.records import Command

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

RATE = 20.0  #: [Hz] commands per second; the lab's template has dt = 0.05
STALE_AFTER = 0.5  #: [s] An older Twist is ignored.
#: [m/s] Slower than this the car may set off either way.
STANDSTILL = 0.05


class DriverInput(NamedTuple):
    """What a driver asks for, in shares from -1 to 1."""

    forward: float = 0.0  #: `linear.x`, of acceleration or deceleration
    turn: float = 0.0  #: `angular.z`, of the steering rate, positive to the left
    brake: float = 0.0  #: `linear.z` where negative, its opposite: from 0 to 1


COAST = DriverInput()
FULL_BRAKE = DriverInput(brake=1.0)


class DriverLimits(NamedTuple):
    """Limits of the car when it is driven by hand."""

    acceleration: Annotated[float, 'maximum acceleration [m/s²]', 0.0, 100.0] = 4.0
    deceleration: Annotated[float, 'maximum deceleration [m/s²]', 0.0, 100.0] = 8.0
    speed: Annotated[float, 'maximum speed, either way [m/s]', 0.0, 100.0] = 20.0
    steering: Annotated[float, 'maximum front angle, either way [rad]', 0.0, 1.5] = 0.5
    steering_rate: Annotated[float, 'maximum change of the front angle [rad/s]', 0.0, 100.0] = 1.0
    #: The wheel returns to straight when released; if not, left and right change its angle.
    self_centring: Annotated[
        bool, 'whether the wheel returns to straight when released', -inf, inf
    ] = True


class Driver:
    """Turns the driver's latest input into a command every `dt`."""

    def __init__(
        self,
        limits: DriverLimits | None = None,
        *,
        dt: float = 1.0 / RATE,
        stale_after: float = STALE_AFTER,
    ) -> None:
        """Begin with the wheel straight, coasting.

        Commands are `dt` [s] apart; an input older than `stale_after` [s] is ignored.
        """
        self.limits = limits or DriverLimits()  #: may be replaced at any time
        self.dt = dt
        self.stale_after = stale_after
        self.reset()

    def configure(self, values: Mapping[str, Any]) -> None:
        """Set some of the parameters in `PARAMETERS`."""
        limits = {name: value for name, value in values.items() if name in DriverLimits._fields}
        self.limits = self.limits._replace(**limits)
        self.stale_after = values.get('stale_after', self.stale_after)

    def reset(self) -> None:
        """Forget the input, and put the wheel straight."""
        self._latest = COAST
        self.request = COAST  #: the input that the latest command follows
        self._received = -inf
        self._speed = 0.0
        self.servo = 0.0
        self._braking = 0.0  # sign of the request that brakes the car, until it is released

    def receive(self, request: DriverInput, t: float) -> bool:
        """Store a `request`, received at `t` [s]; return False if it is refused as not finite."""
        if not all(map(isfinite, request)):
            return False
        self._latest = DriverInput(
            limited(request.forward, 1.0),
            limited(request.turn, 1.0),
            limited(max(request.brake, 0.0), 1.0),
        )
        self._received = t
        return True

    def command(self, t: float, speed: float) -> Command:
        """Return the command from `t` [s] on, at `speed` [m/s]; the last finite one counts."""
        self._speed = speed if isfinite(speed) else self._speed
        is_stale = t - self._received > self.stale_after
        self.request = COAST if is_stale and not self._latest.brake else self._latest
        self._steer(self.request)
        return Command(motor=self._acceleration(self.request, self._speed), servo=self.servo)

    def _steer(self, request: DriverInput) -> None:
        limits = self.limits
        change = limits.steering_rate * self.dt
        if request.brake or (limits.self_centring and not request.turn):
            self.servo -= limited(self.servo, change)
        elif request.turn:
            self.servo += request.turn * change
        self.servo = limited(self.servo, limits.steering)

    def _acceleration(self, request: DriverInput, speed: float) -> float:
        limits = self.limits
        forward = request.forward
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
        """Return the acceleration, up to `limit`, that leads to the speed `target` and not past it.

        It is half of the value that reaches it within `dt`, because a command can hold a little
        longer.
        """
        return limited((target - speed) / (2.0 * self.dt), limit)


#: The parameters of the node `relay`.
PARAMETERS = [
    *parameters_of(DriverLimits),
    ParameterDeclaration(
        'stale_after', STALE_AFTER, 'age above which a Twist is ignored [s]', (0.05, 60.0)
    ),
]


def limited(value: float, limit: float) -> float:
    """Return `value`, clipped to ±`limit`."""
    return max(-limit, min(value, limit))
