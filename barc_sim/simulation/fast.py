"""The laws once more, for speed: one loop in plain floats, and many cars in NumPy arrays.

`_drive` has `PID` and `next_speed` written out, as a call costs as much as a law; `pid_log` makes a
log of it. `PIDs`, `next_speeds` and `Plants` are the same laws over arrays. Tests compare logs to
the last bit, and `Plants` to rounding, as NumPy's functions differ from Python's in the last bit.
A car that stands or rolls back is rare: one reduction finds it, and it is handled apart.
"""

from __future__ import annotations

from array import array
from itertools import chain, islice, repeat
from math import cos, inf, isfinite, nan, sin
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.simulation.log import log_of
from barc_sim.vehicle.bike_model import (
    Command,
    Motion,
    State,
    clamped_at_zero,
    motion,
    resistance,
    surroundings,
)
from barc_sim.vehicle.plant import MeasurementError, Sensor, in_steps, with_error

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from barc_sim.control.speed import PID
    from barc_sim.simulation.log import Log
    from barc_sim.vehicle.bicycles import LateralParameters
    from barc_sim.vehicle.bike_model import Vehicle
    from barc_sim.vehicle.plant import Actuator, NoiseLevels, Plant
    from barc_sim.vehicle.road import Road

    Floats = NDArray[np.float64]
    #: The numbers of some cars.
    Cars = NDArray[np.intp]


_BLOCK = 512  #: measurements whose noise is drawn at once


def _stretch(road: Road, vehicle: Vehicle, x: float) -> tuple[float, float, float]:
    """Return begin and end [m] of the stretch at `x` metres, and the gravity force [N] on it."""
    i, starts = road.stretch(x), road.starts
    begin, end = (starts[i] if i else -inf), (starts[i + 1] if i + 1 < len(starts) else inf)
    return begin, end, -vehicle.mass * vehicle.gravity * road.at(x).sin_theta


def _drive(
    plant: Plant, pid: PID, reference: float, distance: float, errors: Iterable[float]
) -> tuple[Floats, Floats]:
    """Return the speed [m/s], and the integral [m/s²] after the command, of each state.

    The loop ends at the distance, or with `errors`, measured minus true speed [m/s].
    """
    kp, ki, kd, low, high = pid.kp, pid.ki, pid.kd, pid.output_min, pid.output_max
    vehicle, ts, dt, mass = plant.vehicle, plant.ts, plant.period_ns / 1e9, plant.vehicle.mass
    x, v = plant.state.x, plant.state.v
    # Commands [m/s²] on their way, the next first: one more than the steps of delay. The loop
    # appends its own. Without any, a command acts at once. For the share `early` of a step the
    # older of two commands still acts.
    motor = plant.actuators.motor
    waiting, early = [] if motor.is_ideal else motor.waiting, motor.early
    acting = iter(waiting)
    older = next(acting, 0.0)
    integral = previous = interval = 0.0
    begin, end, gravity_force = _stretch(plant.road, vehicle, x)
    speeds: list[float] = []
    integrals: list[float] = []
    add_speed, add_integral = speeds.append, integrals.append
    for error in errors:
        if x >= end or x < begin:
            begin, end, gravity_force = _stretch(plant.road, vehicle, x)
        # The controller: `PID.acc_calculate`.
        measured = v + error
        deviation = reference - measured
        if interval > 0.0:
            increment = ki * deviation * interval
            command = kp * deviation + integral + increment + -kd * (measured - previous) / interval
        else:
            increment = 0.0
            command = kp * deviation + integral + 0.0
        if command > high:
            command = high
            increment = min(increment, 0.0)
        elif command < low:
            command = low
            increment = max(increment, 0.0)
        integral += increment
        previous = measured
        interval = dt
        add_speed(v)
        add_integral(integral)
        if x >= distance:
            break
        if waiting:
            waiting.append(command)
            newer = next(acting)
            command = early * older + (1.0 - early) * newer + 0.0
            older = newer
        # The vehicle: `next_speed`.
        x += ts * v
        opposing = resistance(v, vehicle)
        if v <= 0.0:
            opposing = -opposing if v < 0.0 else 0.0
        after = v + ts * (command + (gravity_force - opposing) / mass)
        if after < 0.0 < v or v < 0.0 < after:
            after = clamped_at_zero(v, after, v + ts * (command + gravity_force / mass))
        v = after
    return np.frombuffer(array('d', speeds)), np.frombuffer(array('d', integrals))


