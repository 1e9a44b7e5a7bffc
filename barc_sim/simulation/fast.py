"""Many cars as NumPy arrays: `PIDs`, `Actuators` and `Plants`, with the laws of one car.

Tests compare them with one car to rounding, because NumPy's functions differ from Python's in the
last bit.
"""

from __future__ import annotations

from math import inf, nan, radians
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.vehicle.bicycles import euler, kinematic_rates, rates
from barc_sim.vehicle.bike_model import (
    Command,
    Motion,
    State,
    resistance,
)
from barc_sim.vehicle.plant import in_steps
from barc_sim.vehicle.track import Frenet

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from barc_sim.control.speed import PID
    from barc_sim.vehicle.bicycles import LateralParameters
    from barc_sim.vehicle.plant import Actuator, Plant
    from barc_sim.vehicle.track import Track

    Floats = NDArray[np.float64]
    #: The numbers of some cars.
    Cars = NDArray[np.intp]
    #: An array where the type says a number, or a record of such.
    Arrays = Any


_NONE = 1e-30  #: share of a step, or [s], that changes nothing: in place of 0
_NO_LAG = 1e-15  #: [s] far longer than that, and far shorter than a step


def _pid(
    pid: PID, reference: float, dt: float, measured: Floats, previous: Floats, integral: Floats
) -> tuple[Floats, ...]:
    """Return the proportional term, the integral's increment, the derivative, output and command.

    They are arrays of the numbers of `PID.acc_calculate`; a `previous` speed of NaN means the first
    call.
    """
    error, first = reference - measured, np.isnan(previous)
    proportional = pid.kp * error
    increment = np.where(first, 0.0, pid.ki * error * dt)
    derivative = np.where(first, 0.0, -pid.kd * (measured - previous) / dt)
    output = proportional + integral + increment + derivative
    command = np.minimum(np.maximum(output, pid.output_min), pid.output_max)
    return proportional, increment, derivative, output, command


#: The functions of `math` that `bicycles` uses, for arrays.
_FUNCTIONS = SimpleNamespace(sin=np.sin, cos=np.cos, hypot=np.hypot, atan2=np.arctan2)


class PIDs:
    """`PID` for many cars, with the same law."""

    def __init__(self, n: int, like: PID) -> None:
        """Start at rest."""
        self._like = like
        self._integral, self._previous = np.zeros(n), np.full(n, nan)

    def reset(self, cars: Cars) -> None:
        """Reset these cars: the next call is their first."""
        self._integral[cars], self._previous[cars] = 0.0, nan

    def acc_calculate(self, reference: float, measured: Floats, dt: float) -> Floats:
        """Return the accelerations [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        before = self._previous, self._integral
        _, increment, _, output, command = _pid(self._like, reference, dt, measured, *before)
        increment[(output - command) * increment > 0.0] = 0.0  # further into the limit
        self._integral += increment
        self._previous[:] = measured
        return command


class Actuators:
    """`ActuatorState` for many cars, whose delays may differ."""

    def __init__(self, n: int, actuator: Actuator, ts: float, max_delay: float) -> None:
        """Begin at zero; `max_delay` [s] is the maximum delay that `delay` can set."""
        self._lag, self._rate, self._limit = max(actuator.lag, _NO_LAG), *actuator[2:]
        self._ts, self._cars, self._step = ts, np.arange(n), 0
        self.value = np.zeros(n)
        self._queue = np.zeros((in_steps(max(max_delay, actuator.delay), ts)[0] + 2, n))
        self._whole, self._early = np.zeros(n, np.intp), np.zeros(n)
        self.delay(self._cars, np.full(n, actuator.delay))

    def delay(self, cars: Cars, delays: Floats) -> None:
        """Delay these cars' commands by `delays` [s] from now on."""
        steps = np.array([in_steps(delay, self._ts) for delay in delays.tolist()]).reshape(-1, 2)
        self._whole[cars], self._early[cars] = steps.T
        self._delays, self._splits = bool(self._whole.any()), bool(self._early.any())

    def stop(self, cars: Cars) -> None:
        """Set these cars' actuators to zero, and drop their waiting commands."""
        self.value[cars] = self._queue[:, cars] = 0.0

    def advance(self, command: Floats) -> Arrays:
        """Take a step with `command`; return the mean values over it."""
        if self._limit < inf:
            command = np.clip(command, -self._limit, self._limit)
        if not (self._delays or self._splits):
            return self._respond(command, self._ts)
        self._step += 1
        self._queue[self._step % len(self._queue)] = command
        newer = self._ago(self._whole)
        if not self._splits:
            return self._respond(newer, self._ts)
        early = np.maximum(self._early, _NONE)
        mean = early * self._respond(self._ago(self._whole + 1), early * self._ts)
        return mean + (1.0 - early) * self._respond(newer, (1.0 - early) * self._ts)

    def _ago(self, steps: NDArray[np.intp]) -> Floats:
        ago: Floats = self._queue[(self._step - steps) % len(self._queue), self._cars]
        return ago

    def _respond(self, target: Floats, t: Floats | float) -> Floats:
        """Follow `target` for `t` seconds; return the mean values, as `Actuator.respond` does."""
        lag, rate, value = self._lag, self._rate, self.value
        if lag == _NO_LAG and rate == inf:
            self.value = target.copy()
            return target
        error = target - value
        ramp = np.minimum(np.maximum(np.abs(error) - rate * lag, 0.0) / rate, t)
        ramp_end = value + np.copysign(min(rate, 1e300), error) * ramp
        remaining, error = np.maximum(t - ramp, _NONE), target - ramp_end
        moved = error * -np.expm1(-remaining / lag)
        mean_of_decay = target - moved * lag / remaining
        share = ramp / t
        self.value = ramp_end + moved
        mean: Floats = share * 0.5 * (value + ramp_end) + (1.0 - share) * mean_of_decay
        return mean


