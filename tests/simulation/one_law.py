"""Prints, as JSON, a figure of each part of the program that steps the car.

The arguments are the car's rolling resistance [N] and the time constant of its actuators [s]. The
working directory gets the bag of a run.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

import barc_sim.learning  # noqa: F401 (registers the environments)
from barc_sim import Actuator, LaneLQR, PurePursuit, lap, read_bag, simulate, sweep
from barc_sim.__main__ import main as barc
from barc_sim.lab.labs import lane
from barc_sim.tuning.prediction import CarModel, HeldValues, Stretch, predict
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log

_STEPS = 100
_ACTIONS = {'Hills': [0.2], 'Lane': [0.1], 'Race': [0.2, 0.1]}


def _end(log: Log) -> list[float]:
    return [float(log.x[-1]), float(log.y[-1]), float(log.v_x[-1])]


def of_node(vehicle: Vehicle, actuator: Actuator) -> list[float]:
    """Return the end of a run of the nodes, without DDS."""
    parameters = {
        'friction': vehicle.friction,
        'motor_lag': actuator.lag,
        'servo_lag': actuator.lag,
    }
    words = ['acc', '--engine', 'local', '--realtime-factor', 'max', '--distance', '60', '--quiet']
    words += ['--track', 'oval', '--laps', '1', '--ros-args']
    for name, value in parameters.items():
        words += ['-p', f'vehicle_simulator:{name}:={value!r}']
    with contextlib.redirect_stdout(io.StringIO()):
        barc(words)
    (bag,) = Path('bags').iterdir()
    return _end(read_bag(bag))


def of_simulate(vehicle: Vehicle, actuator: Actuator) -> list[float]:
    """Return the ends of a run along a road, and along a track by two laws of steering."""
    ends = _end(simulate(vehicle=vehicle, distance=60.0))
    for steering in (LaneLQR(), PurePursuit()):
        ends += _end(lap(steering, 'oval', laps=1, vehicle=vehicle, servo=actuator))
    return ends


def of_sweep(vehicle: Vehicle, actuator: Actuator) -> list[float]:
    """Return scores of two gains on a road, and of two in a lap of a track."""
    table = sweep(kp=[10.0, 30.0], vehicle=vehicle, distance=60.0)
    laps = sweep(
        track='oval', laps=1, lane=LaneLQR(), q_e_y=[0.02, 0.05], vehicle=vehicle, servo=actuator
    )
    scores = (table.rms_error, table.effort, laps.effort, laps.rms_e_y)
    return [value for each in scores for value in each.tolist()]


def of_environment(vehicle: Vehicle, actuator: Actuator, cars: int = 0) -> list[float]:
    """Return the observations at the end of an episode in each environment, of one car or many."""
    ends: list[float] = []
    for task, action in _ACTIONS.items():
        options: dict[str, Any] = {'vehicle': vehicle}
        if task != 'Hills':
            options['servo'] = actuator
        name = f'barc_sim/{task}-v0'
        start = {'s': 0.0, 'v': 5.0}
        actions: NDArray[np.float64] = np.array(action)
        if cars:
            options['vectorization_mode'] = 'vector_entry_point'
            env: Any = gymnasium.make_vec(name, cars, **options)
            actions = np.tile(actions, (cars, 1))
        else:
            env = gymnasium.make(name, **options)
        env.reset(seed=1, options=start)
        for _ in range(_STEPS):
            observation = env.step(actions)[0]
        ends += np.atleast_2d(observation)[-1].tolist()
        env.close()
    return ends


def of_batch(vehicle: Vehicle, actuator: Actuator) -> list[float]:
    """Return what `of_environment` does, of the last of three cars in a batch."""
    return of_environment(vehicle, actuator, cars=3)


def of_identification(vehicle: Vehicle, actuator: Actuator) -> list[float]:
    """Return the predicted speed at the end of a drive."""
    t = np.arange(0.0, 4.0, 0.02)
    motor = HeldValues(t, np.where(t < 2.0, 2.0, -0.5))
    still = HeldValues(t, np.zeros(len(t)))
    stretch = Stretch(t, motor, still, np.zeros(len(t)), np.zeros((3, len(t))), True, ())
    ends = []
    for servo in (None, Actuator()):
        car = CarModel(vehicle, actuator, servo)
        ends.append(float(predict(stretch, car, 0.0)[0, -1]))
    return ends


def of_judge(vehicle: Vehicle, _: Actuator) -> list[float]:
    """Return the end of a drive by which the lane's lab judges; its car is the usual one."""
    del vehicle
    log = lane._drive(lambda _: LaneLQR(), Track.named('oval'), 60.0)  # noqa: SLF001 (no points hide it)
    return _end(log)


PARTS: dict[str, Callable[[Vehicle, Actuator], list[float]]] = {
    'node': of_node,
    'simulate': of_simulate,
    'sweep': of_sweep,
    'environment': of_environment,
    'batch': of_batch,
    'identification': of_identification,
    'judge': of_judge,
}


if __name__ == '__main__':
    friction, lag = map(float, sys.argv[1:])
    car = Vehicle(friction=friction), Actuator(lag=lag)
    json.dump({name: part(*car) for name, part in PARTS.items()}, sys.stdout)
