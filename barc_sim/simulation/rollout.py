"""The runs of a car straight along its road under a PID: one loop, in Python or compiled.

`pid_log` makes the log of one run, for `closed_loop`, and `scores_of_gains` the scores of many, for
sweeps. The loop calls the laws that `Plant` and `PID` call, in the same order: its states are those
of the loop in `closed_loop` to the last bit.
"""

from __future__ import annotations

from math import inf, nan
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.control.speed import FIRST_DT, PidGains, PidMemory, pid
from barc_sim.interfaces.records import Command, MeasurementError
from barc_sim.simulation.log import log_of
from barc_sim.simulation.many_runs import rooms_for, scores_of_many, usual_states
from barc_sim.simulation.scores import Driven, Scores, first_states, score
from barc_sim.vehicle.bicycles import NO_SLIP, Bicycle, bicycle_step
from barc_sim.vehicle.bike_model import BicycleState, motion, step, surroundings
from barc_sim.vehicle.law import compiled, is_compiled, law
from barc_sim.vehicle.plant import Actuator, actuate, with_arrays, with_error, with_force
from barc_sim.vehicle.road import Inclines, stretch_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from barc_sim.control.speed import PID
    from barc_sim.simulation.log import Log
    from barc_sim.vehicle.plant import Plant

    Floats = NDArray[np.float64]
    Ints = NDArray[np.intp]
    Column = Any  #: a list of numbers in Python, an array in compiled code


_SIGNALS = len(MeasurementError._fields)
_SPEED = MeasurementError._fields.index('v_x')


class StraightRun(NamedTuple):
    """A run straight along a road, without its controller; columns are lists or arrays."""

    inclines: Inclines
    bicycle: Bicycle
    is_euler: bool  #: the bicycle is the kinematic one, by forward Euler
    force: float  #: [N] on the car
    motor: Actuator
    is_ideal: bool  #: a command acts at once
    early: float  #: share of a step for which the older of two commands acts
    #: [m/s²] The commands before the run that have not acted, the oldest first: one more than the
    #: delay has whole steps.
    waiting: Column
    start: BicycleState
    motor_value: float  #: [m/s²] of the motor at the start
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
    speed: Column  #: [m/s] as a log with noise has it: measured minus error
    reference: Column  #: [m/s]
    #: [m/s²] A queue: the commands that wait at the start, then those of the states.
    commands: Column
    proportional: Column  #: [m/s²]
    integral: Column  #: [m/s²] after the command
    derivative: Column  #: [m/s²]
    saturated: Column  #: 1 where a limit cut the command


def run_of(
    plant: Plant, reference: float, distance: float, *, is_array: bool = False
) -> StraightRun:
    """Return the run of a plant that `has_fast_path`, from its present state, without noise.

    `is_array` makes arrays of the columns, for a compiled loop; Python is faster with lists.
    """
    model = with_arrays(plant.model) if is_array else plant.model
    waiting = plant.waiting.motor
    return StraightRun(
        inclines=model.inclines,
        bicycle=model.bicycle,
        is_euler=not (model.bicycle.is_dynamic or model.bicycle.is_rk4),
        force=float(plant.force),
        motor=model.motor.actuator,
        is_ideal=model.motor.is_ideal,
        early=model.motor.early,
        waiting=np.array(waiting, np.float64) if is_array else waiting,
        start=BicycleState._make(map(float, plant.state)),
        motor_value=float(plant.acting.motor),
        reference=float(reference),
        distance=float(distance),
        ts=model.ts,
        dt=plant.period_ns / 1e9,
        errors=np.empty(0) if is_array else [],
    )


def with_errors(run: StraightRun, errors: Floats) -> StraightRun:
    """Return a run with these errors [m/s] of the measured speed."""
    is_array = isinstance(run.errors, np.ndarray)
    return run._replace(errors=errors if is_array else errors.tolist())


def trace_of(run: StraightRun, states: int, *, is_array: bool = False) -> Trace:
    """Return a trace with room for this number of states."""

    def column(room: int) -> Column:
        return np.zeros(room) if is_array else [0.0] * room

    return Trace(
        x=column(states),
        y=column(states),
        psi=column(states),
        v=column(states),
        speed=column(states if len(run.errors) else 0),
        reference=column(states),
        commands=column(len(run.waiting) + states),
        proportional=column(states),
        integral=column(states),
        derivative=column(states),
        saturated=column(states),
    )


