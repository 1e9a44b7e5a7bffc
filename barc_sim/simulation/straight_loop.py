"""The closed loop straight ahead in plain floats: PID and bicycle over hills, fast.

`run` is the loop, with the laws `pid_step` and `next_speed`. `drive` and `trace` are `run` without
and with the columns of a log, and `log_of` makes a log of these: the same bits as `closed_loop`,
several times as many steps a second.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from itertools import repeat
from math import inf, isfinite, radians, sin, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.control.pid import FIRST_DT, pid_step
from barc_sim.simulation.log import Log
from barc_sim.simulation.specialise import specialised
from barc_sim.vehicle.bike_model import Command, State, forces, motion, next_speed, resistance
from barc_sim.vehicle.sensor import MeasurementError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from barc_sim.control.pid import PID
    from barc_sim.vehicle.bike_model import Vehicle
    from barc_sim.vehicle.plant import Plant
    from barc_sim.vehicle.road import Road


class Setting(NamedTuple):
    """The numbers of a loop beside gains and road."""

    reference: float  #: [m/s]
    low: float  #: [m/s²] limits of the command
    high: float
    vehicle: Vehicle
    ts: float  #: [s] of the vehicle's steps
    dt: float  #: [s] of the controller: `ts` in whole nanoseconds
    distance: float  #: [m] where the loop ends
    run_up: float = 0.0  #: [m] from where on the speed error counts
    first_end: float = inf  #: [m] where the first change of grade is


class Stretches(NamedTuple):
    """A road as the loop reads it: stretch `i` reaches from `begins[i]` up to `ends[i]` [m].

    Examples
    --------
    >>> from barc_sim import Road, Vehicle
    >>> stretches = Stretches.of(Road.lab(), Vehicle())
    >>> begin, end, push = stretches.at(110.0)
    >>> begin, end, round(push)
    (100.0, 120.0, -9800)
    """

    begins: tuple[float, ...]
    ends: tuple[float, ...]
    pushes: tuple[float, ...]  #: [N] gravity along the road

    @classmethod
    def of(cls, road: Road, vehicle: Vehicle) -> Stretches:
        """Return the stretches of `road`."""
        inner = road.starts[1:]
        weight = -vehicle.mass * vehicle.gravity
        return cls(
            begins=(-inf, *inner),
            ends=(*inner, inf),
            pushes=tuple(weight * sin(radians(grade)) for grade in road.grades_deg),
        )

    def at(self, x: float) -> tuple[float, float, float]:
        """Return begin, end and push of the stretch at `x` metres."""
        i = bisect_right(self.begins, x) - 1
        return self.begins[i], self.ends[i], self.pushes[i]


class Start(NamedTuple):
    """Car and controller before the first step; the default is at rest, without a past.

    Examples
    --------
    >>> Start(v=8.0)
    Start(x=0.0, v=8.0, integral=0.0, previous=0.0, dt=0.0)
    """

    x: float = 0.0  #: [m]
    v: float = 0.0  #: [m/s]
    integral: float = 0.0  #: [m/s²]
    previous: float = 0.0  #: [m/s] measured before; without meaning where `dt` is 0
    dt: float = 0.0  #: [s] since then; 0: there was no measurement


class Result(NamedTuple):
    """The sums of a loop, of which its scores are made; of many loops, an array of each."""

    steps: Any  #: from the first state to the one at the distance; -1: it never arrived
    squares: Any  #: [m²/s²] sum of the squared speed errors after the run-up
    count: Any  #: how many they are
    greatest: Any  #: [m/s] greatest absolute one of them
    peak: Any  #: [m/s] greatest speed on the first stretch
    effort: Any  #: [m²/s⁴] sum of the squared commands


def run(  # noqa: C901, PLR0912, PLR0915 (a call costs as much as a law)
    kp: float,
    ki: float,
    kd: float,
    setting: Setting,
    stretches: Stretches,
    errors: Iterable[float],
    waiting: list[float],
    start: Start,
    appends: tuple[Callable[[float], None], ...],
) -> tuple[int, float, int, float, float, float]:
    """Drive the loop; return the fields of `Result`.

    Parameters
    ----------
    kp, ki, kd
        The gains.
    errors
        [m/s] measured minus true speed of each state: as many as there are states at most.
    waiting
        [m/s²] commands on their way, one for each step of delay, the next first.
    appends
        Take x, v, command, P, I, D and saturation of each state, where `LOGGED`.
    """
    reference, low, high, vehicle, ts, dt, distance, run_up, first_end = setting
    x, v, integral, previous, interval = start
    if LOGGED:
        add_x, add_v, add_command, add_p, add_i, add_d, add_saturated = appends
    locate = stretches.at
    begin, end, push = locate(x)
    steps = -1
    squares = peak = effort = greatest = 0.0
    k = before = oldest = 0
    on_first = True
    delay = len(waiting)
    for k, error in enumerate(errors):
        if x >= end or x < begin:
            begin, end, push = locate(x)
        measured = v + error
        command, proportional, integral, derivative, saturated = pid_step(
            reference, measured, previous, integral, interval, kp, ki, kd, low, high
        )
        previous = measured
        interval = dt
        if LOGGED:
            add_x(x)
            add_v(v)
            add_command(command)
            add_p(proportional)
            add_i(integral)
            add_d(derivative)
            add_saturated(saturated)
        else:
            effort += command * command
            if x >= run_up:
                deviation = reference - v
                square = deviation * deviation
                squares += square
                if square > greatest:  # noqa: PLR1730 (a call of max costs an eighth of a step)
                    greatest = square
            else:
                before += 1
            if on_first:
                if x >= first_end:
                    on_first = False
                elif v > peak:
                    peak = v
        if x >= distance:
            steps = k
            break
        if delay:
            late = waiting[oldest]
            waiting[oldest] = command
            command = late
            oldest = (oldest + 1) % delay
        x += ts * v
        v = next_speed(v, command, push, vehicle, ts)
    return steps, squares, k + 1 - before, sqrt(greatest), peak, effort


LOGGED = True
_LAWS = (pid_step, next_speed, resistance)
drive = specialised(run, *_LAWS, record='vehicle', LOGGED=False)
trace = specialised(run, *_LAWS, record='vehicle', LOGGED=True)


def log_of(
    plant: Plant, pid: PID, speed_reference: float, distance: float, steps: int
) -> Log | None:
    """Return the log of `closed_loop`, for a straight plant.

    It is None, and nothing is done, where a number is not finite.
    """
    state, vehicle, road = plant.state, plant.vehicle, plant.road
    dt = plant.period_ns / 1e9
    setting = Setting(
        reference=speed_reference,
        low=pid.output_min,
        high=pid.output_max,
        vehicle=vehicle,
        ts=plant.ts,
        dt=dt,
        distance=distance,
    )
    start = Start(state.x, state.v, pid.integral)
    if pid.previous is not None:
        start = start._replace(previous=pid.previous, dt=FIRST_DT)
    lists: tuple[list[float], ...] = tuple([] for _ in range(7))
    trace(
        pid.kp,
        pid.ki,
        pid.kd,
        setting,
        Stretches.of(road, vehicle),
        repeat(-0.0, steps + 1),  # which also leaves a speed of -0.0 as it is
        [],
        start,
        tuple(each.append for each in lists),
    )
    columns = tuple(array('d', each) for each in lists[:-1])
    x, v, motor, proportional, integral, derivative = map(np.frombuffer, columns)
    if not all(isfinite(column[-1]) for column in columns):
        return None
    n = len(x)
    zero: Any = np.zeros(n)
    _catch_up(plant, pid, setting, columns)
    stretch, elevation = road.profile(x)
    slopes: Any = np.array([sin(radians(grade)) for grade in road.grades_deg])[stretch]
    states: Any = State(x, np.full(n, state.y), zero, v)  # type: ignore[arg-type]  # arrays
    return Log(
        t=np.arange(n) * plant.period_ns / 1e9,
        **motion(states, 0.0, vehicle)._asdict(),
        **{f'e_{name}': zero for name in MeasurementError._fields},
        motor=motor,
        servo=zero,
        missed=np.zeros(n, np.bool_),
        theta_deg=np.array(road.grades_deg)[stretch],
        elevation=elevation,
        **forces(states.v, slopes, vehicle)._asdict(),
        reference=np.full(n, speed_reference),
        proportional=proportional,
        integral=integral,
        derivative=derivative,
        saturated=np.frombuffer(bytes(map(bool, lists[-1])), np.bool_),
    )


def _catch_up(plant: Plant, pid: PID, setting: Setting, columns: tuple[array[float], ...]) -> None:
    """Leave plant and controller as the general loop does: repeat the last step by them."""
    x, v, motor, _, integral, _ = columns
    arrived = x[-1] >= setting.distance
    last = len(x) - 1
    if last > 0:
        pid.previous, pid.integral = v[last - 1], integral[last - 1]
    pid.acc_calculate(setting.reference, v[last], setting.dt if last else FIRST_DT)
    step = last - 1 if arrived else last
    if step >= 0:
        plant.place(plant.state._replace(x=x[step], v=v[step]))
        plant.advance(Command(motor[step], 0.0))