class Plants:
    """Many plants as arrays, stepped by forward Euler; it has the names of `Plant`.

    The laws are those of `bicycles`.
    """

    def __init__(self, n: int, like: Plant, max_delay: float) -> None:
        """Make `n` plants like one; delays stay up to `max_delay` [s]; `place` starts them."""
        self.ts, self.track, self.road, self.vehicle = like.ts, like.track, like.road, like.vehicle
        self._lateral: LateralParameters | None = getattr(like.bicycle, 'lateral', None)
        self.motor, self.servo = (
            Actuators(n, state.actuator, self.ts, max_delay)
            for state in (like.actuators.motor, like.actuators.servo)
        )
        self.state: Arrays = State(*np.zeros((4, n)))
        self._slip = np.zeros((3, n))  # v_x, v_y [m/s] and psi_dot [rad/s] of the dynamic bicycle
        self.frenet: Arrays = Frenet(*np.zeros((4, n))) if like.track else None
        self.steps = np.zeros(n, np.intp)  #: since each was placed
        self.lap, self._is_whole = np.zeros(n, np.intp), np.zeros(n, np.bool_)
        self.lap_time, self._lap_began = np.zeros((2, n))
        self.lap_times = np.full(n, None)  #: [s] tuples

    def vary(self, cars: Cars, parameters: Mapping[str, Floats]) -> None:
        """Give these cars parameters of their own, of the vehicle, or of its tyres."""
        for name, values in parameters.items():
            for record in ('vehicle', '_lateral'):
                held: Any = getattr(self, record)
                if name in getattr(held, '_fields', ()):
                    column = getattr(held, name) + np.zeros(len(self.steps))
                    column[cars] = values
                    setattr(self, record, held._replace(**{name: column}))

    def place(self, cars: Cars, state: Arrays, on_track: Mapping[str, Floats]) -> None:
        """Start a run of each of these cars, on a track at this s, e_y and e_psi."""
        for column, values in zip(self.state, state, strict=True):
            column[cars] = values
        if self._lateral:
            self._slip[0, cars], self._slip[1:, cars] = state.v, 0.0
        self.steps[cars] = self._lap_began[cars] = self.lap_time[cars] = 0
        self.motor.stop(cars)
        self.servo.stop(cars)
        if self.track:
            for name in ('s', 'e_y', 'e_psi'):
                getattr(self.frenet, name)[cars] = on_track[name]
            self.lap[cars] = on_track['s'] // self.track.length
            self._is_whole[cars] = on_track['s'] == 0.0
            self.lap_times[cars] = [()] * len(cars)

    def advance(self, command: Arrays) -> None:
        """Take a step with these commands."""
        held = Command(self.motor.advance(command.motor), self.servo.advance(command.servo))
        if self._lateral:
            self._advance_dynamic(held, self._lateral)
        else:
            self.state = self._kinematic(held)
        self.steps += 1
        if self.track:
            self._locate(self.track)

    def motion(self) -> Motion:
        """Return the true states; the velocities besides v_x are left at zero."""
        (x, y, psi, v), tangent = self.state, self._tangent(self.servo.value)
        v_x: Arrays = v / np.sqrt(1.0 + tangent * tangent)
        if self._lateral:
            slipping = self._slip[0]
            v_x = np.where(slipping > self._lateral.dynamic_above, slipping, v_x)
        return Motion(x, y, psi, v_x, 0.0, 0.0)

    def _tangent(self, servo: Floats) -> Floats:
        """Return the tangent of `slip_angle`."""
        car = self.vehicle
        tangent: Floats = car.l_r / (car.l_f + car.l_r) * np.tan(servo)
        return tangent

    def _grade(self, x: Arrays) -> Arrays:
        """Return the inclines [rad]."""
        if len(self.road.grades_deg) == 1:
            return radians(self.road.grades_deg[0])
        if self.track:
            x = self.frenet.s % self.track.length if self.track.is_closed else self.frenet.s
        return np.radians(self.road.grade_deg(x))

    def _kinematic(self, held: Arrays) -> Arrays:
        """Return the states after a step of the kinematic bicycle."""
        car, v, tangent = self.vehicle, self.state.v, self._tangent(held.servo)
        beta: Arrays = np.arctan(tangent)
        turn: Arrays = tangent / np.sqrt(1.0 + tangent * tangent) / car.l_r
        direction: Arrays = np.sign(v)
        slopes = kinematic_rates(held.motor, beta, turn, self._grade, car, direction, _FUNCTIONS)
        x, y, psi, after = euler(slopes, self.state, self.ts)
        return State(x, y, psi, self._with_static_resistance(v, after))

    def _advance_dynamic(self, held: Arrays, lateral: LateralParameters) -> None:
        """Take a step of the dynamic bicycle, which is the kinematic one at low speed."""
        begin: Arrays = (*self.state[:3], *self._slip)
        slopes = rates(held, self._grade, self.vehicle, lateral, 1.0, _FUNCTIONS)
        after: Arrays = euler(slopes, begin, self.ts)
        *pose, v_x, v_y, psi_dot = after
        before, tangent = self._slip[0], self._tangent(held.servo)
        v_x = self._with_static_resistance(before, v_x)
        slips = before > lateral.dynamic_above
        if not slips.all():
            *others, v = self._kinematic(held)
            others.append(v / np.sqrt(1.0 + tangent * tangent))
            *pose, v_x = np.where(slips, [*pose, v_x], others)
        is_slow = ~slips | (v_x <= lateral.dynamic_above)
        v_y = np.where(is_slow, v_x * tangent, v_y)
        psi_dot = np.where(is_slow, v_y / self.vehicle.l_r, psi_dot)
        x, y, psi = pose
        self.state = State(x, y, psi, np.copysign(np.hypot(v_x, v_y), v_x))
        self._slip = np.array([v_x, v_y, psi_dot])

    def _with_static_resistance(self, before: Arrays, after: Arrays) -> Arrays:
        """Return the speeds after a step: `bicycles.with_static_resistance` of arrays."""
        if (before * after).min() >= 0.0:
            return after
        slowed = self.ts * resistance(self.state.v, self.vehicle) / self.vehicle.mass
        free = after + np.sign(before) * slowed
        return np.clip(0.0, np.minimum(after, free), np.maximum(after, free))  # nearest to zero

    def _locate(self, track: Track) -> None:
        """Project all cars onto the track, and time those that finish a lap."""
        before, (x, y, psi, _) = self.frenet.s, self.state
        self.frenet = track.frenet(x, y, psi, before)
        s, t = self.frenet.s, self.steps * self.ts
        for car in np.flatnonzero(s >= (self.lap + 1) * track.length).tolist():
            lap = int(s[car] // track.length)
            over = (s[car] - lap * track.length) / (s[car] - before[car])
            began = float(t[car] - over * self.ts)
            if self._is_whole[car]:
                self.lap_times[car] += (began - float(self._lap_began[car]),)
            self.lap[car], self._lap_began[car], self._is_whole[car] = lap, began, True
        self.lap_time = t - self._lap_began
