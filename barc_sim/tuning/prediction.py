"""What `identify` predicts: the motion of a car that is driven with recorded commands.

A drive is cut into stretches. Each has the times of its steps, the commands at their own times, and
the measurement where there is one: where a message was lost, the prediction continues, and only the
measurement is left out. `predict` is the one function that steps the law of the plant over it.
"""

from __future__ import annotations

from contextlib import suppress
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.errors import UserError
from barc_sim.interfaces.records import Command
from barc_sim.vehicle.bicycles import (
    NO_SLIP,
    Bicycle,
    LateralParameters,
    bicycle_motion,
    bicycle_of,
    bicycle_step,
    check_step,
    kinematic_step,
)
from barc_sim.vehicle.bike_model import BicycleState, Vehicle, next_speed
from barc_sim.vehicle.law import compiled
from barc_sim.vehicle.plant import Actuator, actuator_response
from barc_sim.vehicle.road import LEVEL, Inclines

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from barc_sim.simulation.log import Floats, Log

    Rows = NDArray[np.intp]
    Column = Any  #: a list of numbers in Python, an array in compiled code

AT_REST = 0.25  #: [m/s]
_WARM_UP = 1.0  #: [s] of commands that are known before the first state that counts
_HISTORY = 5.0  #: [s] of commands before that state, for slow motors
_SHORTEST = 2.0  #: [s] of a stretch
_JUMP = 5.0  #: [m] beyond the way at twice the speed: a return to the start
_BRIDGED = 2.0  #: [s] without a state, over which the prediction continues
_COMMAND_GAP = 0.25  #: [s] without commands, in place of which the mean of their neighbours acts
_REGULAR = 0.2  #: share of the period within which a message follows another
_NEAR = 1e-6  #: [m] from the start of a run
_NOTICED = 0.05  #: share of the noise by which what was lost changes the speed
_JUMPED = 1.9  #: times the spread: a jump between two levels (2: without noise of the commands)
_ROUND = 9  #: digits of times [s]: nanoseconds


class HeldValues(NamedTuple):
    """Values over time, each of which holds until the next; shape `(n,)`."""

    t: Floats  #: [s]
    values: Floats

    def at(self, t: Floats) -> Floats:
        """Return the values at these times; before the first one, it holds, too."""
        i = np.searchsorted(self.t, t, side='right') - 1
        values: Floats = self.values[np.maximum(i, 0)]
        return values


class SignalGap(NamedTuple):
    """A time in which a command or an incline is unknown, because its messages were lost."""

    start: float  #: [s]
    end: float  #: [s]
    before: float  #: the value before it: [m/s²], or the incline's sine
    after: float
    jump: float  #: the part of their difference that is not a ramp on which the values were
    spread: float  #: standard deviation of the value from the mean of both
    messages: int  #: that were lost
    is_command: bool  #: of the motor, and not an incline

    @property
    def is_switch(self) -> bool:
        """Whether the value jumped from one level to another."""
        return abs(self.jump) > _JUMPED * self.spread


class Stretch(NamedTuple):
    """A part of a drive whose commands are known; arrays of shape `(n,)` have a row for each step.

    A step begins at each measured state; between two states that are further apart there are more.
    """

    t: Floats  #: [s]
    motor: HeldValues  #: [m/s²]
    servo: HeldValues  #: [rad]
    sines: Floats  #: of the inclines
    measured: Floats  #: speed, yaw rate and lateral speed, shape `(3, n)`; NaN: not measured
    is_start: bool  #: of a run: before it there were no commands
    gaps: tuple[SignalGap, ...]  #: in its commands and inclines

    @property
    def counted(self) -> Rows:
        """The rows with a measurement."""
        return np.flatnonzero(np.isfinite(self.measured[0]))

    @property
    def in_motion(self) -> bool:
        """Whether it begins in motion."""
        return bool(abs(self.measured[0, 0]) > AT_REST)


class CarModel(NamedTuple):
    """The car that drives in a prediction."""

    vehicle: Vehicle
    motor: Actuator
    servo: Actuator | None = None  #: None: it drives straight ahead
    lateral: LateralParameters | None = None  #: None: tyres do not slip
    integrator: str = 'euler'


