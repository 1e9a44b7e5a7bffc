"""A batch of cars: one record for each, and the compiled loop that steps them.

The loop calls the laws that `Plant`, `PID`, `Sensor` and `CarEnv` call, in the same order: each car
has the numbers of a single environment, to the last bit.
"""

from __future__ import annotations

from math import cos, isnan, nan, sin
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.control.speed import PidGains, PidMemory, pid
from barc_sim.interfaces.records import Command, VehicleState
from barc_sim.learning.preview import PreviewTable, row_at, with_preview_arrays
from barc_sim.learning.tasks import (
    LANE,
    STARTS,
    CarSignals,
    Rules,
    command_of,
    is_over,
    observe,
    reward,
)
from barc_sim.vehicle.bicycles import Bicycle, LateralParameters, Slip, slip_of, store_slip
from barc_sim.vehicle.bike_model import BicycleState, Vehicle
from barc_sim.vehicle.law import is_compiled, law
from barc_sim.vehicle.plant import (
    Channel,
    LapState,
    NoiseLevels,
    PlantModel,
    PlantState,
    Queues,
    advance,
    channel_of,
    error_of,
    in_steps,
    measured_late,
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
    from barc_sim.learning.tasks import DrivingTask

    Floats = NDArray[np.float64]
    Car = Any  #: a record of `CAR`
    Column = Any  #: a list or tuple of numbers in Python, an array in compiled code

NOISE_BLOCK = 64  #: measurements of each car whose noise is drawn at once
_SIGNALS = len(NoiseLevels._fields)

#: The numbers of each car: its plant, its controller, and its parameters.
_FLOATS = (
    *BicycleState._fields,
    *Slip._fields,
    *('motor', 'servo'),  # of the actuators
    *('s', 'e_y', 'e_psi', 'curvature'),
    *('began', 'finished'),
    *('integral', 'previous'),
    *('commanded_motor', 'commanded_servo', 'speed'),  # the latest command and measurement
    *Vehicle._fields,
    *LateralParameters._fields,
    *('motor_early', 'servo_early', 'noise', 'force'),
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


class BatchModel(NamedTuple):
    """What the cars of a batch have in common."""

    plant: PlantModel
    rules: Rules
    gains: PidGains
    ahead: PreviewTable
    noise: NoiseLevels
    is_noisy: bool
    sensor_whole: int  #: steps from a state to its measurement
    sensor_share: float  #: share of a step beyond them
    is_late: bool  #: the sensor measures late


class BatchColumns(NamedTuple):
    """The arrays of a batch, with a row for each car unless the shape differs."""

    cars: Any  #: of `CAR`, shape (cars,)
    queues: Queues  #: each of shape (cars, room)
    past: Any  #: the latest motions, for a late sensor: shape (cars, room, signals)
    normals: Any  #: for the noise of the next measurements, shape (NOISE_BLOCK, cars, signals)
    starts: Any  #: of episodes: the values of `STARTS`, shape (cars, 4)
    actions: Any  #: shape (cars, numbers)
    observations: Any  #: shape (cars, numbers)
    rewards: Any  #: shape (cars,)
    over: Any  #: whether the car is beyond the limits, shape (cars,)


def batch_model_of(task: DrivingTask, controller: PID) -> BatchModel:
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
        ahead = with_preview_arrays(ahead)

    sensor = task.plain.sensor
    whole, share = in_steps(sensor.delay, task.ts)
    return BatchModel(
        plant=model,
        rules=task.rules,
        gains=controller.law_gains,
        ahead=ahead,
        noise=NoiseLevels._make(map(float, sensor.noise)),
        is_noisy=task.is_noisy,
        sensor_whole=whole,
        sensor_share=share,
        is_late=sensor.delay > 0.0,
    )


def batch_columns_of(task: DrivingTask, n: int) -> BatchColumns:
    """Return the arrays of `n` cars."""
    plant = task.plain
    cars = np.zeros(n, CAR)
    for record in (plant.vehicle, plant.model.bicycle.lateral):
        for name, value in record._asdict().items():
            cars[name] = value
    cars['force'] = plant.force

    rooms = []
    _, max_delay = task.ranges.get('delay', (0.0, 0.0))
    for name in ('motor', 'servo'):
        channel: Channel = getattr(plant.model, name)
        cars[f'{name}_whole'] = channel.whole
        cars[f'{name}_early'] = channel.early
        longest = channel_of(channel.actuator._replace(delay=max_delay), plant.ts)
        rooms.append(max(queue_room(channel), queue_room(longest)))

    past_room = 1
    if plant.sensor.delay:
        whole, _ = in_steps(plant.sensor.delay, task.ts)
        past_room = whole + 2
    return BatchColumns(
        cars=cars if is_compiled() else cars.view(np.recarray),
        queues=Queues(np.zeros((n, rooms[0])), np.zeros((n, rooms[1]))),
        past=np.zeros((n, past_room, _SIGNALS)),
        normals=np.zeros((NOISE_BLOCK if task.is_noisy else 1, n, _SIGNALS)),
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
def levels_of(noise: NoiseLevels, speed_level: float) -> NoiseLevels:
    """Return the noise of a car, which has a level of the speed of its own."""
    return NoiseLevels(noise.s, noise.ey, noise.epsi, speed_level, noise.v_y, noise.psi_dot)


@law
def state_of(car: Car) -> PlantState:
    """Return the state of a car's plant."""
    return PlantState(
        BicycleState(car.x, car.y, car.psi, car.v),
        slip_of(car),
        Command(car.motor, car.servo),
        Frenet(car.s, car.e_y, car.e_psi, car.curvature),
        LapState(car.lap, car.began, car.is_whole, car.finished),
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
    store_slip(car, now.slip)

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
def begin_car(batch: BatchModel, columns: BatchColumns, i: int) -> PlantState:
    """Start an episode of a car; return the state of its plant."""
    begin = columns.starts[i]
    s = begin[0]
    v = begin[3]
    state = BicycleState(s, 0.0, 0.0, v)
    if batch.plant.has_track:
        line = batch.plant.line
        segment = segment_at(line, s)
        ahead = in_lap(line, s) - line.starts[segment]
        pose = placed(line.segments[segment], ahead, begin[1], begin[2])
        state = BicycleState(pose.x, pose.y, pose.psi, v)

    car = columns.cars[i]
    now = start(batch.plant, state, s, s == 0.0)
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
def drive_car(
    batch: BatchModel, columns: BatchColumns, i: int, model: PlantModel, action: Column
) -> PlantState:
    """Take a step with a car of a batch; return the state of its plant."""
    rules = batch.rules
    car = columns.cars[i]
    before = state_of(car)

    command = answer(batch, car, action)
    queues = Queues(columns.queues.motor[i], columns.queues.servo[i])
    now = advance(model, before, queues, command, car.force)
    store(car, now)

    s = now.frenet.s
    way = s - before.frenet.s
    if not rules.has_track:
        s = now.state.x
        way = s - before.state.x
    columns.rewards[i] = reward(rules, way, now.frenet.e_y, now.state.v)
    columns.over[i] = is_over(rules, s, now.frenet.e_y, now.state.v)
    return now


@law
def answer(batch: BatchModel, car: Car, action: Column) -> Command:
    """Return the command to a car for an action, and store it."""
    speed_command = 0.0
    if batch.rules.task == LANE:
        memory = PidMemory(car.integral, car.previous)
        memory, terms = pid(memory, batch.gains, batch.rules.speed, car.speed, batch.plant.ts)
        car.integral = memory.integral
        car.previous = memory.previous
        speed_command = terms.output

    command = command_of(batch.rules, speed_command, action)
    car.commanded_motor = command.motor
    car.commanded_servo = command.servo
    return command


@law
def measure_car(
    batch: BatchModel, columns: BatchColumns, i: int, motion: VehicleState, steps: int, k: int
) -> VehicleState:
    """Return a motion as the sensor of a car measures it, with row `k` of the noise."""
    if batch.is_late:
        motion = measured_late(
            columns.past[i], steps, motion, batch.sensor_whole, batch.sensor_share
        )

    if batch.is_noisy:
        levels = levels_of(batch.noise, columns.cars[i].noise)
        error = error_of(levels, columns.normals[k, i])
        motion = with_error(motion, error, cos(motion.psi), sin(motion.psi))
    return motion


@law
def observe_car(
    batch: BatchModel, columns: BatchColumns, i: int, model: PlantModel, now: PlantState, k: int
) -> None:
    """Measure a car of a batch, with row `k` of the noise, and store its observation."""
    rules = batch.rules
    car = columns.cars[i]
    motion = true_motion(model, now)
    place = now.frenet
    if batch.is_late or batch.is_noisy:
        motion = measure_car(batch, columns, i, motion, now.steps, k)
        if rules.has_track:
            place, _ = project(model.line, motion.x, motion.y, motion.psi, place.s, now.segment)
    car.speed = motion.v_x

    signals = CarSignals(
        rules.speed - motion.v_x,
        place.e_y,
        place.e_psi,
        motion.v_x,
        car.commanded_motor,
        car.commanded_servo,
    )
    observation = columns.observations[i]
    count = observe(rules, signals, observation)

    car.row = row_at(batch.ahead, place.s if rules.has_track else motion.x, car.row)
    ahead = batch.ahead.rows[car.row]
    for j in range(len(ahead)):
        observation[count + j] = ahead[j]


@law
def step_car(batch: BatchModel, columns: BatchColumns, k: int, i: int) -> bool:
    """Take a step with a car of a batch, or begin its new episode; measure it.

    Return whether it has finished a lap in this step.
    """
    car = columns.cars[i]
    model = model_of(batch.plant, car)
    has_finished = False

    if car.is_new:
        now = begin_car(batch, columns, i)
        columns.rewards[i] = 0.0
        columns.over[i] = False
    else:
        now = drive_car(batch, columns, i, model, columns.actions[i])
        has_finished = not isnan(now.laps.finished)

    observe_car(batch, columns, i, model, now, k)
    return has_finished


def step_cars(batch: BatchModel, columns: BatchColumns, k: int, first: int, last: int) -> int:
    """Step and measure these cars of a batch, with row `k` of the noise.

    Return how many laps they have finished in this step. Only a law makes records of arrays here:
    compiled laws count no references to them.
    """
    laps = 0
    for i in range(first, last):
        if step_car(batch, columns, k, i):
            laps += 1
    return laps
