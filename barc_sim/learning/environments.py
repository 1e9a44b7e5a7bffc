"""The environments: one car, stepped by the plant of a run, and many in one compiled batch."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from math import cos, sin
from os import cpu_count
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
from barc_sim.interfaces.records import Command
from barc_sim.learning.batch import STARTS, columns_of, step_cars, world_of
from barc_sim.learning.tasks import BLOCK, TASKS, Seen, Task, command_of, is_over, reward
from barc_sim.vehicle.law import compiled, is_compiled
from barc_sim.vehicle.plant import error_of, in_steps, true_motion, with_error
from barc_sim.vehicle.track import project

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from barc_sim.interfaces.records import VehicleState
    from barc_sim.learning.rendering import Picture

    Floats = NDArray[np.float64]
    Cars = NDArray[np.intp]
    Options = Mapping[str, float] | None

_MIN_PIECE = 400  #: cars that a thread steps at least
_SIGNALS = 6  #: with noise


def _not_reset(method: str) -> ResetNeeded:
    """Return the error of a method that is called before an episode has begun."""
    return ResetNeeded(f'no episode has begun: call reset() before {method}()')


class CarEnv(gymnasium.Env[Any, Any]):
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
        self._pid = speed_controller(limit=self.task.limits.motor)
        self._command: Command | None = None  # None before the first episode

    def reset(self, *, seed: int | None = None, options: Options = None) -> tuple[Floats, Any]:
        """Begin an episode."""
        super().reset(seed=seed)
        task = self.task
        drawn = task.draw(self.np_random.random(len(task.draws)).tolist(), options)
        if task.ranges:
            self._plant = task.plant(drawn)
        self._plant.place(task.state(drawn), near=drawn['s'])
        self._pid.reset()
        self._command = Command()
        self._noise = task.noise(drawn['noise'])
        if self._picture:
            self._picture.begin()
        self._s = self._plant.distance
        found = self._observe(self._command), self._info()
        if self._is_shown:
            self.render()
        return found

    def step(self, action: Any) -> tuple[Floats, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """Take one step of the plant."""
        if self._command is None:
            raise _not_reset('step')
        task, rules, plant = self.task, self.task.rules, self._plant
        numbers = task.action(action)
        of_speed = 0.0
        if 'motor' not in task.actions:
            of_speed = self._pid.acc_calculate(rules.speed, self._speed, task.ts)
        command = command_of(rules, of_speed, numbers)
        plant.advance(command)
        self._command = command

        before = self._s
        observation = self._observe(command)
        info = self._info()
        s = info['s']
        self._s = s
        e_y = plant.now.frenet.e_y
        v = plant.now.state.v
        gained = reward(rules, s - before, e_y, v)
        over = is_over(rules, s, e_y, v)
        if self._is_shown:
            self.render()
        return observation, gained, over, False, info

    def _observe(self, command: Command) -> Floats:
        """Measure the present state; return the observation."""
        task, track = self.task, self.task.track
        now = self._plant.now
        place = now.frenet
        motion = true_motion(self._plant.model, now)
        if task.is_noisy:
            motion = self._measured(motion)
            if track:
                near, i = place.s, now.segment
                place, _ = project(track.line, motion.x, motion.y, motion.psi, near, i)
        speed = motion.v_x
        self._speed = speed
        error = task.rules.speed - speed
        seen = Seen(error, place.e_y, place.e_psi, speed, command.motor, command.servo)
        return task.observe(seen, task.ahead(place.s if track else motion.x))

    def _info(self) -> dict[str, Any]:
        """Return what is known of the car besides the observation."""
        plant = self._plant
        now = plant.now
        if not plant.track:
            return {'s': now.state.x}
        frenet, laps = now.frenet, now.laps
        return {
            's': frenet.s,
            'e_y': frenet.e_y,
            'lap': laps.lap,
            'lap_time': now.steps * self.task.ts - laps.began,
            'lap_times': plant.lap_times,
        }

    def _measured(self, true: VehicleState) -> VehicleState:
        """Return a motion with noise."""
        k = self._plant.steps % BLOCK
        if not k:
            self._normals = self.np_random.standard_normal((BLOCK, _SIGNALS)).tolist()
        error = error_of(self._noise, self._normals[k])
        return with_error(true, error, cos(true.psi), sin(true.psi))

    def render(self) -> Any:  # noqa: ANN401 (as Gymnasium's)
        """Return a picture of the present state, or show it in a window."""
        if not self.render_mode:
            return None
        if self._command is None:
            raise _not_reset('render')
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


class CarVectorEnv(VectorEnv[Any, Any, Any]):
    """Many cars in one batch, each as `CarEnv` steps it, to the last bit.

    Where Numba is installed the batch is compiled, and uses all cores. Car `i` has the random
    numbers of a `CarEnv` that was reset with `seed + i`. An episode ends beyond the limits, or
    after `max_episode_steps`; the next step resets its car and ignores the action. The numbers of
    `info` are arrays.
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
        self._world = world_of(self.task, speed_controller(limit=self.task.limits.motor))
        self._columns: Any = None  # None before the first episode
        self._threads: ThreadPoolExecutor | None = None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Options = None
    ) -> tuple[Floats, Any]:
        """Begin an episode with each car; `options` do not apply to later episodes.

        `seed` is that of the first car, or a list of all; a car with None keeps its generator.
        """
        n, task = self.num_envs, self.task
        self._seed(seed)
        self._columns = columns_of(task, n, max(task.ranges.get('delay', (0.0,))))
        self._lap_times = np.full(n, None)
        self._begin(np.arange(n), options)
        self._step_all()
        self._over = np.zeros(n, np.bool_)
        return self._columns.observations.copy(), self._info()

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
        columns = self._columns
        if columns is None:
            raise _not_reset('step')
        columns.actions[:] = self.task.action_rows(actions, self.num_envs)
        restarted = np.flatnonzero(self._over)
        if len(restarted):
            self._begin(restarted)
        self._step_all()
        terminated = columns.over.copy()
        truncated = columns.cars['steps'] >= self._max_steps
        if len(restarted):
            truncated[restarted] = False
        self._over = terminated | truncated
        return (
            columns.observations.copy(),
            columns.rewards.copy(),
            terminated,
            truncated,
            self._info(),
        )

    def _step_all(self) -> None:
        """Take a step with each car, or begin its new episode; measure all."""
        columns, n = self._columns, self.num_envs
        if self.task.is_noisy:
            cars = columns.cars
            begins_block = cars['is_new'] | ((cars['steps'] + 1) % BLOCK == 0)
            for car in np.flatnonzero(begins_block).tolist():
                self._generators[car].standard_normal(out=columns.normals[car])
        step = compiled(step_cars)
        pieces = min(n // _MIN_PIECE, cpu_count() or 1) if is_compiled() else 1
        if pieces <= 1:
            step(self._world, columns, 0, n)
        else:
            self._threads = self._threads or ThreadPoolExecutor(pieces - 1)
            edges = [n * k // pieces for k in range(pieces + 1)]
            others = [
                self._threads.submit(step, self._world, columns, first, last)
                for first, last in pairwise(edges[1:])
            ]
            step(self._world, columns, 0, edges[1])
            for other in others:
                other.result()
        if self.task.track:
            finished = columns.cars['finished']
            for car in np.flatnonzero(~np.isnan(finished)).tolist():
                self._lap_times[car] += (float(finished[car]),)
                finished[car] = np.nan

    def _info(self) -> dict[str, Any]:
        """Return what is known of the cars besides the observations."""
        cars = self._columns.cars
        if not self.task.track:
            return {'s': cars['x'].copy()}
        return {
            's': cars['s'].copy(),
            'e_y': cars['e_y'].copy(),
            'lap': cars['lap'].copy(),
            'lap_time': cars['steps'] * self.task.ts - cars['began'],
            'lap_times': self._lap_times.copy(),
        }

    def _begin(self, which: Cars, options: Options = None) -> None:
        """Begin an episode with each of these cars, in the next step."""
        task, cars = self.task, self._columns.cars
        count = len(task.draws)
        shares = np.array([self._generators[car].random(count) for car in which.tolist()])
        drawn = task.draw(shares.T, options)
        for name in task.ranges:
            if name != 'delay':
                cars[name][which] = drawn[name]
        if 'delay' in task.ranges:
            steps = np.array([in_steps(delay, task.ts) for delay in drawn['delay'].tolist()])
            for name in ('motor', 'servo') if task.delays_servo else ('motor',):
                cars[f'{name}_whole'][which] = steps[:, 0]
                cars[f'{name}_early'][which] = steps[:, 1]
        cars['noise'][which] = drawn['noise']
        for column, name in enumerate(STARTS):
            if name in drawn:
                self._columns.starts[which, column] = drawn[name]
        cars['is_new'][which] = True
        for car in which.tolist():
            self._lap_times[car] = ()

    def close_extras(self, **_: Any) -> None:  # noqa: ANN401 (as Gymnasium's)
        """End the threads."""
        if self._threads:
            self._threads.shutdown()

    def __getstate__(self) -> dict[str, Any]:
        """Leave the threads out of a copy, which starts its own."""
        return {**self.__dict__, '_threads': None}


def spaces(task: Task) -> tuple[Box, Box]:
    """Return the spaces of the observations and of the actions."""
    return Box(-task.high, task.high, dtype=np.float64), Box(-1.0, 1.0, (len(task.actions),))
