"""Gymnasium environments of the car: to hold a speed over hills, to keep the lane, to race.

An import of this package registers `barc_sim/Hills-v0`, `barc_sim/Lane-v0` and `barc_sim/Race-v0`.
So does its name before that of the environment, as Gymnasium 1 looks for no plug-ins::

    >>> import gymnasium
    >>> env = gymnasium.make('barc_sim.learning:barc_sim/Lane-v0', track='oval')
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

The tasks are in `learning/tasks.py`; `learning/environments.py` has one car, which the plant of a
run moves, and the batch of many that `gymnasium.make_vec` makes.
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