@np.errstate(over='ignore', invalid='ignore')  # as with floats
def _commands(
    pid: PID, reference: float, dt: float, v: Floats, integral: Floats, errors: Floats | float
) -> dict[str, Any]:
    """Return the columns of the PID's command and terms: the sums of `_drive`, for arrays."""
    measured = v + errors
    deviation = reference - measured
    increment = pid.ki * deviation * dt
    change = np.diff(measured, prepend=0.0)
    proportional, derivative = pid.kp * deviation, -pid.kd * change / dt
    increment[:1] = derivative[:1] = 0.0
    before = np.concatenate([[0.0], integral[:-1]])
    output = proportional + before + increment + derivative
    motor = np.clip(output, pid.output_min, pid.output_max)
    return {
        'motor': motor,
        'proportional': proportional,
        'integral': integral,
        'derivative': derivative,
        'saturated': motor != output,
    }


def pid_log(
    plant: Plant, pid: PID, speed_reference: float, distance: float, steps: int
) -> Log | None:
    """Return the log of `closed_loop` for a plant that `has_fast_path`; both stay as they are.

    None: the controller is not at its beginning, or a number is not finite.
    """
    if pid.previous is not None or pid.integral:
        return None
    state, vehicle = plant.state, plant.vehicle
    blocks: list[Floats] = []
    # An error of -0.0 also leaves a speed of -0.0 as it is.
    errors: Iterable[float] = repeat(-0.0)
    if plant.sensor.is_noisy:
        errors = chain.from_iterable(_speed_errors(plant.sensor.again(), blocks))
    v, integral = _drive(plant, pid, speed_reference, distance, islice(errors, steps + 1))
    n = len(v)
    zero: Any = np.zeros(n)
    error: Any = MeasurementError(*[zero] * 6)
    if blocks:
        error = MeasurementError(*np.concatenate(blocks, axis=1)[:, :n])
    dt = plant.period_ns / 1e9
    seen = error.v_x if blocks else -0.0
    computed = _commands(pid, speed_reference, dt, v, integral, seen)
    if not all(isfinite(each[-1]) for each in computed.values()):
        return None
    x = np.add.accumulate(np.append(state.x, plant.ts * v[:-1]))
    states = State(x, np.full(n, state.y), zero, v)  # type: ignore[arg-type]
    measured = motion(states, 0.0, vehicle)
    if blocks:
        measured = with_error(measured, error, cos(state.psi), sin(state.psi))
    return log_of(
        plant.period_ns,
        measured,
        error,
        Command(computed.pop('motor'), zero),
        surroundings(v, plant.road.at(x), vehicle),  # type: ignore[arg-type]
        reference=np.full(n, speed_reference),
        **computed,
    )


def _speed_errors(sensor: Sensor, blocks: list[Floats]) -> Iterator[list[float]]:
    """Yield the errors of the speed, and keep those of all signals in `blocks`."""
    while True:
        blocks.append(sensor.draw(_BLOCK))
        yield blocks[-1][3].tolist()


_DRAWN = 64  #: measurements whose noise is drawn at once


class PIDs:
    """`PID` for many cars, by the law of one."""

    def __init__(self, n: int, like: PID, dt: float) -> None:
        """Start at rest, in intervals of `dt` seconds."""
        self._like, self._dt = like, dt
        self._integral, self._previous = np.zeros((2, n))
        self.reset(np.arange(n))

    def reset(self, cars: Cars) -> None:
        """Forget the past of these cars: the next call is their first."""
        self._integral[cars], self._previous[cars] = 0.0, nan

    def control(self, reference: float, measured: Floats) -> Floats:
        """Return the commands [m/s²] for speeds in m/s."""
        like, first = self._like, np.isnan(self._previous)
        error = reference - measured
        increment = np.where(first, 0.0, like.ki * error * self._dt)
        derivative = np.where(first, 0.0, -like.kd * (measured - self._previous) / self._dt)
        output = like.kp * error + self._integral + increment + derivative
        command: Floats = np.minimum(np.maximum(output, like.output_min), like.output_max)
        increment[(output - command) * increment > 0.0] = 0.0  # further into the limit
        self._integral += increment
        self._previous[:] = measured
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


