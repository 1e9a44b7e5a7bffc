"""A batch of cars: one record for each, and the compiled loop that steps them.

The loop calls the laws that `Plant`, `PID` and `CarEnv` call, in the same order: each car has the
numbers of a single environment, to the last bit.
"""

from __future__ import annotations

from math import cos, nan, sin
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.control.speed import PidGains, PidMemory, pid
from barc_sim.interfaces.records import Command
from barc_sim.learning.tasks import (
    BLOCK,
    LANE,
    Rules,
    Seen,
    Table,
    ahead_at,
    command_of,
    is_over,
    observe,
    reward,
)
from barc_sim.vehicle.bicycles import Bicycle, LateralParameters, Slip
from barc_sim.vehicle.bike_model import BicycleState, Vehicle
from barc_sim.vehicle.law import is_compiled, law
from barc_sim.vehicle.plant import (
    Channel,
    Laps,
    NoiseLevels,
    PlantModel,
    PlantState,
    Queues,
    advance,
    channel_of,
    error_of,
    queue_room,
    start,
    true_motion,
    with_arrays,
    with_error,
)
from barc_sim.vehicle.track import Frenet, in_lap, placed, project, segment_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from barc_sim.control.speed import PID
    from barc_sim.learning.tasks import Task

    Floats = NDArray[np.float64]
    Car = Any  #: a record of `CAR`
    Column = Any  #: a list or tuple of numbers in Python, an array in compiled code

_SIGNALS = len(NoiseLevels._fields)

#: What a batch has of each car: its plant, its controller, and its parameters.
_FLOATS = (
    *('x', 'y', 'psi', 'v', 'beta', 'psi_dot'),
    *('motor', 'servo'),  # of the actuators
    *('s', 'e_y', 'e_psi', 'curvature'),
    *('began', 'finished'),
    *('integral', 'previous'),
    *('commanded_motor', 'commanded_servo', 'speed'),  # the latest command and measurement
    *Vehicle._fields,
    *LateralParameters._fields,
    *('motor_early', 'servo_early', 'noise'),
)
_INTEGERS = ('lap', 'steps', 'segment', 'stretch', 'row', 'motor_whole', 'servo_whole')
_TRUTHS = ('is_whole', 'is_new')  # is_new: its episode begins with the next step
CAR = np.dtype(
    [
        *[(name, np.float64) for name in _FLOATS],
        *[(name, np.int64) for name in _INTEGERS],
        *[(name, np.bool_) for name in _TRUTHS],
    ],
    align=True,
)
#: The columns of the starts of episodes: [m], [m], [rad], [m/s].
STARTS = ('s', 'e_y', 'e_psi', 'v')


class World(NamedTuple):
    """What the cars of a batch have in common."""

    plant: PlantModel
    rules: Rules
    gains: PidGains
    ahead: Table
    noise: NoiseLevels
    is_noisy: bool


class Columns(NamedTuple):
    """The arrays of a batch, with a row for each car."""

    cars: Any  #: of `CAR`, shape (cars,)
    queues: Queues  #: each of shape (cars, room)
    normals: Any  #: for the noise of the next measurements, shape (cars, BLOCK, signals)
    starts: Any  #: of episodes: the values of `STARTS`, shape (cars, 4)
    actions: Any  #: shape (cars, numbers)
    observations: Any  #: shape (cars, numbers)
    rewards: Any  #: shape (cars,)
    over: Any  #: whether the car is beyond the limits, shape (cars,)


def world_of(task: Task, controller: PID) -> World:
    """Return what the cars of a task have in common."""
    model = task.plain.model
    ahead = task.ahead.table
    if 'delay' in task.ranges:
        model = model._replace(
            motor=model.motor._replace(is_ideal=False),
            servo=model.servo._replace(is_ideal=False),
            is_ideal=False,
        )
    if is_compiled():
        model = with_arrays(model)
        ahead = _table(ahead)
    return World(
        plant=model,
        rules=task.rules,
        gains=controller.law_gains,
        ahead=ahead,
        noise=task.noise(0.0),
        is_noisy=task.is_noisy,
    )


def _table(table: Table) -> Table:
    return table._replace(edges=np.array(table.edges), rows=np.array(table.rows))


def columns_of(task: Task, n: int, max_delay: float) -> Columns:
    """Return the arrays of `n` cars, whose delays can be up to `max_delay` [s]."""
    plant = task.plain
    cars = np.zeros(n, CAR)
    for record in (plant.vehicle, plant.model.bicycle.lateral):
        for name, value in record._asdict().items():
            cars[name] = value
    rooms = []
    for name in ('motor', 'servo'):
        channel: Channel = getattr(plant.model, name)
        cars[f'{name}_whole'] = channel.whole
        cars[f'{name}_early'] = channel.early
        longest = channel_of(channel.actuator._replace(delay=max_delay), plant.ts)
        rooms.append(max(queue_room(channel), queue_room(longest)))
    return Columns(
        cars=cars if is_compiled() else cars.view(np.recarray),
        queues=Queues(np.zeros((n, rooms[0])), np.zeros((n, rooms[1]))),
        normals=np.zeros((n, BLOCK if task.is_noisy else 1, _SIGNALS)),
        starts=np.zeros((n, len(STARTS))),
        actions=np.zeros((n, len(task.actions))),
        observations=np.zeros((n, len(task.high))),
        rewards=np.zeros(n),
        over=np.zeros(n, np.bool_),
    )