def predict(stretch: Stretch, car: CarModel, v: float, *, is_fast: bool = False) -> Floats:
    """Return speed, yaw rate and lateral speed at each step of a car that begins with `v` [m/s].

    They are infinite if the integrator is unstable. With `is_fast` the loops are compiled, which
    gives the same numbers.
    """
    predicted = np.full_like(stretch.measured, inf)
    with suppress(UserError, OverflowError, ValueError):
        _, along = respond(
            car.motor, stretch.motor, stretch.t, is_start=stretch.is_start, is_fast=is_fast
        )
        if car.servo:
            predicted[:] = _steered(stretch, car, car.servo, v, along, is_fast=is_fast)
        else:
            predicted[0] = _straight(stretch, car, v, along, is_fast=is_fast)
            predicted[1:] = 0.0

    # Where Python raises an error, compiled code returns NaN.
    return np.full_like(predicted, inf) if np.isnan(predicted).any() else predicted


def _columns(*columns: Floats, is_fast: bool) -> list[Column]:
    """Return columns as a loop takes them: Python is faster with lists."""
    if is_fast:
        return [np.ascontiguousarray(column) for column in columns]
    return [column.tolist() for column in columns]


def _level(*, is_fast: bool) -> Inclines:
    """Return a flat road: gravity is part of the acceleration."""
    starts, thetas = _columns(*np.array([LEVEL.starts, LEVEL.thetas]), is_fast=is_fast)
    return Inclines(starts, thetas)


def _straight(stretch: Stretch, car: CarModel, v: float, along: Floats, *, is_fast: bool) -> Column:
    """Return the speed at each step, for commanded accelerations `along` [m/s²]."""
    vehicle = car.vehicle
    bicycle = bicycle_of('kinematic', car.integrator, vehicle)
    gravity_forces = -vehicle.mass * vehicle.gravity * stretch.sines[:-1]

    steps, motor, forces, speeds = _columns(
        np.diff(stretch.t), along, gravity_forces, np.zeros(len(stretch.t)), is_fast=is_fast
    )
    loop = compiled(drive_straight) if is_fast else drive_straight
    loop(bicycle, _level(is_fast=is_fast), v, steps, motor, forces, speeds)
    return speeds


def drive_straight(
    bicycle: Bicycle,
    level: Inclines,
    v: float,
    steps: Column,
    motor: Column,
    forces: Column,
    speeds: Column,
) -> None:
    """Store the speed at each step of a car that drives straight ahead from `v` [m/s] on.

    In each step, of `steps` [s], the acceleration is `motor` [m/s²], and gravity has `forces` [N].
    """
    speeds[0] = v
    for k in range(len(steps)):
        if bicycle.is_rk4:
            state = BicycleState(0.0, 0.0, 0.0, v)
            command = Command(motor[k] + forces[k] / bicycle.vehicle.mass, 0.0)
            v = kinematic_step(bicycle, state, command, level, 0, steps[k]).v
        else:
            v = next_speed(v, motor[k], forces[k], bicycle.vehicle, steps[k])
        speeds[k + 1] = v


def _steered(
    stretch: Stretch, car: CarModel, steering: Actuator, v: float, along: Floats, *, is_fast: bool
) -> Floats:
    """Return speed, yaw rate and lateral speed at each step."""
    vehicle = car.vehicle
    times = np.diff(stretch.t)
    if car.lateral:
        check_step(car.lateral, vehicle, float(times.max()), car.integrator)
    dynamics = 'dynamic' if car.lateral else 'kinematic'
    bicycle = bicycle_of(dynamics, car.integrator, vehicle, car.lateral)

    angles, mean_angles = respond(
        steering, stretch.servo, stretch.t, is_start=stretch.is_start, is_fast=is_fast
    )
    accelerations = along - vehicle.gravity * stretch.sines[:-1]
    steps, motor, servo, present = _columns(
        times, accelerations, mean_angles, angles, is_fast=is_fast
    )

    signals = _columns(*np.zeros((3, len(stretch.t))), is_fast=is_fast)
    loop = compiled(drive_steered) if is_fast else drive_steered
    loop(bicycle, _level(is_fast=is_fast), v, steps, motor, servo, present, *signals)
    return np.array(signals)


def drive_steered(
    bicycle: Bicycle,
    level: Inclines,
    v: float,
    steps: Column,
    motor: Column,
    servo: Column,
    present: Column,
    v_x: Column,
    psi_dot: Column,
    v_y: Column,
) -> None:
    """Store the velocities at each step of a car that begins with `v` [m/s].

    In each step, of `steps` [s], acceleration and steering angle are `motor` [m/s²] and `servo`
    [rad]; between two steps the steering angle is `present` [rad].
    """
    state = BicycleState(0.0, 0.0, 0.0, v)
    slip = NO_SLIP
    for k in range(len(present)):
        motion = bicycle_motion(bicycle, state, slip, present[k])
        v_x[k] = motion.v_x
        psi_dot[k] = motion.psi_dot
        v_y[k] = motion.v_y

        if k < len(steps):
            command = Command(motor[k], servo[k])
            state, slip = bicycle_step(bicycle, state, slip, command, level, 0, steps[k])


