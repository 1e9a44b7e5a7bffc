"""The closed loop of PID and bicycle straight over hills, in plain floats: every run's inner loop.

`_drive` has the laws `pid_step` and `next_speed` once more, written out, as a call costs as
much as a law. `pid_log` makes a log of it. Tests compare both with the plant and the controller
in `closed_loop`, to the last bit.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from itertools import repeat
from math import cos, inf, isfinite, radians, sin
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.simulation.log import ENVIRONMENT, STATE, STATE_ERROR, Log, columns_from
from barc_sim.vehicle.bike_model import State, clamped_at_zero, motion, resistance, surroundings
from barc_sim.vehicle.sensor import MeasurementError, with_error

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from barc_sim.control.pid import PID
    from barc_sim.vehicle.bike_model import Vehicle
    from barc_sim.vehicle.plant import Plant
    from barc_sim.vehicle.road import Road

    Floats = NDArray[np.float64]


class LoopSettings(NamedTuple):
    """The numbers of a loop beside gains and road."""

    reference: float  #: [m/s]
    low: float  #: [m/s²] limits of the command
    high: float
    vehicle: Vehicle
    ts: float  #: [s] of the vehicle's steps
    dt: float  #: [s] of the controller: `ts` in whole nanoseconds
    distance: float  #: [m] where the loop ends


class RoadSegments(NamedTuple):
    """A road as the loop reads it: segment `i` reaches from `begins[i]` up to `ends[i]` [m]."""

    begins: tuple[float, ...]
    ends: tuple[float, ...]
    gravity_forces: tuple[float, ...]  #: [N] along the road, positive forwards

    @classmethod
    def of(cls, road: Road, vehicle: Vehicle) -> RoadSegments:
        """Return the segments of `road`."""
        inner = road.starts[1:]
        weight = -vehicle.mass * vehicle.gravity
        return cls(
            begins=(-inf, *inner),
            ends=(*inner, inf),
            gravity_forces=tuple(weight * sin(radians(grade)) for grade in road.grades_deg),
        )

    def at(self, x: float) -> tuple[float, float, float]:
        """Return begin, end and gravity force of the segment at `x` metres."""
        i = bisect_right(self.begins, x) - 1
        return self.begins[i], self.ends[i], self.gravity_forces[i]


class _Trace(NamedTuple):
    """What a loop leaves; the first two are shape `(n,)`, of each state."""

    v: Floats  #: [m/s]
    integral: Floats  #: [m/s²] after the state's command
    after: tuple[float, float]  #: x [m] and v [m/s] after the last step; at the distance, there


def _drive(
    gains: tuple[float, float, float],
    settings: LoopSettings,
    segments: RoadSegments,
    errors: Iterable[float],
    start: tuple[float, float],
    waiting: list[float],
    early: float,
) -> _Trace:
    """Drive to the distance, or to the end of `errors`, measured minus true speed [m/s].

    `start` is x [m] and v [m/s]; the controller is at its beginning.

    `waiting` has the commands [m/s²] on their way, the next first: one more than the steps of
    delay. The loop appends its own. Without any, a command acts at once. `early` is the share of a
    step for which the older of two commands still acts.
    """
    kp, ki, kd = gains
    reference, low, high, vehicle, ts, dt, distance = settings
    mass = vehicle.mass
    x, v = start
    integral = previous = interval = 0.0
    begin, end, gravity_force = segments.at(x)
    speeds: list[float] = []
    integrals: list[float] = []
    add_speed, add_integral = speeds.append, integrals.append
    acting = iter(waiting)
    older = next(acting, 0.0)
    for error in errors:
        if x >= end or x < begin:
            begin, end, gravity_force = segments.at(x)
        # The controller: `pid_step`.
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
    columns = np.frombuffer(array('d', speeds)), np.frombuffer(array('d', integrals))
    return _Trace(*columns, (x, v))


class _Commands(NamedTuple):
    """What a PID computes, shape `(n,)` each, by the names of `Log`."""

    motor: Floats
    proportional: Floats
    integral: Floats
    derivative: Floats
    saturated: NDArray[np.bool_]


@np.errstate(over='ignore', invalid='ignore')  # as with floats
def _commands(
    gains: tuple[float, float, float],
    settings: LoopSettings,
    trace: _Trace,
    errors: Floats | float,
) -> _Commands:
    """Return the commands of a loop and their terms: the sums of `_drive`, for arrays."""
    kp, ki, kd = gains
    measured = trace.v + errors
    deviation = settings.reference - measured
    increment = ki * deviation * settings.dt
    change = np.diff(measured, prepend=0.0)
    proportional, derivative = kp * deviation, -kd * change / settings.dt
    increment[:1] = derivative[:1] = 0.0
    before = np.concatenate([[0.0], trace.integral[:-1]])
    output = proportional + before + increment + derivative
    motor = np.clip(output, settings.low, settings.high)
    return _Commands(motor, proportional, trace.integral, derivative, motor != output)


def pid_log(
    plant: Plant, pid: PID, speed_reference: float, distance: float, steps: int
) -> Log | None:
    """Return the log of `closed_loop`, for a plant that `has_fast_path`.

    Plant and controller are left as the run left them. Where the controller is not at its
    beginning, or a number is not finite, nothing is done, and None returned.
    """
    if pid.previous is not None or pid.integral:
        return None
    state, vehicle, road = plant.state, plant.vehicle, plant.road
    gains = pid.kp, pid.ki, pid.kd
    settings = LoopSettings(
        reference=speed_reference,
        low=pid.output_min,
        high=pid.output_max,
        vehicle=vehicle,
        ts=plant.ts,
        dt=plant.period_ns / 1e9,
        distance=distance,
    )
    sensor, motor = plant.sensor, plant.actuators.motor
    waiting = [] if plant.actuators.is_ideal else motor.waiting
    segments = RoadSegments.of(road, vehicle)
    drawn, errors, place = steps + 1, None, None
    if sensor.is_noisy:  # about as many measurements as a run at this speed takes, and some more
        expected = 1.02 * distance / max(speed_reference * plant.ts, 1e-6) + 32.0
        drawn = int(min(drawn, max(expected, 1.0)))
    while True:
        if sensor.is_noisy:
            errors, place = sensor.draw(drawn)
        # An error of -0.0 also leaves a speed of -0.0 as it is.
        of_speed = repeat(-0.0, drawn) if errors is None else errors[3].tolist()
        trace = _drive(
            gains, settings, segments, of_speed, (state.x, state.v), [*waiting], motor.early
        )
        n = len(trace.v)
        if n < drawn or drawn > steps:
            break
        sensor.go_back(place, 0)
        drawn = min(4 * drawn, steps + 1)
    error = None if errors is None else MeasurementError(*errors[:, :n])
    computed = _commands(gains, settings, trace, -0.0 if error is None else error.v_x)
    last = {name: values[-1].item() for name, values in computed._asdict().items()}
    is_finite = all(map(isfinite, (*trace.after, *last.values())))
    if sensor.is_noisy:
        sensor.go_back(place, n if is_finite else 0)
    if not is_finite:
        return None
    x = np.add.accumulate(np.append(state.x, plant.ts * trace.v[:-1]))
    zero: Any = np.zeros(n)
    columns: Any = [np.full(n, value) for value in state]
    states = State(*columns)._replace(x=x, psi=zero, v=trace.v)  # type: ignore[arg-type]
    true = motion(states, 0.0, vehicle)
    measured = true if error is None else with_error(true, error, cos(state.psi), sin(state.psi))
    previous = float(measured.v_x[-1])  # type: ignore[index]  # arrays
    for name in ('proportional', 'integral', 'derivative', 'saturated'):
        setattr(pid, name, last[name])
    pid.previous = previous
    taken = computed.motor if x[-1] < distance else computed.motor[:-1]
    plant.follow(taken[-len(waiting) - 1 :].tolist(), *trace.after)
    around = surroundings(trace.v, road.at(x), vehicle)  # type: ignore[arg-type]
    recorded: Any = MeasurementError(*[zero] * 6) if error is None else error
    return Log(
        t=np.arange(n) * plant.period_ns / 1e9,
        **columns_from(STATE, measured),
        **columns_from(STATE_ERROR, recorded),
        servo=zero,
        missed=np.zeros(n, np.bool_),
        **columns_from(ENVIRONMENT, around),
        reference=np.full(n, speed_reference),
        **computed._asdict(),
    )
