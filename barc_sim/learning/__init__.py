"""Gymnasium environments of the car: to hold a speed over hills, to keep the lane, to race.

An import of this package registers `barc_sim/Hills-v0`, `barc_sim/Lane-v0` and `barc_sim/Race-v0`.
Its name before an environment's does the same, because Gymnasium 1 loads no plug-ins by itself::

    >>> import gymnasium
    >>> env = gymnasium.make('barc_sim.learning:barc_sim/Lane-v0', track='oval')
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

The tasks are in `learning/tasks.py`; `learning/environments.py` has the environment with one car,
stepped by the plant of a run, and the batch of many cars for `gymnasium.make_vec`.
"""

from __future__ import annotations

from importlib.util import find_spec

if find_spec('gymnasium'):
    import gymnasium

    for _task in ('Hills', 'Lane', 'Race'):
        gymnasium.register(
            f'barc_sim/{_task}-v0',
            entry_point='barc_sim.learning.environments:CarEnv',
            vector_entry_point='barc_sim.learning.environments:CarVectorEnv',
            max_episode_steps=3000,
            disable_env_checker=True,  # of each step; the tests run it whole
            kwargs={'task': _task},
        )