def respond(
    actuator: Actuator, commands: HeldValues, t: Floats, *, is_start: bool, is_fast: bool = False
) -> tuple[Floats, Floats]:
    """Return an actuator's values at the times `t`, and its means from each to the next.

    Each command acts from its own time on, after the actuator's delay. Before the first command
    there was none, if that `is_start`; else it was the same. With `is_fast` the loop is compiled.
    """
    due = np.round(commands.t + actuator.delay, _ROUND)
    edges = np.unique(np.concatenate([t, due[due < t[-1]]]))
    acting = np.searchsorted(due, edges[:-1], side='right') - 1
    before = 0.0 if is_start else float(commands.values[0])
    targets = np.append(commands.values, before)[acting]  # -1: the last one

    lengths = np.diff(edges)
    values = np.append(before, targets)
    means = targets.copy()
    if actuator.lag:
        columns = _columns(targets, lengths, values, means, is_fast=is_fast)
        follow = compiled(follow_commands) if is_fast else follow_commands
        follow(actuator, *columns)
        values, means = map(np.array, columns[2:])

    way = np.append(0.0, np.cumsum(means * lengths))
    at = np.searchsorted(edges, t)
    return values[at], np.diff(way[at]) / np.diff(t)


def follow_commands(
    actuator: Actuator, targets: Column, lengths: Column, values: Column, means: Column
) -> None:
    """Store an actuator's values after each of `lengths` [s] of constant `targets`, and its means.

    The first of `values` is the one before.
    """
    value = values[0]
    for k in range(len(targets)):
        value, mean = actuator_response(actuator, value, targets[k], lengths[k])
        values[k + 1] = value
        means[k] = mean


@np.errstate(over='ignore')  # of a car with a drag far below zero
def free_responses(stretch: Stretch, car: CarModel, speeds: Floats) -> Floats:
    """Return how the speed at each step depends on what no message has, a row for each.

    That is the speed at the start of a stretch in motion, which comes first, and what was lost, in
    its spread. They are estimated with the parameters, because the speed is linear in them.
    """
    steps = np.diff(stretch.t)
    slowing = 2.0 * car.vehicle.air_drag_coeff / car.vehicle.mass * np.abs(speeds[:-1]) * steps
    # The speed of a car that stands does not depend on its speed before.
    remaining_shares = np.where(speeds[:-1] == 0.0, 0.0, np.clip(1.0 - slowing, 0.0, 1e3))

    rows = []
    if stretch.in_motion:
        rows.append(np.append(1.0, np.cumprod(remaining_shares)))

    for gap in stretch.gaps:
        # An incline acts at once, a command through the motor.
        actuator = car.motor if gap.is_command else Actuator()
        spread = gap.spread if gap.is_command else car.vehicle.gravity * gap.spread
        since = stretch.t - actuator.delay

        way = _lagged(since - gap.start, actuator.lag) - _lagged(since - gap.end, actuator.lag)
        begin = min(int(np.searchsorted(since, gap.end)), len(since) - 1)
        remaining = np.ones(len(since))
        remaining[begin + 1 :] = np.cumprod(remaining_shares[begin:])
        rows.append(spread * way * remaining)
    return np.array(rows).reshape(-1, len(stretch.t))


def without_negligible(stretch: Stretch, vehicle: Vehicle, noise: float) -> Stretch:
    """Return the stretch with what was lost only where it matters beside the `noise` [m/s]."""

    def matters(gap: SignalGap) -> bool:
        spread = gap.spread if gap.is_command else vehicle.gravity * gap.spread
        return spread * (gap.end - gap.start) > _NOTICED * noise

    return stretch._replace(gaps=tuple(filter(matters, stretch.gaps)))


def with_certain_commands(stretch: Stretch, free: Floats, deviations: Floats) -> Stretch:
    """Return the stretch with the lost commands that are certain.

    `free` is how far each lost value is from the mean of its neighbours, in its spread, and
    `deviations` its standard deviation. Where the command jumped from one level to another, it was
    one of both in each lost message.
    """
    values = stretch.motor.values.copy()
    uncertain: list[SignalGap] = []
    for gap, value, deviation in zip(stretch.gaps, free, deviations, strict=True):
        level = (gap.after - gap.before) / gap.messages
        is_certain = gap.spread * deviation < abs(level) / 6.0
        if not (gap.is_command and gap.is_switch and is_certain):
            uncertain.append(gap)
            continue

        estimate = 0.5 * (gap.before + gap.after) + gap.spread * value
        messages = min(max(round((estimate - gap.before) / level), 0), gap.messages)
        values[np.searchsorted(stretch.motor.t, gap.start)] = gap.before + messages * level
    return stretch._replace(motor=HeldValues(stretch.motor.t, values), gaps=tuple(uncertain))


