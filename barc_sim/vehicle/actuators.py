"""Actuators: delay, limits and lag between a command and its effect; each is off by default."""

from __future__ import annotations

from collections import deque
from math import copysign, expm1, inf
from typing import Annotated, NamedTuple

from barc_sim.vehicle.bike_model import Command
from barc_sim.vehicle.limits import limited

#: Share of a step within which a delay counts as whole steps.
_WHOLE = 1e-6


@limited
class Actuator(NamedTuple):
    """An actuator's parameters; with the defaults a command takes effect at once.

    A command u takes effect `delay` later, cut to `limit`. The value w follows it by

        dw/dt = (u - w) / lag, cut to ±rate

    The unit is the command's: [m/s²] for the motor, [rad] for the servo.

    Examples
    --------
    >>> from barc_sim import Actuator, LaneLQR, simulate
    >>> late = Actuator(delay=0.1, rate=1.0)
    >>> log = simulate(track='oval', lane=LaneLQR(), servo=late, distance=60.0)
    >>> print(f'{abs(log.e_y).max():.2f} m off the lane at most')
    0.05 m off the lane at most
    """

    delay: Annotated[float, 'time from a command to its effect [s]', 0.0, 10.0] = 0.0
    lag: Annotated[float, 'time constant [s]', 0.0, 100.0] = 0.0
    rate: Annotated[float, 'maximum change [unit/s]', 1e-300, inf] = inf
    limit: Annotated[float, 'maximum either way [unit]', 0.0, inf] = inf

    def respond(self, value: float, target: float, t: float) -> tuple[float, float]:
        """Return where `t` > 0 seconds of a held `target` take `value`, and the mean meanwhile.

        The solution is exact: a ramp at `rate` as long as the lag alone would be faster, and
        the exponential from there on.
        """
        _, lag, rate, _ = self
        error = target - value
        excess = abs(error) - (rate * lag if lag else 0.0)
        ramp = min(excess / rate, t) if excess > 0.0 else 0.0
        ramp_end = value + copysign(rate, error) * ramp if ramp else value
        remaining, error = t - ramp, target - ramp_end
        if not remaining:
            return ramp_end, 0.5 * (value + ramp_end)
        decayed = -expm1(-remaining / lag) if lag else 1.0
        mean_of_decay = target - error * decayed * lag / remaining
        ramp_share = ramp / t
        mean = ramp_share * 0.5 * (value + ramp_end) + (1.0 - ramp_share) * mean_of_decay
        return target - error * (1.0 - decayed), mean


def in_steps(delay: float, ts: float) -> tuple[int, float]:
    """Return a delay in whole steps of `ts` seconds, and the share of a step beyond them."""
    whole, share = divmod(delay / ts, 1.0)
    return (
        (int(whole), share) if _WHOLE < share < 1.0 - _WHOLE else (int(whole + round(share)), 0.0)
    )


class ActuatorState:
    """One actuator at work, in steps of a fixed length.

    Commands wait in a queue, one per step. A delay that is no multiple of the step is kept to
    exactly: the older of two commands acts for the first part of a step, the newer for the rest
    (Åström and Wittenmark, "Computer-Controlled Systems", 3rd ed., section 2.3).
    """

    early: float  #: share of a step for which the older command still acts

    def __init__(self, actuator: Actuator, ts: float) -> None:
        """Begin at zero, in steps of `ts` seconds, with only zeros commanded before."""
        self._ts = ts
        self.value = 0.0  #: where the actuator is now
        self._queue = deque([0.0, 0.0])
        self.replace(actuator)

    @property
    def waiting(self) -> list[float]:
        """The commands that are still to act; the oldest acts in the early part of a step."""
        return [*self._queue][1:]

    @property
    def only_delays(self) -> bool:
        """Whether commands act unchanged, though later."""
        return self._actuator == Actuator(delay=self._actuator.delay)

    def replace(self, actuator: Actuator) -> None:
        """Work as `actuator` from now on; commands on their way stay on it.

        Where the delay is shorter, the oldest of them are dropped; where it is longer, the one that
        acts now acts meanwhile.
        """
        self._actuator = actuator
        self._is_ideal = actuator == Actuator()
        whole, self.early = in_steps(actuator.delay, self._ts)
        size = whole + 2
        _, acting, *waiting = self._queue
        self._queue = deque([*[acting] * (size - len(waiting)), *waiting], maxlen=size)

    def advance(self, command: float) -> float:
        """Go one step after `command`; return the mean of the value over the step."""
        self._queue.append(command)
        if self._is_ideal:
            self.value = command
            return command + 0.0  # as the sum below, which is never -0
        newer = self._cut(self._queue[1])
        early = self.early
        if not early:
            self.value, mean = self._actuator.respond(self.value, newer, self._ts)
            return mean + 0.0
        older = self._cut(self._queue[0])
        self.value, mean = self._actuator.respond(self.value, older, early * self._ts)
        self.value, late = self._actuator.respond(self.value, newer, (1.0 - early) * self._ts)
        return early * mean + (1.0 - early) * late

    def hold(self, value: float) -> None:
        """Set the value, as if it had been commanded for long."""
        self.value = value
        self._queue.extend([value] * len(self._queue))

    def _cut(self, command: float) -> float:
        limit = self._actuator.limit
        return command if -limit <= command <= limit else copysign(limit, command)


class Actuators:
    """Motor and servo: from the commanded to the actual acceleration and steering."""

    def __init__(self, motor: Actuator, servo: Actuator, ts: float) -> None:
        """Begin at rest, in steps of `ts` seconds."""
        self.motor, self.servo = ActuatorState(motor, ts), ActuatorState(servo, ts)
        self.is_ideal = motor == servo == Actuator()  #: each command takes effect at once
        self.now = Command()  #: acceleration and steering at this instant

    def advance(self, command: Command) -> Command:
        """Go one step after `command`; return the mean acceleration and steering over it."""
        if self.is_ideal:
            self.now = command
            return command
        mean = Command(self.motor.advance(command.motor), self.servo.advance(command.servo))
        self.now = Command(self.motor.value, self.servo.value)
        return mean

    def replace(self, motor: Actuator, servo: Actuator) -> None:
        """Work as these actuators from now on; commands on their way stay on it."""
        states = ((self.motor, motor, self.now.motor), (self.servo, servo, self.now.servo))
        for state, actuator, now in states:
            if self.is_ideal:  # nothing is on its way, and the state has had no part so far
                state.hold(now)
            state.replace(actuator)
        self.is_ideal = motor == servo == Actuator()

    def stop(self) -> None:
        """Set both to zero, and drop the waiting commands."""
        self.motor.hold(0.0)
        self.servo.hold(0.0)
        self.now = Command()

    def brake(self, command: Command) -> Command:
        """Go one step with the acceleration of `command` in force at once.

        The brakes have no delay, lag or limit. The motor is cut off meanwhile, and begins anew
        from zero.
        """
        self.motor.hold(0.0)
        servo = self.servo.advance(command.servo)
        self.now = Command(command.motor, self.servo.value)
        return Command(command.motor, servo)
