"""The environments: one car, stepped by the plant of a run, and many in one NumPy batch."""

from __future__ import annotations

from math import cos, sin
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from barc_sim.control.speed import speed_controller
from barc_sim.errors import UserError
from barc_sim.learning.tasks import BLOCK, TASKS, Task
from barc_sim.simulation.fast import PIDs, Plants
from barc_sim.vehicle.bike_model import Command
from barc_sim.vehicle.plant import MeasurementError, with_error

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from barc_sim.learning.rendering import Picture
    from barc_sim.vehicle.bike_model import Motion

    Floats = NDArray[np.float64]
    Cars = NDArray[np.intp]
    Options = Mapping[str, float] | None


class _Drive:
    """Base of one car and of a batch: a number of the first is an array in the second.

    `_plant` is a `Plant` or `Plants`, which have the same names.
    """

    task: Task
    _plant: Any
    _pid: Any
    _begin: Callable[[Any], None]
    _measured: Callable[[Motion], Motion]  #: a motion, with noise
    _command: Any = None  #: a Command; None before the first episode

    def _check_reset(self, method: str) -> None:
        """Raise ResetNeeded if no episode has begun."""
        if self._command is None:
            raise ResetNeeded(f'no episode has begun: call reset() before {method}()')

    def _go(self, motor: Any, servo: Any, over: Cars | tuple[()] = ()) -> tuple[Any, ...]:  # noqa: ANN401
        """Take a step; return the observation, the reward, whether the episode ended, and `info`.

        `motor` is None if the PID drives; the cars in `over` begin a new episode.
        """
        task, plant, before = self.task, self._plant, self._s
        if motor is None:
            motor = self._pid.acc_calculate(task.speed, self._speed, task.ts)
        self._command = Command(motor, servo)
        plant.advance(self._command)
        if len(over):
            self._begin(over)
        observation, info = self._observe()
        s, e_y, v = self._s, info.get('e_y', 0.0), plant.state.v
        return observation, task.reward(s - before, e_y, v), task.is_over(s, e_y, v), info

    def _observe(self) -> tuple[Any, dict[str, Any]]:
        """Return the observation, and `info`."""
        task, plant, track = self.task, self._plant, self.task.track
        s, e_y, e_psi, _ = plant.frenet or (plant.state.x, 0.0, 0.0, 0.0)
        info, motion, self._s = {'s': s}, plant.motion(), s
        if track:
            info = {
                's': s,
                'e_y': e_y,
                'lap': plant.lap,
                'lap_time': plant.lap_time,
                'lap_times': plant.lap_times,
            }
        if task.is_noisy:
            motion = self._measured(motion)
            x, y, psi, *_ = motion
            s, e_y, e_psi, _ = track.frenet(x, y, psi, s) if track else (x, 0.0, 0.0, 0.0)
        self._speed = speed = motion.v_x
        seen = task.speed - speed, e_y, e_psi, speed, *self._command
        return task.observe(seen, task.ahead(s)), info