def _lagged(t: Floats, lag: float) -> Floats:
    """Return the integral of a unit step's response, `t` [s] after it."""
    t = np.maximum(t, 0.0)
    if not lag:
        return t
    way: Floats = t + lag * np.expm1(-t / lag)
    return way


def stretches(log: Log) -> Iterator[Stretch]:
    """Yield the parts of a log whose commands are known, and that are long enough."""
    measured = np.flatnonzero(np.isfinite(log.v_x) & np.isfinite(log.t))
    commanded = np.flatnonzero(np.isfinite(log.motor) | log.missed)
    if len(measured) < 3 or not np.isfinite(log.motor).any():  # noqa: PLR2004
        return

    t = np.round(log.t, _ROUND)
    measured = measured[np.append(True, np.diff(t[measured]) != 0.0)]
    steps = np.diff(t[measured])
    if not (steps > 0.0).any():
        return
    ts = float(np.median(steps[steps > 0.0]))

    # A run ends where the car jumps, or the time goes back.
    way = np.diff(log.distance[measured])
    reach = _JUMP + 2.0 * np.abs(log.v_x[measured][:-1] * steps)
    starts_anew = (steps < 0.0) | (np.abs(way) > reach) | (way < -_JUMP)
    for run in np.split(measured, np.flatnonzero(starts_anew) + 1):
        first = 0 if run[0] == measured[0] else run[0]  # commands before the first state, too
        of_run = commanded[(commanded >= first) & (commanded <= run[-1])]
        yield from _of_run(log, t, run, of_run, ts)


def _of_run(log: Log, t: Floats, run: Rows, commanded: Rows, ts: float) -> Iterator[Stretch]:
    """Yield the stretches of a run: rows with states and rows with commands, in order of time."""
    if not len(commanded):
        return

    # Where a command missed its deadline, the one before it held.
    times = t[commanded]
    motor = HeldValues(times, _hold(np.where(log.missed, np.nan, log.motor)[commanded]))
    servo = HeldValues(times, _hold(np.where(log.missed, np.nan, log.servo)[commanded]))
    is_start = _is_start(log, t, run[0], ts)
    unknown = _long_gaps(motor.t)

    # Commands are known from `begins` to `ends`.
    begins = [t[run[0]] if is_start else motor.t[0], *motor.t[unknown + 1]]
    ends = [*motor.t[unknown], t[run[-1]]]
    if _is_regular(motor.t):
        ends[-1] = min(ends[-1], motor.t[-1] + _COMMAND_GAP)

    for i, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        at_start = is_start and i == 0
        first = begin if at_start else begin + _WARM_UP
        part = run[(t[run] >= first) & (t[run] <= end)]
        pauses = np.flatnonzero(np.diff(t[part]) > _BRIDGED) + 1
        for j, states in enumerate(np.split(part, pauses)):
            known_before = 0.0 if at_start and j == 0 else _WARM_UP
            if len(states) > 2 and t[states[-1]] - t[states[0]] + known_before >= _SHORTEST:  # noqa: PLR2004
                span = (max(begin, t[states[0]] - _HISTORY), end)
                yield _stretch(log, t, states, (motor, servo), span, ts, at_start and j == 0)


def _stretch(
    log: Log,
    t: Floats,
    states: Rows,
    commands: tuple[HeldValues, HeldValues],
    span: tuple[float, float],
    ts: float,
    is_start: bool,
) -> Stretch:
    """Return the stretch of these states, whose commands are known between two times [s]."""
    begin, end = span
    motor, servo = commands
    filled_motor, command_gaps = _fill(_between(motor, begin, end))
    filled_servo, _ = _fill(_between(servo, begin, end))

    with_incline = np.flatnonzero(np.isfinite(log.theta_deg) & np.isfinite(t))
    with_incline = with_incline[(t[with_incline] <= t[states[-1]]) & (with_incline <= states[-1])]
    inclines = HeldValues(np.array([-inf]), np.zeros(1))
    incline_gaps: list[SignalGap] = []
    if len(with_incline):
        sines = np.sin(np.radians(log.theta_deg[with_incline]))
        inclines, incline_gaps = _fill(HeldValues(t[with_incline], sines))

    times, at = _step_times(t[states], ts)
    measured = np.full((3, len(times)), np.nan)
    measured[:, at] = log.v_x[states], log.psi_dot[states], log.v_y[states]
    gaps = [gap._replace(is_command=True) for gap in command_gaps]
    gaps += incline_gaps

    return Stretch(
        t=times,
        motor=filled_motor,
        servo=filled_servo,
        sines=inclines.at(times),
        measured=measured,
        is_start=is_start,
        gaps=tuple([gap for gap in gaps if gap.end > times[0]]),
    )