class Actuators:
    """`ActuatorState` for many cars, whose delays may differ."""

    def __init__(self, n: int, actuator: Actuator, ts: float, max_delay: float) -> None:
        """Begin at zero; no delay of `delay_some` will be above `max_delay` [s]."""
        self._lag, self._rate, self._limit = actuator[1:]
        self._ts, self._cars, self._step = ts, np.arange(n), 0
        self.value = np.zeros(n)
        self._queue = np.zeros((in_steps(max(max_delay, actuator.delay), ts)[0] + 2, n))
        self._whole, self._early = np.zeros(n, np.intp), np.zeros(n)
        self.delay_some(self._cars, np.full(n, actuator.delay))

    def delay_some(self, cars: Cars, delays: Floats) -> None:
        """Delay these cars' commands by so many seconds from now on."""
        steps = np.array([in_steps(delay, self._ts) for delay in delays.tolist()]).reshape(-1, 2)
        self._whole[cars], self._early[cars] = steps.T
        self._delays, self._splits = bool(self._whole.any()), bool(self._early.any())

    def stop(self, cars: Cars) -> None:
        """Set these to zero, and drop their waiting commands."""
        self.value[cars] = self._queue[:, cars] = 0.0

    def advance(self, command: Floats) -> Floats:
        """Go one step after `command`; return the means over it."""
        if self._limit < inf:
            command = np.clip(command, -self._limit, self._limit)
        newer, late = command, self._ts
        self._step += 1
        if self._delays or self._splits:
            self._queue[self._step % len(self._queue)] = command
            newer = self._ago(self._whole)
        if not self._splits:
            return self._respond(newer, late)
        early = self._early
        # Of a share of zero nothing is left: its mean counts for nothing, and it moves nothing.
        older = np.where(early > 0.0, self._ago(self._whole + 1), self.value)
        mean = early * self._respond(older, np.where(early > 0.0, early, 1.0) * self._ts)
        return mean + (1.0 - early) * self._respond(newer, (1.0 - early) * self._ts)

    def _ago(self, steps: NDArray[np.intp]) -> Floats:
        ago: Floats = self._queue[(self._step - steps) % len(self._queue), self._cars]
        return ago

    def _respond(self, target: Floats, t: Floats | float) -> Floats:
        """Follow `target` for `t` seconds; return the means meanwhile: `Actuator.respond`."""
        lag, rate, value = self._lag, self._rate, self.value
        if not lag and rate == inf:
            self.value = target.copy()
            return target
        error = target - value
        excess = np.abs(error) - rate * lag
        if excess.max() <= 0.0:
            moved = error * -np.expm1(-t / lag) if lag else error
            self.value = value + moved
            lagging: Floats = target - moved * lag / t
            return lagging
        ramp = np.minimum(np.maximum(excess, 0.0) / rate, t)
        ramp_end = value + np.copysign(rate, error) * ramp
        remaining, error = t - ramp, target - ramp_end
        is_left = remaining > 0.0
        moved = error * (-np.expm1(-remaining / lag) if lag else is_left)
        share = ramp / t
        mean_of_decay = target - moved * lag / np.where(is_left, remaining, 1.0)
        self.value = ramp_end + moved
        mean: Floats = share * 0.5 * (value + ramp_end) + (1.0 - share) * mean_of_decay
        return mean


