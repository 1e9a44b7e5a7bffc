"""The drive of a car straight along its road under a PID: one loop, in Python or compiled.

`pid_log` makes the log of one run, and `scores_of_gains` the scores of many. The loop calls the
laws that `Plant` and `PID` call, in the same order: its states are those of `closed_loop` to the
last bit.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from math import ceil, inf, nan, sqrt
from os import cpu_count
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.control.speed import FIRST_DT, PidGains, PidMemory, pid
from barc_sim.interfaces.records import Command, MeasurementError
from barc_sim.simulation.log import log_of
from barc_sim.simulation.metrics import RUN_UP
from barc_sim.vehicle.bicycles import Bicycle, Slip, bicycle_step
from barc_sim.vehicle.bike_model import BicycleState, motion, step, surroundings
from barc_sim.vehicle.law import compiled, is_compiled, law
from barc_sim.vehicle.plant import Actuator, Sensor, actuate, with_error, with_force
from barc_sim.vehicle.road import Inclines, stretch_at

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from barc_sim.control.speed import PID
    from barc_sim.simulation.log import Log
    from barc_sim.vehicle.plant import Plant

    Floats = NDArray[np.float64]
    Ints = NDArray[np.intp]
    Column = Any  #: a list of numbers in Python, an array in compiled code


_SIGNALS = len(MeasurementError._fields)
_SPEED = MeasurementError._fields.index('v_x')
_USUAL = 2048  #: states of a run, for which there is room at first
_MAX_PIECE = 4096  #: runs that a thread makes at a time


class Course(NamedTuple):
    """A run along a road, but for its controller; columns of numbers are lists or arrays."""

    inclines: Inclines
    bicycle: Bicycle
    is_euler: bool  #: the bicycle is the kinematic one, by forward Euler
    force: float  #: [N] on the car
    motor: Actuator
    is_ideal: bool  #: a command acts at once
    early: float  #: share of a step for which the older of two commands acts
    waiting: Column  #: [m/s²] commands before the run that have not acted, the oldest first
    start: BicycleState
    value: float  #: [m/s²] of the motor at the start
    reference: float  #: [m/s] speed to hold
    distance: float  #: [m] at which the run ends
    ts: float  #: [s] of a step
    dt: float  #: [s] between two stamps
    errors: Column  #: [m/s] measured minus true speed, of each state; empty: there are none


class Trace(NamedTuple):
    """The states of a run, as the loop stores them, with room for all of them in each column."""

    x: Column  #: [m]
    y: Column  #: [m]
    psi: Column  #: [rad]
    v: Column  #: [m/s]
    commands: Column  #: [m/s²] behind those that wait at the start
    proportional: Column  #: [m/s²]
    integral: Column  #: [m/s²] after the command
    derivative: Column  #: [m/s²]
    saturated: Column  #: 1 where a limit cut the command


def course_of(
    plant: Plant, reference: float, distance: float, errors: Floats, *, is_array: bool = False
) -> Course:
    """Return the run of a plant that `has_fast_path`, from its present state.

    `errors` are those of its measurements, shape `(n, 6)`. `is_array` makes arrays of the columns,
    for a compiled loop; Python is faster with lists.
    """

    def column(values: Iterable[float]) -> Column:
        return np.array([*values], np.float64) if is_array else [*values]

    of_speed = errors[:, _SPEED]

    bicycle = plant.model.bicycle
    inclines = plant.model.inclines
    motor = plant.model.motor
    return Course(
        inclines=Inclines(column(inclines.starts), column(inclines.thetas)),
        bicycle=bicycle,
        is_euler=not (bicycle.is_dynamic or bicycle.is_rk4),
        force=float(plant.force),
        motor=motor.actuator,
        is_ideal=motor.is_ideal,
        early=motor.early,
        waiting=column(plant.waiting.motor),
        start=plant.state,
        value=plant.acting.motor,
        reference=reference,
        distance=distance,
        ts=plant.ts,
        dt=plant.period_ns / 1e9,
        errors=of_speed.copy() if is_array else of_speed.tolist(),
    )


def trace_of(course: Course, states: int, *, is_array: bool = False) -> Trace:
    """Return a trace with room for this number of states."""
    rooms = Trace(*[states] * len(Trace._fields))
    rooms = rooms._replace(commands=len(course.waiting) + states)
    return Trace(*[np.zeros(room) if is_array else [0.0] * room for room in rooms])


@law
def drive(course: Course, gains: PidGains, memory: PidMemory, trace: Trace) -> int:
    """Drive until the distance is reached or the trace is full; return the number of states."""
    bicycle = course.bicycle
    vehicle = bicycle.vehicle
    is_euler = course.is_euler
    inclines = course.inclines
    state = course.start
    slip = Slip(0.0, 0.0)
    value = course.value
    dt = FIRST_DT
    stretch = 0
    wait = len(course.waiting)
    for k in range(wait):
        trace.commands[k] = course.waiting[k]
    is_noisy = len(course.errors) > 0

    count = 0
    while True:
        measured = state.v
        if is_noisy:
            measured += course.errors[count]
        memory, terms = pid(memory, gains, course.reference, measured, dt)
        dt = course.dt

        trace.x[count] = state.x
        trace.y[count] = state.y
        trace.psi[count] = state.psi
        trace.v[count] = state.v
        trace.commands[wait + count] = terms.output
        trace.proportional[count] = terms.proportional
        trace.integral[count] = memory.integral
        trace.derivative[count] = terms.derivative
        trace.saturated[count] = terms.saturated
        count += 1
        if state.x >= course.distance or count == len(trace.v):
            return count

        motor = terms.output
        if not course.is_ideal:
            older = trace.commands[count - 1]
            newer = trace.commands[count]
            value, motor = actuate(course.motor, value, older, newer, course.early, course.ts)
        if course.force:
            motor = with_force(motor, course.force, vehicle)
        held = Command(motor, 0.0)
        stretch = stretch_at(inclines.starts, state.x, stretch)
        if is_euler:  # a shorter way in Python, to the same law
            state = step(state, held, inclines.thetas[stretch], vehicle, course.ts)
        else:
            state, slip = bicycle_step(bicycle, state, slip, held, inclines, stretch, course.ts)


class Scores(NamedTuple):
    """The scores of a run, as `metrics.summary` defines them; infinite if it did not arrive."""

    rms_error: float = inf  #: [m/s] beyond `RUN_UP`
    max_error: float = inf  #: [m/s]
    overshoot: float = inf  #: of the first grade's speed, as a share of the reference
    effort: float = inf  #: [m/s²] RMS command


@law
def score(course: Course, trace: Trace, count: int) -> Scores:
    """Return the scores of a run of `count` states."""
    if trace.x[count - 1] < course.distance:
        return Scores(inf, inf, inf, inf)

    squares = 0.0
    largest = 0.0
    counted = 0
    effort = 0.0
    fastest = -inf
    inclines = course.inclines
    stretch = stretch_at(inclines.starts, trace.x[0], 0)
    first = inclines.thetas[stretch]
    is_first = True
    wait = len(course.waiting)
    for k in range(count):
        x = trace.x[k]
        error = abs(course.reference - trace.v[k])
        if x >= RUN_UP:
            squares += error * error
            largest = max(largest, error)
            counted += 1
        command = trace.commands[wait + k]
        effort += command * command
        stretch = stretch_at(inclines.starts, x, stretch)
        is_first = is_first and inclines.thetas[stretch] == first
        if is_first:
            fastest = max(fastest, trace.v[k] / course.reference)
    return Scores(sqrt(squares / counted), largest, max(fastest - 1.0, 0.0), sqrt(effort / count))


def score_all(course: Course, gains: Floats, limit: float, trace: Trace, scores: Floats) -> None:
    """Drive with each of the gains, shape `(n, 3)`, and store the scores, shape `(n, 4)`."""
    for i in range(len(gains)):
        of_run = PidGains(gains[i, 0], gains[i, 1], gains[i, 2], -limit, limit)
        count = drive(course, of_run, PidMemory(0.0, nan), trace)
        found = score(course, trace, count)
        scores[i, 0] = found.rms_error
        scores[i, 1] = found.max_error
        scores[i, 2] = found.overshoot
        scores[i, 3] = found.effort


def scores_of_gains(
    plant: Plant,
    gains: Floats,
    limit: float,
    reference: float,
    distance: float,
    steps: int,
    seeds: Ints | None = None,
) -> Floats:
    """Return the scores of runs with these gains, on all cores where they are compiled.

    Parameters
    ----------
    plant
        The car at its start, which `has_fast_path`.
    gains
        kp, ki and kd of each run, shape `(n, 3)`.
    limit
        [m/s²] of the command, either way.
    reference, distance
        [m/s], [m]
    steps
        after which a run ends that has not arrived.
    seeds
        of the noise of each run, shape `(n,)`; by default the plant's for all.

    Returns
    -------
    ndarray
        The fields of `Scores` of each run, shape `(n, 4)`.
    """
    scores = np.empty((len(gains), len(Scores._fields)))
    workers = (cpu_count() or 1) if is_compiled() else 1
    size = max(min(ceil(len(gains) / workers), _MAX_PIECE), 1)
    groups = [np.arange(len(gains))]
    sensors = [plant.sensor]
    if seeds is not None and plant.sensor.is_noisy:
        of_each, which = np.unique(seeds, return_inverse=True)
        sensors = [Sensor(plant.sensor.noise, seed) for seed in of_each.tolist()]
        groups = np.split(np.argsort(which, kind='stable'), np.cumsum(np.bincount(which))[:-1])

    score_runs = compiled(score_all)

    def run_group(sensor: Sensor, runs: Ints) -> None:
        errors = np.empty((0, _SIGNALS))
        # Noise takes time to be drawn; room without noise takes none.
        for last in _rooms(steps + 1) if sensor.is_noisy else [steps + 1]:
            if sensor.is_noisy:
                errors = sensor.draw(last)
            course = course_of(plant, reference, distance, errors, is_array=is_compiled())
            trace = trace_of(course, last, is_array=is_compiled())
            found = np.empty((len(runs), scores.shape[1]))
            score_runs(course, gains[runs], limit, trace, found)
            scores[runs] = found
            runs = runs[np.isinf(found[:, 0])]  # these have not arrived
            if not len(runs):
                break

    jobs = [
        (sensor, runs[first : first + size])
        for sensor, runs in zip(sensors, groups, strict=True)
        for first in range(0, len(runs), size)
    ]
    if len(jobs) == 1:
        run_group(*jobs[0])
        return scores
    with ThreadPoolExecutor(workers) as threads:
        for done in [threads.submit(run_group, *job) for job in jobs]:
            done.result()
    return scores


def _rooms(states: int) -> Iterator[int]:
    """Yield numbers of states, from those of a usual run up to this one."""
    room = min(states, _USUAL)
    yield room
    while room < states:
        room = min(4 * room, states)
        yield room


def pid_log(plant: Plant, controller: PID, reference: float, distance: float, steps: int) -> Log:
    """Return the log of `closed_loop` for a plant that `has_fast_path`, without changing either."""
    gains = controller.law_gains
    memory = controller.memory
    for states in _rooms(steps + 1):
        errors = _errors(plant, states)
        course = course_of(plant, reference, distance, errors)
        trace = trace_of(course, states)
        count = drive(course, gains, memory, trace)
        if count < states:
            break
    return _log_of(plant, course, trace, errors[:count], count)


def _errors(plant: Plant, states: int) -> Floats:
    """Return measured minus true of each state, shape `(states, 6)`; `(0, 6)` without noise."""
    if not plant.sensor.is_noisy:
        return np.empty((0, _SIGNALS))
    return plant.sensor.draw(states)


@np.errstate(over='ignore', invalid='ignore')  # as with floats
def _log_of(plant: Plant, course: Course, trace: Trace, errors: Floats, count: int) -> Log:
    """Return the log of a run of `count` states."""
    zero: Any = np.zeros(count)
    error: Any = MeasurementError(*(errors.T if errors.size else [zero] * 6))
    wait = len(course.waiting)
    rows = trace._replace(commands=trace.commands[wait:])
    column = Trace(*[np.array(each[:count]) for each in rows])
    states = BicycleState(column.x, column.y, column.psi, column.v)
    measured = motion(states, 0.0, plant.vehicle)
    if errors.size:
        measured = with_error(measured, error, np.cos(column.psi), np.sin(column.psi))
    around = surroundings(column.v, plant.road.at(column.x), plant.vehicle)
    return log_of(
        plant.period_ns,
        measured,
        error,
        Command(column.commands, zero),
        around,
        reference=np.full(count, course.reference),
        proportional=column.proportional,
        integral=column.integral,
        derivative=column.derivative,
        saturated=column.saturated,
    )
