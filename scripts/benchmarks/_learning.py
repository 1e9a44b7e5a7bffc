"""One measurement of an environment: its task is JSON on the command line, and so is its figure."""

from __future__ import annotations

import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

import barc_sim.learning  # noqa: F401 (registers)

if TYPE_CHECKING:
    from collections.abc import Callable

_ACTIONS = 16  #: between two looks at the clock


def main(task: dict[str, Any]) -> dict[str, float]:
    """Return how many steps of a car there are in a second.

    With `processes`, there is one for each core, and a second is of the wall's clock: a batch in
    each, or one car each in Gymnasium's AsyncVectorEnv. Else it is of processor time.
    """
    if not task.get('processes'):
        return {'steps/s': measure(task, time.process_time)}

    cores = os.cpu_count() or 1
    if task['cars'] == 1:
        one_each = {**task, 'cars': cores}
        return {'steps/s': measure(one_each, time.perf_counter, 'async')}

    batch = {**task, 'cars': max(task['cars'] // cores, 2)}
    with ProcessPoolExecutor(cores) as pool:
        rates = pool.map(measure, [batch] * cores, [time.perf_counter] * cores)
        return {'steps/s': sum(rates)}


def measure(
    task: dict[str, Any], clock: Callable[[], float], mode: str = 'vector_entry_point'
) -> float:
    """Return how many steps of a car there are in a second of a clock."""
    cars = task['cars']
    env = _environment(task, mode)
    env.reset(seed=0)
    random = np.random.default_rng(0)
    shape = env.action_space.shape
    actions = [random.uniform(-0.3, 0.3, shape).astype(np.float32) for _ in range(_ACTIONS)]

    for action in actions[:2]:  # to warm up
        env.step(action)
    env.reset(seed=0)

    steps = 0
    seconds = 0.0
    start = clock()
    while seconds < task['seconds']:
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            steps += cars
            if cars == 1 and (terminated or truncated):
                env.reset()
        seconds = clock() - start
    return float(steps / seconds)


def _environment(task: dict[str, Any], mode: str) -> Any:  # noqa: ANN401 (any environment)
    name = task['name']
    options = task['options']
    if not name.startswith('barc_sim/'):
        import highway_env  # noqa: F401, PLC0415 (registers)
    if task['cars'] == 1:
        return gymnasium.make(name, **options)
    return gymnasium.make_vec(name, task['cars'], vectorization_mode=mode, **options)


if __name__ == '__main__':
    print(json.dumps(main(json.loads(sys.argv[1]))))
