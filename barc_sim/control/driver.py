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

from math import atan2, copysign, inf, isfinite
from typing import TYPE_CHECKING, Annotated, NamedTuple

from barc_sim.control.speed import PID
from barc_sim.errors import Parameter, UserError, parameters_of
from barc_sim.vehicle.bike_model import L_F, L_R, Command
from barc_sim.vehicle.parameters import PARAMETERS as CAR

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

RATE = 20.0  #: [Hz] commands per second; the lab's template has dt = 0.05
STALE_AFTER = 0.5  #: [s] An older Twist is ignored.
#: [m/s] Slower than this the car may set off either way.
STANDSTILL = 0.05
# The PI controller of the requested speed:
_KP = 8.0  #: [1/s] time constant of 0.125 s, two and a half of the relay's periods
_KI = 8.0  #: [1/s²] removes the effect of a hill in about 2 s
_STEADY = 0.5  #: [m/s²] With less, the speed is as good as constant.


class DriverInput(NamedTuple):
    """What a driver asks for, in shares from -1 to 1."""

    forward: float = 0.0  #: `linear.x`, of acceleration or deceleration
    turn: float = 0.0  #: `angular.z`, of the steering rate, positive to the left
    brake: float = 0.0  #: `linear.z` where negative, its opposite: from 0 to 1


COAST = DriverInput()
FULL_BRAKE = DriverInput(brake=1.0)


class Limits(NamedTuple):
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
        limits: Limits | None = None,
        *,
        dt: float = 1.0 / RATE,
        stale_after: float = STALE_AFTER,
    ) -> None:
        """Begin with the wheel straight, coasting.

        Commands are `dt` [s] apart; an input older than `stale_after` [s] is ignored.
        """
        self.limits = limits or Limits()  #: may be replaced at any time
        self.dt = dt
        self.stale_after = stale_after
        self.reset()

    def configure(self, values: Mapping[str, Any]) -> None:
        """Set some of the parameters in `PARAMETERS`."""
        limits = {name: value for name, value in values.items() if name in Limits._fields}
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
        """Store a `request`, received at `t` [s]; return False if it is not finite, and refused."""
        if not all(map(isfinite, request)):
            return False
        self._latest = self._within_limits(request)
        self._received = t
        return True

    def _within_limits(self, request: DriverInput) -> DriverInput:
        return DriverInput(
            limited(request.forward, 1.0),
            limited(request.turn, 1.0),
            limited(max(request.brake, 0.0), 1.0),
        )

    def command(self, t: float, speed: float) -> Command:
        """Return the command from `t` [s] on, at `speed` [m/s]; the last finite one counts."""
        self._speed = speed if isfinite(speed) else self._speed
        stale = t - self._received > self.stale_after
        self.request = request = COAST if stale and not self._latest.brake else self._latest
        self._steer(request)
        return Command(motor=self._acceleration(request, self._speed), servo=self.servo)

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


class VelocityDriver(Driver):
    """Turns the latest requested velocity, m/s and rad/s as in REP-103, into a command every `dt`.

    The speed is tracked by a PI controller, within the car's limits::

        a = k_p e + ∫ k_i e dt          e = linear.x - v_x

    The integral is for hills. It moves only where the speed is nearly constant: so it does not
    grow while the car speeds up or brakes, and the car does not overshoot.

    The steering follows from the bicycle's geometry, whose yaw rate is v_x tan(δ) / L::

        δ = atan(L angular.z / linear.x)

    `linear.x` is the speed in this equation, so that the path has the requested curvature while
    the car speeds up, too. A car cannot turn on the spot: with a `linear.x` of zero it stops, and
    its wheels turn as far as they go. A zero Twist stops the car with its wheels straight, and so
    does silence for longer than `stale_after`.
    """

    def __init__(self, limits: Limits | None = None, **options: Any) -> None:  # noqa: ANN401
        """Begin at rest; the options are those of `Driver`."""
        self.wheelbase = L_F + L_R  #: [m] L, from axle to axle; may be changed at any time
        self._pi = PID(_KP, _KI, 0.0)
        super().__init__(limits, **options)

    def reset(self) -> None:
        """Forget the input, and put the wheel straight."""
        super().reset()
        self._pi.reset()

    def configure(self, values: Mapping[str, Any]) -> None:
        """Set some of the parameters in `PARAMETERS`."""
        super().configure(values)
        if {'l_f', 'l_r'} <= values.keys():
            self.wheelbase = values['l_f'] + values['l_r']

    def _within_limits(self, request: DriverInput) -> DriverInput:
        return request._replace(
            forward=limited(request.forward, self.limits.speed),
            brake=limited(max(request.brake, 0.0), 1.0),
        )

    def _steer(self, request: DriverInput) -> None:
        limits = self.limits
        servo = self._angle(request) if request.turn and not request.brake else 0.0
        change = limits.steering_rate * self.dt
        self.servo += limited(limited(servo, limits.steering) - self.servo, change)

    def _angle(self, request: DriverInput) -> float:
        """Return the steering angle [rad] that turns the car at the requested rate."""
        direction = copysign(1.0, request.forward)
        return atan2(self.wheelbase * request.turn * direction, abs(request.forward))

    def _acceleration(self, request: DriverInput, speed: float) -> float:
        """Return the acceleration [m/s²] towards the requested speed."""
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


#: What a Twist means, by the value of the parameter `input`.
INPUTS: dict[str, type[Driver]] = {'pedal': Driver, 'velocity': VelocityDriver}
PEDAL = 'pedal'
#: The parameters of the node `relay`.
PARAMETERS = [
    Parameter(
        'input',
        PEDAL,
        "what a Twist means: 'pedal', shares of the limits below, from -1 to 1; or 'velocity', the "
        'speed linear.x [m/s] and the yaw rate angular.z [rad/s], as in REP-103',
        read_only=True,
    ),
    *parameters_of(Limits),
    Parameter('stale_after', STALE_AFTER, 'age above which a Twist is ignored [s]', (0.05, 60.0)),
    # The car's geometry, from which the velocity's steering follows.
    *(each for each in CAR if each.name in ('l_f', 'l_r')),
]


def make_driver(values: Mapping[str, Any], driver: Driver | None = None) -> Driver:
    """Return `driver`, or barc_sim's own for the parameter `input`; set its parameters."""
    meaning = values['input']
    if meaning not in INPUTS:
        raise UserError(
            f'parameter input of relay is {meaning!r}: expected one of {", ".join(INPUTS)}'
        )
    if driver and meaning != PEDAL:
        raise UserError(
            f'parameter input of relay is {meaning!r}, which is for the relay of barc_sim: a '
            "relay of one's own gets each Twist as shares of the limits"
        )
    driver = driver or INPUTS[meaning]()
    driver.configure(values)
    return driver


def limited(value: float, limit: float) -> float:
    """Return `value`, or the nearer of ±`limit` beyond it."""
    return max(-limit, min(value, limit))