class Plants:
    """Many plants, each as `Plant` steps it by forward Euler.

    All arrays have an element for each car.
    """

    def __init__(self, n: int, like: Plant, max_delay: float) -> None:
        """Make `n` plants like one, whose actuators never delay by more; `place` starts them."""
        self.ts, self.track, self.road, self.vehicle = like.ts, like.track, like.road, like.vehicle
        self._lateral: LateralParameters | None = getattr(like.bicycle, 'lateral', None)
        self.motor, self.servo = (
            Actuators(n, state.actuator, self.ts, max_delay)
            for state in (like.actuators.motor, like.actuators.servo)
        )
        self.x, self.y, self.psi, self.v, self._beta, self._psi_dot = np.zeros((6, n))
        self.s, self.e_y, self.e_psi, self.lap, self.lap_began = np.zeros((5, n))
        self.steps = np.zeros(n, np.intp)  #: since each was placed
        self._sensors = [Sensor()] * n
        self._errors = np.zeros((0, _DRAWN, 6))
        self.lap_times = np.full(n, None)  #: [s] tuples: of its whole laps
        self._is_whole = np.zeros(n, np.bool_)  # the lap began at its line

    @property
    def is_noisy(self) -> bool:
        """Whether any is measured with noise."""
        return bool(len(self._errors))

    def vary(self, cars: Cars, parameters: Mapping[str, Floats]) -> None:
        """Give these cars parameters of their own, of the vehicle, or of its tyres."""
        for name, values in parameters.items():
            for record in ('vehicle', '_lateral'):
                held: Any = getattr(self, record)
                if name in getattr(held, '_fields', ()):
                    column = getattr(held, name) + np.zeros_like(self.v)
                    column[cars] = values
                    setattr(self, record, held._replace(**{name: column}))

    def make_noise(self, cars: Cars, levels: Sequence[NoiseLevels], seeds: Sequence[int]) -> None:
        """Measure these cars with noise, each with a seed of its own, from now on."""
        if not self.is_noisy:
            self._errors = np.zeros((len(self.v), _DRAWN, 6))
        for car, level, seed in zip(cars.tolist(), levels, seeds, strict=True):
            self._sensors[car] = Sensor(level, seed)

    def place(self, cars: Cars, pose: Any, start: Mapping[str, Floats]) -> None:  # noqa: ANN401
        """Put these there, without commands: at a pose on the map and what it is on the track."""
        self.x[cars], self.y[cars], self.psi[cars] = pose
        for name, values in start.items():
            getattr(self, name)[cars] = values
        for column in (self._beta, self._psi_dot, self.steps, self.lap_began):
            column[cars] = 0
        self.motor.stop(cars)
        self.servo.stop(cars)
        if self.track:
            s = start['s']
            self.lap[cars] = np.maximum(np.floor(s / self.track.length), 0.0)
            self._is_whole[cars] = s == 0.0
            for car in cars.tolist():
                self.lap_times[car] = ()

    def advance(self, motor: Floats, servo: Floats) -> None:
        """Go one step with these commands."""
        motor, servo = self.motor.advance(motor), self.servo.advance(servo)
        sine = self._sine()
        slips = self._slips()
        if slips is None or not slips.any():
            after = self._kinematic(motor, servo, sine)
        else:
            after = self._dynamic(motor, servo, sine)
            if not slips.all():
                others = self._kinematic(motor, servo, sine)
                after = tuple(np.where(slips, *both) for both in zip(after, others, strict=True))
        self.x, self.y, self.psi, self.v, self._beta, self._psi_dot = after
        self.steps += 1
        if self.track:
            self._locate()
        else:
            self.s = self.x

    def measure(self) -> Motion:
        """Return what is measured of position, heading and v_x; the other velocities are zero."""
        tangent = self._tangent(self.servo.value)
        v_x = self.v / np.sqrt(1.0 + tangent * tangent)
        slips = self._slips()
        if slips is not None:
            v_x = np.where(slips, self.v * np.cos(self._beta), v_x)
        true: Any = Motion(self.x, self.y, self.psi, v_x, 0.0, 0.0)  # type: ignore[arg-type]
        if not self.is_noisy:
            return true  # type: ignore[no-any-return]
        k = self.steps % _DRAWN
        for car in np.flatnonzero(k == 0).tolist():
            self._errors[car] = self._sensors[car].draw(_DRAWN).T
        error: Any = MeasurementError(*self._errors[np.arange(len(k)), k].T)
        heading: Any = np.cos(self.psi), np.sin(self.psi)
        return with_error(true, error, *heading)

    def _sine(self) -> Floats | float:
        """Return the sine of the incline."""
        if len(self.road.grades_deg) == 1:
            return self.road.at(0.0).sin_theta
        s = self.s
        if self.track and self.track.is_closed:
            s = s % self.track.length
        return self.road.at(s).sin_theta

    def _tangent(self, servo: Floats) -> Floats:
        """Return the tangent of the kinematic bicycle's slip angle."""
        car = self.vehicle
        tangent: Floats = car.l_r / (car.l_f + car.l_r) * np.tan(servo)
        return tangent

    def _slips(self) -> NDArray[np.bool_] | None:
        """Return whose tyres slip; None: the bicycle is the kinematic one."""
        if not self._lateral:
            return None
        slips: NDArray[np.bool_] = self.v * np.cos(self._beta) > self._lateral.dynamic_above
        return slips

    def _kinematic(self, motor: Floats, servo: Floats, sine: Floats | float) -> tuple[Floats, ...]:
        """Return position, heading, speed, slip angle and yaw rate after a step without slip."""
        car, ts, v = self.vehicle, self.ts, self.v
        tangent = self._tangent(servo)
        beta = np.arctan(tangent)
        turn = tangent / np.sqrt(1.0 + tangent * tangent) / car.l_r
        gravity = -car.mass * car.gravity * sine
        after = next_speeds(v, motor, gravity, car, ts)
        way, direction = ts * v, self.psi + beta
        return (
            self.x + way * np.cos(direction),
            self.y + way * np.sin(direction),
            self.psi + way * turn,
            after,
            beta,
            after * turn,
        )

    def _dynamic(self, motor: Floats, servo: Floats, sine: Floats | float) -> tuple[Floats, ...]:
        """Return the same of the dynamic bicycle, a step of its `rates`."""
        car, tyres, ts = self.vehicle, self._lateral, self.ts
        assert tyres  # noqa: S101 (the caller has asked)
        v, turn, cosine = self.v, self._psi_dot, np.cos(servo)
        v_x, v_y = v * np.cos(self._beta), v * np.sin(self._beta)
        front = tyres.front_stiffness * (servo - np.arctan2(v_y + car.l_f * turn, v_x))
        rear = -tyres.rear_stiffness * np.arctan2(v_y - car.l_r * turn, v_x)
        cos_psi, sin_psi = np.cos(self.psi), np.sin(self.psi)
        push = motor - car.gravity * sine - front * np.sin(servo) / car.mass + v_y * turn
        after = v_x + ts * (push - resistance(v, car) / car.mass)  # type: ignore[arg-type]
        after = np.maximum(after, np.minimum(v_x + ts * push, 0.0))  # as in `next_speeds`
        aside = v_y + ts * ((front * cosine + rear) / car.mass - v_x * turn)
        turn_after = turn + ts * ((car.l_f * front * cosine - car.l_r * rear) / tyres.yaw_inertia)
        beta, speed = np.arctan2(aside, after), np.sqrt(after * after + aside * aside)
        slow = after <= tyres.dynamic_above
        if slow.any():
            tangent = self._tangent(servo)
            root = np.sqrt(1.0 + tangent * tangent)
            beta = np.where(slow, np.arctan(tangent), beta)
            speed = np.where(slow, after * root, speed)
            turn_after = np.where(slow, after * tangent / car.l_r, turn_after)
        return (
            self.x + ts * (v_x * cos_psi - v_y * sin_psi),
            self.y + ts * (v_x * sin_psi + v_y * cos_psi),
            self.psi + ts * turn,
            speed,
            beta,
            turn_after,
        )

    def _locate(self) -> None:
        """Find all on the track, and time those that finish a lap."""
        track, before = self.track, self.s
        assert track  # noqa: S101 (the caller has asked)
        self.s, self.e_y, self.e_psi, _ = track.frenet(self.x, self.y, self.psi, before)  # type: ignore[assignment]
        for car in np.flatnonzero(self.s >= (self.lap + 1.0) * track.length).tolist():
            lap = np.floor(self.s[car] / track.length)
            over = (self.s[car] - lap * track.length) / (self.s[car] - before[car])
            began = float((self.steps[car] - over) * self.ts)
            if self._is_whole[car]:
                self.lap_times[car] += (began - float(self.lap_began[car]),)
            self.lap[car], self.lap_began[car], self._is_whole[car] = lap, began, True