@law
def drive_by_pid(run: StraightRun, gains: PidGains, memory: PidMemory, trace: Trace) -> int:
    """Drive until the distance is reached or the trace is full; return the number of states."""
    bicycle = run.bicycle
    vehicle = bicycle.vehicle
    is_euler = run.is_euler
    inclines = run.inclines
    state = run.start
    slip = NO_SLIP
    motor_value = run.motor_value
    dt = FIRST_DT
    stretch = 0
    queue = trace.commands
    newest = 0  # where the next command joins the queue
    for command in run.waiting:
        queue[newest] = command
        newest += 1
    is_noisy = len(run.errors) > 0
    reference = run.reference
    room = len(trace.v)

    for k in range(room):
        measured = state.v
        if is_noisy:
            error = run.errors[k]
            measured += error
            trace.speed[k] = measured - error
        memory, terms = pid(memory, gains, reference, measured, dt)
        dt = run.dt

        trace.x[k] = state.x
        trace.y[k] = state.y
        trace.psi[k] = state.psi
        trace.v[k] = state.v
        trace.reference[k] = reference
        trace.proportional[k] = terms.proportional
        trace.integral[k] = memory.integral
        trace.derivative[k] = terms.derivative
        trace.saturated[k] = terms.saturated
        queue[newest] = terms.output
        newest += 1
        if state.x >= run.distance:
            return k + 1

        mean_motor = terms.output
        if not run.is_ideal:
            # Each step takes the two oldest commands of the queue.
            older = queue[k]
            newer = queue[k + 1]
            motor_value, mean_motor = actuate(
                run.motor, motor_value, older, newer, run.early, run.ts
            )
        if run.force:
            mean_motor = with_force(mean_motor, run.force, vehicle)
        mean = Command(mean_motor, 0.0)
        stretch = stretch_at(inclines.starts, state.x, stretch)
        if is_euler:  # a shorter way in Python, to the same law
            state = step(state, mean, inclines.thetas[stretch], vehicle, run.ts)
        else:
            state, slip = bicycle_step(bicycle, state, slip, mean, inclines, stretch, run.ts)
    return room


def score_all(run: StraightRun, gains: Floats, limit: float, trace: Trace, scores: Floats) -> None:
    """Drive with each of the gains, shape `(n, 3)`, and store the scores, shape `(n, 4)`."""
    speed = trace.speed if len(run.errors) > 0 else trace.v
    for i in range(len(gains)):
        of_run = PidGains(gains[i, 0], gains[i, 1], gains[i, 2], -limit, limit)
        count = drive_by_pid(run, of_run, PidMemory(0.0, nan), trace)
        of_speed = Scores(inf, inf, inf, inf)
        if trace.x[count - 1] >= run.distance:
            motor = trace.commands[len(run.waiting) :]
            driven = Driven(trace.x, speed, trace.reference, motor)
            first = first_states(run.inclines, driven, count, inf)
            of_speed = score(driven, count, first)
        scores[i, 0] = of_speed.rms_error
        scores[i, 1] = of_speed.max_error
        scores[i, 2] = of_speed.overshoot
        scores[i, 3] = of_speed.effort


def scores_of_gains(
    plant: Plant,
    gains: Floats,
    limit: float,
    reference: float,
    distance: float,
    steps: int,
    seeds: Ints | None = None,
    threads: int | None = None,
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
        after which a run ends even if it has not arrived.
    seeds
        of the noise of each run, shape `(n,)`; by default the plant's for all.
    threads
        number of threads for compiled runs; by default one for each core.

    Returns
    -------
    ndarray
        The fields of `Scores` of each run, shape `(n, 4)`.
    """
    is_array = is_compiled()
    width = len(Scores._fields)
    run = run_of(plant, reference, distance, is_array=is_array)
    score_group = compiled(score_all)

    def score_runs(gains: Floats, normals: Floats, states: int) -> Floats:
        with_noise = with_errors(run, normals[:, _SPEED] * plant.sensor.noise.v_x)
        trace = trace_of(with_noise, states, is_array=is_array)
        scores = np.empty((len(gains), width))
        score_group(with_noise, gains, float(limit), trace, scores)
        return scores

    usual = usual_states(distance, reference, plant.ts)
    return scores_of_many(score_runs, plant.sensor, gains, width, steps + 1, seeds, usual, threads)


def pid_log(plant: Plant, controller: PID, reference: float, distance: float, steps: int) -> Log:
    """Return the log of `closed_loop` for a plant that `has_fast_path`, without changing either."""
    gains = controller.law_gains
    memory = controller.memory
    without_noise = run_of(plant, reference, distance)
    for states in rooms_for(steps + 1):
        errors = _errors(plant, states)
        run = with_errors(without_noise, errors[:, _SPEED])
        trace = trace_of(run, states)
        count = drive_by_pid(run, gains, memory, trace)
        if count < states:
            break
    return _log_of(plant, run, trace, errors[:count], count)


def _errors(plant: Plant, states: int) -> Floats:
    """Return measured minus true of each state, shape `(states, 6)`; `(0, 6)` without noise."""
    if not plant.sensor.is_noisy:
        return np.empty((0, _SIGNALS))
    return plant.sensor.errors(states)


@np.errstate(over='ignore', invalid='ignore')  # as with floats
def _log_of(plant: Plant, run: StraightRun, trace: Trace, errors: Floats, count: int) -> Log:
    """Return the log of a run of `count` states."""
    zero: Any = np.zeros(count)
    error: Any = MeasurementError(zero, zero, zero, zero, zero, zero)
    if errors.size:
        error = MeasurementError._make(errors.T)

    rows = trace._replace(commands=trace.commands[len(run.waiting) :])
    column = Trace._make(np.array(values[:count]) for values in rows)
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
        reference=column.reference,
        proportional=column.proportional,
        integral=column.integral,
        derivative=column.derivative,
        saturated=column.saturated,
    )
