"""One measurement of an environment: its task is JSON on the command line, so is its figure."""

from __future__ import annotations

import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import gymnasium
import numpy as np

import barc_sim.learning  # noqa: F401 (registers)


def main(task: dict[str, Any]) -> dict[str, float]:
    """Return how many steps of a car there are in a second of processor time.

    Of `processes`, one for each core: in a second of the wall's clock, a batch in each, or one car
    each in Gymnasium's AsyncVectorEnv.
    """
    if not task.get('processes'):
        return {'steps/s': measure(task, time.process_time)}
    cores = os.cpu_count() or 1
    if task['cars'] == 1:
        return {'steps/s': measure({**task, 'cars': cores}, time.perf_counter, 'async')}
    part = {**task, 'cars': max(task['cars'] // cores, 2)}
    with ProcessPoolExecutor(cores) as pool:
        return {'steps/s': sum(pool.map(measure, [part] * cores, [time.perf_counter] * cores))}


def measure(task: dict[str, Any], clock: Any, mode: str = 'vector_entry_point') -> float:  # noqa: ANN401
    """Return how many steps of a car there are in a second of a clock."""
    name = task['name']
    cars = task['cars']
    options = task['options']
    if not name.startswith('barc_sim/'):
        import highway_env  # noqa: F401, PLC0415 (registers)
    if cars == 1:
        env = gymnasium.make(name, **options)
    else:
        env = gymnasium.make_vec(name, cars, vectorization_mode=mode, **options)
    env.reset(seed=0)
    random = np.random.default_rng(0)
    shape = env.action_space.shape
    actions = [random.uniform(-0.3, 0.3, shape).astype(np.float32) for _ in range(16)]
    for action in actions[:2]:  # to warm up
        env.step(action)
    env.reset(seed=0)
    steps = 0
    began = clock()
    while (took := clock() - began) < task['seconds']:
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            steps += cars
            if cars == 1 and (terminated or truncated):
                env.reset()
    return float(steps / took)


if __name__ == '__main__':
    print(json.dumps(main(json.loads(sys.argv[1]))))
