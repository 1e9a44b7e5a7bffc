"""The closed loop of PID and bicycle straight over hills, in plain floats: every run's inner loop.

`_drive` has the laws `pid_step` and `next_speed` once more, written out, as a call costs as
much as a law. `pid_log` makes a log of it. Tests compare both with the plant and the controller
in `closed_loop`, to the last bit.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from itertools import chain, islice, repeat
from math import cos, inf, isfinite, radians, sin
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.simulation.log import log_of
from barc_sim.vehicle.bike_model import (
    Command,
    State,
    clamped_at_zero,
    motion,
    resistance,
    surroundings,
)
from barc_sim.vehicle.sensor import MeasurementError, with_error

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from barc_sim.control.pid import PID
    from barc_sim.simulation.log import Log
    from barc_sim.vehicle.bike_model import Vehicle
    from barc_sim.vehicle.plant import Plant
    from barc_sim.vehicle.road import Road
    from barc_sim.vehicle.sensor import Sensor

    Floats = NDArray[np.float64]

_BLOCK = 512  #: measurements whose noise is drawn at once


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


def _drive(
    gains: tuple[float, float, float],
    settings: LoopSettings,
    segments: RoadSegments,
    errors: Iterable[float],
    start: tuple[float, float],
    waiting: list[float],
    early: float,
) -> tuple[Floats, Floats]:
    """Return the speed [m/s], and the integral [m/s²] after the command, of each state.

    The loop ends at the distance, or with `errors`, measured minus true speed [m/s].

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
    return np.frombuffer(array('d', speeds)), np.frombuffer(array('d', integrals))


@np.errstate(over='ignore', invalid='ignore')  # as with floats
def _commands(
    gains: tuple[float, float, float],
    settings: LoopSettings,
    v: Floats,
    integral: Floats,
    errors: Floats | float,
) -> dict[str, Any]:
    """Return the columns of the PID's command and terms: the sums of `_drive`, for arrays."""
    kp, ki, kd = gains
    measured = v + errors
    deviation = settings.reference - measured
    increment = ki * deviation * settings.dt
    change = np.diff(measured, prepend=0.0)
    proportional, derivative = kp * deviation, -kd * change / settings.dt
    increment[:1] = derivative[:1] = 0.0
    before = np.concatenate([[0.0], integral[:-1]])
    output = proportional + before + increment + derivative
    motor = np.clip(output, settings.low, settings.high)
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
    motor = plant.actuators.motor
    blocks: list[Floats] = []
    # An error of -0.0 also leaves a speed of -0.0 as it is.
    errors: Iterable[float] = repeat(-0.0)
    if plant.sensor.is_noisy:
        errors = chain.from_iterable(_speed_errors(plant.sensor.again(), blocks))
    v, integral = _drive(
        gains,
        settings,
        RoadSegments.of(plant.road, vehicle),
        islice(errors, steps + 1),
        (state.x, state.v),
        [] if plant.actuators.is_ideal else motor.waiting,
        motor.early,
    )
    n = len(v)
    zero: Any = np.zeros(n)
    error: Any = MeasurementError(*[zero] * 6)
    if blocks:
        error = MeasurementError(*np.concatenate(blocks, axis=1)[:, :n])
    computed = _commands(gains, settings, v, integral, error.v_x if blocks else -0.0)
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
