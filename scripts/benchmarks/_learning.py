"""One measurement of an environment: its task is JSON on the command line, so is its figure."""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import gymnasium
import numpy as np

import barc_sim.learning  # noqa: F401 (registers)


def main(task: dict[str, Any]) -> dict[str, float]:
    """Return how many steps of a car there are in a second of processor time."""
    name, cars, options = task['name'], task['cars'], task['options']
    if not name.startswith('barc_sim/'):
        import highway_env  # noqa: F401, PLC0415 (registers)
    if cars == 1:
        env = gymnasium.make(name, **options)
    else:
        mode = 'vector_entry_point'
        env = gymnasium.make_vec(name, cars, vectorization_mode=mode, **options)
    env.reset(seed=0)
    random = np.random.default_rng(0)
    shape = env.action_space.shape
    actions = [random.uniform(-0.3, 0.3, shape).astype(np.float32) for _ in range(16)]
    for action in actions[:2]:  # to warm up
        env.step(action)
    env.reset(seed=0)
    steps, began = 0, time.process_time()
    while (took := time.process_time() - began) < task['seconds']:
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            steps += cars
            if cars == 1 and (terminated or truncated):
                env.reset()
    return {'steps/s': steps / took}


if __name__ == '__main__':
    print(json.dumps(main(json.loads(sys.argv[1]))))