@law
def model_of(model: PlantModel, car: Car) -> PlantModel:
    """Return the model of a car, with parameters of its own."""
    vehicle = Vehicle(car.mass, car.air_drag_coeff, car.friction, car.l_f, car.l_r, car.gravity)
    lateral = LateralParameters(
        car.yaw_inertia, car.front_stiffness, car.rear_stiffness, car.dynamic_above
    )
    motor = model.motor
    servo = model.servo
    return PlantModel(
        Bicycle(vehicle, lateral, model.bicycle.is_dynamic, model.bicycle.is_rk4),
        Channel(motor.actuator, car.motor_whole, car.motor_early, motor.is_ideal),
        Channel(servo.actuator, car.servo_whole, car.servo_early, servo.is_ideal),
        model.is_ideal,
        model.inclines,
        model.line,
        model.has_track,
        model.ts,
    )


@law
def levels_of(noise: NoiseLevels, of_speed: float) -> NoiseLevels:
    """Return the noise of a car, which has a level of the speed of its own."""
    return NoiseLevels(noise.s, noise.ey, noise.epsi, of_speed, noise.v_y, noise.psi_dot)


@law
def state_of(car: Car) -> PlantState:
    """Return the state of a car's plant."""
    return PlantState(
        BicycleState(car.x, car.y, car.psi, car.v),
        Slip(car.beta, car.psi_dot),
        Command(car.motor, car.servo),
        Frenet(car.s, car.e_y, car.e_psi, car.curvature),
        Laps(car.lap, car.began, car.is_whole, car.finished),
        car.steps,
        car.segment,
        car.stretch,
    )


@law
def store(car: Car, now: PlantState) -> None:
    """Store the state of a car's plant."""
    car.x = now.state.x
    car.y = now.state.y
    car.psi = now.state.psi
    car.v = now.state.v
    car.beta = now.slip.beta
    car.psi_dot = now.slip.psi_dot
    car.motor = now.acting.motor
    car.servo = now.acting.servo
    car.s = now.frenet.s
    car.e_y = now.frenet.e_y
    car.e_psi = now.frenet.e_psi
    car.curvature = now.frenet.curvature
    car.lap = now.laps.lap
    car.began = now.laps.began
    car.is_whole = now.laps.is_whole
    car.finished = now.laps.finished
    car.steps = now.steps
    car.segment = now.segment
    car.stretch = now.stretch


@law
def begin_car(world: World, columns: Columns, i: int) -> PlantState:
    """Start an episode of a car; return the state of its plant."""
    begin = columns.starts[i]
    s = begin[0]
    state = BicycleState(s, 0.0 * s, 0.0 * s, begin[3])
    if world.plant.has_track:
        line = world.plant.line
        at = in_lap(line, s)
        segment = segment_at(line, s)
        pose = placed(line.segments[segment], at - line.starts[segment], begin[1], begin[2])
        state = BicycleState(pose.x, pose.y, pose.psi, begin[3])
    car = columns.cars[i]
    now = start(world.plant, state, s, s == 0.0)
    store(car, now)
    for j in range(columns.queues.motor.shape[1]):
        columns.queues.motor[i, j] = 0.0
    for j in range(columns.queues.servo.shape[1]):
        columns.queues.servo[i, j] = 0.0
    car.integral = 0.0
    car.previous = nan
    car.commanded_motor = 0.0
    car.commanded_servo = 0.0
    car.is_new = False
    return now


@law
def drive_car(world: World, columns: Columns, i: int) -> None:
    """Take a step with a car of a batch, or begin its new episode; measure it."""
    rules = world.rules
    car = columns.cars[i]
    model = model_of(world.plant, car)
    if car.is_new:
        now = begin_car(world, columns, i)
        columns.rewards[i] = 0.0
        columns.over[i] = False
    else:
        before = state_of(car)
        command = answer(world, car, columns.actions[i])
        queues = Queues(columns.queues.motor[i], columns.queues.servo[i])
        now = advance(model, before, queues, command, 0.0)
        store(car, now)
        s = now.frenet.s if rules.has_track else now.state.x
        way = s - (before.frenet.s if rules.has_track else before.state.x)
        columns.rewards[i] = reward(rules, way, now.frenet.e_y, now.state.v)
        columns.over[i] = is_over(rules, s, now.frenet.e_y, now.state.v)

    seen = true_motion(model, now)
    place = now.frenet
    if world.is_noisy:
        error = error_of(levels_of(world.noise, car.noise), columns.normals[i, now.steps % BLOCK])
        seen = with_error(seen, error, cos(seen.psi), sin(seen.psi))
        if rules.has_track:
            place, _ = project(model.line, seen.x, seen.y, seen.psi, place.s, now.segment)
    car.speed = seen.v_x
    car.row = ahead_at(world.ahead, place.s if rules.has_track else seen.x, car.row)
    found = Seen(
        rules.speed - seen.v_x,
        place.e_y,
        place.e_psi,
        seen.v_x,
        car.commanded_motor,
        car.commanded_servo,
    )
    observe(rules, found, world.ahead.rows[car.row], columns.observations[i])


@law
def answer(world: World, car: Car, action: Column) -> Command:
    """Return the command to a car for an action, and store it."""
    of_speed = 0.0
    if world.rules.task == LANE:
        memory = PidMemory(car.integral, car.previous)
        memory, terms = pid(memory, world.gains, world.rules.speed, car.speed, world.plant.ts)
        car.integral = memory.integral
        car.previous = memory.previous
        of_speed = terms.output
    command = command_of(world.rules, of_speed, action)
    car.commanded_motor = command.motor
    car.commanded_servo = command.servo
    return command


def step_cars(world: World, columns: Columns, first: int, last: int) -> None:
    """Take a step with these cars of a batch, and measure them."""
    for i in range(first, last):
        drive_car(world, columns, i)