def _step_times(t: Floats, ts: float) -> tuple[Floats, Rows]:
    """Return the times of the steps, and which of them are `t`: a long way has steps of `ts`."""
    counts = np.maximum(np.round(np.diff(t) / ts), 1.0).astype(np.intp)
    at = np.append(0, np.cumsum(counts))
    times = np.interp(np.arange(at[-1] + 1), at, t)
    return np.round(times, _ROUND), at


def _is_start(log: Log, t: Floats, row: int, ts: float) -> bool:
    """Return whether a run starts in this row: at rest, where each run of barc_sim starts.

    That is the first row of a log, or one step after the state before. After a gap, the car can
    have been commanded already, and stand because of its delay.
    """
    is_at_start = abs(log.distance[row]) < _NEAR and abs(log.speed[row]) < _NEAR
    waited = t[row] - t[row - 1] if row else t[row] + ts
    return bool(is_at_start and waited < 1.5 * ts)


def _hold(values: Floats) -> Floats:
    """Return the values, with the one before in place of each missing one, zero at first."""
    at = np.where(np.isfinite(values), np.arange(len(values)), -1)
    latest: Floats = np.append(values, 0.0)[np.maximum.accumulate(at)]
    return latest


def _is_regular(t: Floats) -> bool:
    """Return whether messages come at a period, and not only where something changes."""
    steps = np.diff(t)
    if not len(steps):
        return False
    period = np.median(steps)
    return bool(np.mean(np.abs(steps - period) <= _REGULAR * period) > 2.0 / 3.0)


def _long_gaps(t: Floats) -> Rows:
    """Return after which of these times messages are missing for too long to be bridged."""
    if not _is_regular(t):
        return np.array([], np.intp)
    steps = np.diff(t)
    return np.flatnonzero(steps > np.median(steps) + _COMMAND_GAP)


def _between(signal: HeldValues, begin: float, end: float) -> HeldValues:
    """Return the values from the one that holds at `begin` until `end` [s]."""
    first = max(int(np.searchsorted(signal.t, begin, side='right')) - 1, 0)
    last = max(int(np.searchsorted(signal.t, end, side='right')), first + 1)
    return HeldValues(signal.t[first:last], signal.values[first:last])


def _fill(signal: HeldValues) -> tuple[HeldValues, list[SignalGap]]:
    """Return the values with the mean of both neighbours where one was lost, and what was lost."""
    if not _is_regular(signal.t):
        return signal, []

    steps = np.diff(signal.t)
    period = float(np.median(steps))
    gaps = np.flatnonzero(steps > 1.5 * period)

    starts = np.round(signal.t[gaps] + period, _ROUND)
    ends = signal.t[gaps + 1]
    before = signal.values[gaps]
    after = signal.values[gaps + 1]
    middles = 0.5 * (before + after)
    filled = HeldValues(
        np.insert(signal.t, gaps + 1, starts), np.insert(signal.values, gaps + 1, middles)
    )

    counts = np.maximum(np.round((ends - starts) / period), 1.0).astype(int)

    # Where the values around it were on a ramp, the lost ones were on it, too.
    slopes = np.diff(signal.values) / steps
    slopes_before = slopes[np.where(gaps > 0, gaps - 1, gaps + 1)]
    slopes_after = slopes[np.where(gaps + 1 < len(slopes), gaps + 1, gaps - 1)]
    ramps = 0.5 * (slopes_before + slopes_after) * steps[gaps]
    changes = after - before
    jumps = changes - np.clip(ramps, np.minimum(changes, 0.0), np.maximum(changes, 0.0))

    # Values between two others are so far from the mean of both.
    usual = float(np.median(np.abs(np.diff(signal.values, 2)))) / 2.0 / 0.6745
    spreads = np.hypot(0.5 * jumps, usual)
    signal_gaps = [
        SignalGap(
            start=float(starts[i]),
            end=float(ends[i]),
            before=float(before[i]),
            after=float(after[i]),
            jump=float(jumps[i]),
            spread=float(spreads[i]),
            messages=int(counts[i]),
            is_command=False,
        )
        for i in range(len(gaps))
    ]
    return filled, signal_gaps