class CarEnv(_Drive, gymnasium.Env[Any, Any]):
    """One car: the plant of the runs, to the last bit.

    The classes of `learning.tasks`, by the environment's name, describe observation, action and
    reward. `info` has s [m] and, on a track, e_y [m], the number of the lap, the time since it
    began [s], and the times of the finished laps; a lap ends no episode. The options of `reset` are
    the start of the car: `{'s': 0.0, 'e_y': 0.0, 'e_psi': 0.0, 'v': 0.0}`, or some of these. All
    random numbers, noise too, come from `np_random`.

    `render` returns the picture of a replay, of shape (360, 640, 3), or shows it in a window.
    """

    metadata: dict[str, Any] = {'render_modes': ['human', 'rgb_array'], 'render_fps': 50}  # noqa: RUF012

    def __init__(self, task: str, render_mode: str | None = None, **options: Any) -> None:  # noqa: ANN401
        """Take the name of a task, and its options."""
        self.task = TASKS[task](**options)
        self.observation_space, self.action_space = spaces(self.task)
        self.render_mode, self._is_shown = render_mode, render_mode == 'human'
        self.metadata = self.metadata | {'render_fps': round(1.0 / self.task.ts)}
        self._picture: Picture | None = None
        self._plant = self.task.plain
        self._pid = speed_controller(limit=self.task.limits['motor'])

    def reset(self, *, seed: int | None = None, options: Options = None) -> tuple[Floats, Any]:
        """Begin an episode."""
        super().reset(seed=seed)
        task = self.task
        drawn = task.draw(self.np_random.random(len(task.draws)).tolist(), options)
        if task.ranges:
            self._plant = task.plant(drawn)
        self._plant.place(task.state(drawn), near=drawn['s'])
        self._pid.reset()
        self._command, self._noise = Command(), drawn['noise']
        if self._picture:
            self._picture.begin()
        found = self._observe()
        if self._is_shown:
            self.render()
        return found

    def step(self, action: Any) -> tuple[Floats, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """Take one step of the plant."""
        self._check_reset('step')
        observation, reward, is_over, info = self._go(*self.task.command(action))
        if self._is_shown:
            self.render()
        return observation, reward, is_over, False, info

    def _measured(self, true: Motion) -> Motion:
        k = self._plant.steps % BLOCK
        if not k:
            self._errors = self.task.errors(self.np_random, self._noise).tolist()
        return with_error(true, MeasurementError(*self._errors[k]), cos(true.psi), sin(true.psi))

    def render(self) -> Any:  # noqa: ANN401 (as Gymnasium's)
        """Return a picture of the present state, or show it in a window."""
        if not self.render_mode:
            return None
        self._check_reset('render')
        if not self._picture:
            from barc_sim.learning.rendering import Picture  # noqa: PLC0415 (slow)

            self._picture = Picture(self.task, in_window=self._is_shown)
        return self._picture.draw(self._plant, self._command)

    def close(self) -> None:
        """Close the window."""
        if self._picture:
            self._picture.close()

    def __getstate__(self) -> dict[str, Any]:
        """Leave the picture out of a copy, which draws its own."""
        return {**self.__dict__, '_picture': None}


class CarVectorEnv(_Drive, VectorEnv[Any, Any, Any]):
    """Many cars in one batch of NumPy arrays, each as `CarEnv` steps it, to 1e-12.

    Car `i` has the random numbers of a `CarEnv` that was reset with `seed + i`. An episode ends
    beyond the limits, or after `max_episode_steps`; the next step resets its car and ignores the
    action. The numbers of `info` are arrays.
    """

    metadata: ClassVar[dict[str, Any]] = {
        'render_modes': [],
        'autoreset_mode': AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        task: str,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        **options: Any,  # noqa: ANN401 (of the task)
    ) -> None:
        """Take the name of a task, its options, and the number of cars."""
        self.task, self.num_envs = TASKS[task](**options), num_envs
        self.single_observation_space, self.single_action_space = spaces(self.task)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._max_steps = max_episode_steps or np.inf
        self._generators: list[np.random.Generator] = []

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Options = None
    ) -> tuple[Floats, Any]:
        """Begin an episode with each car; `options` do not apply to later episodes.

        `seed` is that of the first car, or a list of all; a car with None keeps its generator.
        """
        n, task = self.num_envs, self.task
        self._seed(seed)
        self._plant = Plants(n, task.plain, max(task.ranges.get('delay', (0.0,))))
        self._pid = PIDs(n, speed_controller(limit=task.limits['motor']))
        self._command = Command(*np.zeros((2, n)))
        self._noise, self._over = np.zeros(n), np.zeros(n, np.bool_)
        self._errors = np.zeros((n, BLOCK, 6))
        self._begin(np.arange(n), options)
        return self._observe()

    def _seed(self, seed: int | Sequence[int | None] | None) -> None:
        """Give each car a generator of its own, as Gymnasium's vector environments do."""
        n = self.num_envs
        if seed is None:
            seeds: Sequence[int | None] = [None] * n
        elif isinstance(seed, (int, np.integer)):
            seeds = [int(seed) + i for i in range(n)]
        else:
            seeds = seed
        if len(seeds) != n:
            raise UserError(f'seed: {seeds!r} must be one number, or one for each of {n} cars')
        if not self._generators:
            # Cars without a seed take consecutive ones, from a seed that is drawn.
            _, first = np_random()
            self._generators = [np_random(first + i)[0] for i in range(n)]
        for i, each in enumerate(seeds):
            if each is not None:
                self._generators[i], _ = np_random(each)

    def step(self, actions: Any) -> tuple[Floats, Floats, Any, Any, dict[str, Any]]:  # noqa: ANN401
        """Take a step with each car; a car whose episode has ended begins a new one instead."""
        self._check_reset('step')
        motor, servo = self.task.command(actions, self.num_envs)
        restarted = np.flatnonzero(self._over)
        observation, rewards, terminated, info = self._go(motor, servo, restarted)
        truncated = self._plant.steps >= self._max_steps
        rewards[restarted] = 0.0
        terminated[restarted] = truncated[restarted] = False
        self._over = terminated | truncated
        return observation, rewards, terminated, truncated, info

    def _measured(self, true: Motion) -> Motion:
        k = self._plant.steps % BLOCK
        for car in np.flatnonzero(k == 0).tolist():
            self._errors[car] = self.task.errors(self._generators[car], self._noise[car])
        error = MeasurementError(*self._errors[np.arange(self.num_envs), k].T)
        return with_error(true, error, np.cos(true.psi), np.sin(true.psi))

    def _observe(self) -> tuple[Any, dict[str, Any]]:
        observation, info = super()._observe()
        return observation, {name: each.copy() for name, each in info.items()}

    def _begin(self, cars: Cars, options: Options = None) -> None:
        """Begin an episode with each of these cars."""
        task, plants, count = self.task, self._plant, len(self.task.draws)
        shares = np.array([self._generators[car].random(count) for car in cars.tolist()]).T
        drawn = task.draw(shares, options)
        plants.vary(cars, drawn)
        if 'delay' in drawn:
            plants.motor.delay(cars, drawn['delay'])
            if task.delays_servo:
                plants.servo.delay(cars, drawn['delay'])
        plants.place(cars, task.state(drawn), drawn)
        self._pid.reset(cars)
        self._noise[cars] = drawn['noise']
        for column in self._command:
            column[cars] = 0.0


def spaces(task: Task) -> tuple[Box, Box]:
    """Return the spaces of the observations and of the actions."""
    return Box(-task.high, task.high, dtype=np.float64), Box(-1.0, 1.0, (len(task.actions),))
