"""The environments: one car, stepped by the plant of a run, and many in one compiled batch."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
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
from barc_sim.learning.batch import (
    NOISE_BLOCK,
    BatchColumns,
    batch_columns_of,
    batch_model_of,
    step_cars,
)
from barc_sim.learning.options import with_plain_scenario
from barc_sim.learning.tasks import (
    STARTS,
    TASKS,
    CarSignals,
    DrivingTask,
    command_of,
    is_over,
    reward,
)
from barc_sim.vehicle.law import compiled_for, is_compiled
from barc_sim.vehicle.plant import in_steps, true_motion
from barc_sim.vehicle.track import project

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from gymnasium.envs.registration import EnvSpec
    from numpy.typing import NDArray

    from barc_sim.learning.rendering import Picture

    Floats = NDArray[np.float64]
    Cars = NDArray[np.intp]
    Options = Mapping[str, float] | None
    Seeds = int | Sequence[int | None] | None

_MIN_PIECE = 400  #: cars that a thread steps at least
_EPISODES = 8  #: of each car whose random values are drawn at once
_TOGETHER = 16  #: cars whose noise is drawn before it is stored, in a processor's nearest cache


def _not_reset(method: str) -> ResetNeeded:
    """Return the error of a method that is called before an episode has begun."""
    return ResetNeeded(f'no episode has begun: call reset() before {method}()')


def _episode_generator(noise: np.random.Generator) -> np.random.Generator:
    """Return the generator of the episodes of a car, beside that of its noise.

    The noise of a seed is that of a run's `Sensor` with this seed. What the episodes draw does not
    change it.
    """
    (generator,) = noise.spawn(1)
    return generator


class _PlainSpec:
    """The `spec` of an environment, with a scenario as values that JSON can carry."""

    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """What Gymnasium made the environment from."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = with_plain_scenario(spec)


class CarEnv(_PlainSpec, gymnasium.Env[Any, Any]):
    """One car: the plant of the runs, to the last bit.

    The classes of `learning.tasks`, by the environment's name, describe observation, action and
    reward. `info` has s [m] and, on a track, e_y [m], the number of the lap, the time since it
    began [s], and the times of the finished laps; a lap ends no episode. The options of `reset` are
    the start of the car: `{'s': 0.0, 'e_y': 0.0, 'e_psi': 0.0, 'v': 0.0}`, or some of these.

    A seed gives two generators. `np_random` draws the noise, six normal numbers for each
    measurement, through all episodes: as `simulate(..., seed=seed)` does. A child that `np_random`
    spawns draws the start of each episode and the values of `ranges`.

    `render` returns the picture of a replay, of shape (360, 640, 3), or shows it in a window.

    Parameters
    ----------
    task
        The name of a class of `learning.tasks`: 'Hills', 'Lane' or 'Race'.
    render_mode
        None, 'rgb_array' or 'human'.
    options
        The arguments of `learning.tasks.DrivingTask`.

    Raises
    ------
    UserError
        if an option is unknown or out of its limits.
    """

    metadata: dict[str, Any] = {'render_modes': ['human', 'rgb_array'], 'render_fps': 50}  # noqa: RUF012

    def __init__(self, task: str, render_mode: str | None = None, **options: Any) -> None:  # noqa: ANN401
        """Take the name of a task, and its options."""
        self.task = TASKS[task](**options)
        self.observation_space, self.action_space = spaces(self.task)
        self.metadata = self.metadata | {'render_fps': round(1.0 / self.task.ts)}
        self.render_mode = render_mode
        self._is_shown = render_mode == 'human'
        self._picture: Picture | None = None

        self._plant = self.task.plain
        self._sensor = self._plant.sensor
        self._pid = speed_controller(limit=self.task.limits.motor)
        self._command: Command | None = None  # None before the first episode
        self._noise_generator: np.random.Generator | None = None

    def reset(self, *, seed: int | None = None, options: Options = None) -> tuple[Floats, Any]:
        """Begin an episode.

        Parameters
        ----------
        seed
            Starts the random numbers anew; None continues them.
        options
            A start that is not drawn, by name.

        Returns
        -------
        The observation, shape (numbers,), and `info`.

        Raises
        ------
        UserError
            if an option is unknown, or out of its limits.
        """
        super().reset(seed=seed)
        if self._noise_generator is not self.np_random:
            self._noise_generator = self.np_random
            self._episode_generator = _episode_generator(self.np_random)
            self._sensor.draw_from(self.np_random)

        task = self.task
        shares = self._episode_generator.random(len(task.draws))
        values = task.draw(shares, options).tolist()
        draws = dict(zip(task.draws, values, strict=True))

        if task.ranges:
            self._plant = task.plant(draws)
            self._plant.sensor = self._sensor
        self._sensor.noise = task.noise(draws['noise'])
        self._plant.place(task.state(draws), near=draws['s'])

        self._pid.reset()
        self._command = Command()
        self._s = self._plant.distance
        observation = self._observe(self._command)
        info = self._info()

        if self._picture:
            self._picture.begin()
        if self._is_shown:
            self.render()
        return observation, info

    def step(self, action: Any) -> tuple[Floats, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """Take one step of the plant.

        Parameters
        ----------
        action
            Numbers from -1 to 1, as the task describes them; others count as the nearest of these.

        Returns
        -------
        The observation, the reward, whether the car is beyond its limits, False, and `info`.

        Raises
        ------
        UserError
            if it is not an action.
        """
        if self._command is None:
            raise _not_reset('step')

        task = self.task
        rules = task.rules
        plant = self._plant
        numbers = task.action(action)

        speed_command = 0.0
        if 'motor' not in task.actions:
            speed_command = self._pid.acc_calculate(rules.speed, self._speed, task.ts)
        command = command_of(rules, speed_command, numbers)
        plant.advance(command)
        self._command = command

        observation = self._observe(command)
        info = self._info()
        s = info['s']
        way = s - self._s
        self._s = s
        e_y = plant.now.frenet.e_y
        v = plant.now.state.v
        step_reward = reward(rules, way, e_y, v)
        terminated = is_over(rules, s, e_y, v)

        if self._is_shown:
            self.render()
        return observation, step_reward, terminated, False, info

    def _observe(self, command: Command) -> Floats:
        """Measure the present state; return the observation."""
        task = self.task
        plant = self._plant
        now = plant.now
        place = now.frenet
        motion = true_motion(plant.model, now)
        if not task.is_exact:
            motion, _ = self._sensor.measure(motion)
            if task.track:
                line = task.track.line
                place, _ = project(line, motion.x, motion.y, motion.psi, place.s, now.segment)

        speed = motion.v_x
        self._speed = speed
        error = task.rules.speed - speed
        signals = CarSignals(error, place.e_y, place.e_psi, speed, command.motor, command.servo)
        return task.observe(signals, task.ahead(place.s if task.track else motion.x))

    def _info(self) -> dict[str, Any]:
        """Return what is known of the car besides the observation."""
        plant = self._plant
        now = plant.now
        if not plant.track:
            return {'s': now.state.x}

        frenet = now.frenet
        laps = now.laps
        return {
            's': frenet.s,
            'e_y': frenet.e_y,
            'lap': laps.lap,
            'lap_time': now.steps * self.task.ts - laps.began,
            'lap_times': plant.lap_times,
        }

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


class CarVectorEnv(_PlainSpec, VectorEnv[Any, Any, Any]):
    """Many cars in one batch, each as `CarEnv` steps it, to the last bit.

    Where Numba is installed the batch is compiled, and uses all cores. Car `i` has the random
    numbers of a `CarEnv` that was reset with `seed + i`. An episode ends beyond the limits, or
    after `max_episode_steps`; the next step resets its car and ignores the action. The numbers of
    `info` are arrays.

    Parameters
    ----------
    task
        The name of a class of `learning.tasks`: 'Hills', 'Lane' or 'Race'.
    num_envs
        The number of cars.
    max_episode_steps
        Steps after which an episode is truncated; None: none is.
    options
        The arguments of `learning.tasks.DrivingTask`.

    Raises
    ------
    UserError
        if an option is unknown or out of its limits.
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
        self.task = TASKS[task](**options)
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces(self.task)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._max_steps = max_episode_steps or np.inf

        self._noise_generators: list[np.random.Generator] = []
        self._episode_generators: list[np.random.Generator] = []
        #: The random values of the next episodes, from 0 to 1.
        self._shares = np.zeros((num_envs, _EPISODES, len(self.task.draws)))
        self._used_shares = np.full(num_envs, _EPISODES)  # the number of these episodes that began

        pid = speed_controller(limit=self.task.limits.motor)
        self._model = batch_model_of(self.task, pid)
        self._columns: BatchColumns | None = None  # None before the first episode
        self._noise_row = 0  # of the next measurement

        pieces = 1
        if is_compiled():
            pieces = max(min(num_envs // _MIN_PIECE, cpu_count() or 1), 1)
        self._edges = [num_envs * piece // pieces for piece in range(pieces + 1)]
        self._loop: Callable[..., int] | None = None  # None before the first step
        self._threads: ThreadPoolExecutor | None = None

    def reset(self, *, seed: Seeds = None, options: Options = None) -> tuple[Floats, Any]:
        """Begin an episode with each car.

        Parameters
        ----------
        seed
            That of the first car, or a list of all; a car with None continues its random numbers.
        options
            Starts that are not drawn, by name; not for later episodes.

        Returns
        -------
        The observations, shape (cars, numbers), and `info`.

        Raises
        ------
        UserError
            if an option is unknown or out of its limits, or there is not a seed for each car.
        """
        n = self.num_envs
        before = self._columns
        self._columns = batch_columns_of(self.task, n)
        continued = self._seed(self._seeds(seed))
        if self.task.is_noisy:
            self._continue_noise(before, continued)

        self._lap_times = np.full(n, None)
        self._begin(np.arange(n), options)
        self._step_all()
        self._over = np.zeros(n, np.bool_)
        return self._columns.observations, self._info()

    def _seeds(self, seed: Seeds) -> Sequence[int | None]:
        """Return a seed for each car, or None."""
        n = self.num_envs
        if seed is None:
            return [None] * n
        if isinstance(seed, (int, np.integer)):
            return [int(seed) + i for i in range(n)]
        if len(seed) != n:
            raise UserError(f'seed: {seed!r} must be one number, or one for each of {n} cars')
        return seed

    def _seed(self, seeds: Sequence[int | None]) -> list[bool]:
        """Give each car generators of its own; return whether it continues with those it had.

        Cars without a seed take consecutive ones at first, from a seed that is drawn, as in
        Gymnasium's vector environments.
        """
        n = self.num_envs
        continued = [seed is None for seed in seeds]

        if not self._noise_generators:
            _, first = np_random()
            seeds = [first + i if seed is None else seed for i, seed in enumerate(seeds)]
            continued = [False] * n
            self._noise_generators = [np.random.default_rng(0)] * n
            self._episode_generators = [np.random.default_rng(0)] * n

        for i, seed in enumerate(seeds):
            if seed is not None:
                generator, _ = np_random(seed)
                self._noise_generators[i] = generator
                self._episode_generators[i] = _episode_generator(generator)
                self._used_shares[i] = _EPISODES
        return continued

    def _continue_noise(self, before: BatchColumns | None, continued: list[bool]) -> None:
        """Draw the noise of the first measurements; a car that continues has some left."""
        assert self._columns is not None  # noqa: S101 (`reset` has set it)
        normals = self._columns.normals
        left = 0
        if before is not None:
            left = NOISE_BLOCK - self._noise_row
            normals[:left] = before.normals[self._noise_row :]

        for car, is_continued in enumerate(continued):
            first = left if is_continued else 0
            count = NOISE_BLOCK - first
            generator = self._noise_generators[car]
            normals[first:, car] = generator.standard_normal((count, normals.shape[2]))

        self._noise_row = 0

    def _draw_noise(self, normals: Floats) -> None:
        """Draw the noise of the next measurements of all cars."""
        block = np.empty((_TOGETHER, NOISE_BLOCK, normals.shape[2]))
        for first in range(0, self.num_envs, _TOGETHER):
            generators = self._noise_generators[first : first + _TOGETHER]
            for generator, of_car in zip(generators, block, strict=False):
                generator.standard_normal(out=of_car)

            of_cars = block[: len(generators)]
            normals[:, first : first + _TOGETHER] = of_cars.transpose(1, 0, 2)
        self._noise_row = 0

    def step(self, actions: Any) -> tuple[Floats, Floats, Any, Any, dict[str, Any]]:  # noqa: ANN401
        """Take a step with each car; a car whose episode has ended begins a new one instead.

        Parameters
        ----------
        actions
            Numbers from -1 to 1, shape (cars, numbers); others count as the nearest of these.

        Returns
        -------
        The observations, the rewards, whether each car is beyond its limits, whether its episode is
        truncated, and `info`.

        Raises
        ------
        UserError
            if they are not an action of each car.
        """
        if self._columns is None:
            raise _not_reset('step')

        # The caller keeps the arrays of the step before.
        columns = self._columns._replace(
            actions=self.task.action_rows(actions, self.num_envs),
            observations=np.empty_like(self._columns.observations),
            rewards=np.empty(self.num_envs),
            over=np.empty(self.num_envs, np.bool_),
        )
        self._columns = columns

        restarted = np.flatnonzero(self._over)
        if len(restarted):
            self._begin(restarted)
        self._step_all()

        truncated = columns.cars['steps'] >= self._max_steps
        self._over = columns.over | truncated
        return columns.observations, columns.rewards, columns.over, truncated, self._info()

    def _step_all(self) -> None:
        """Take a step with each car, or begin its new episode; measure all."""
        columns = self._columns
        assert columns is not None  # noqa: S101 (`step` has checked it)
        if self.task.is_noisy and self._noise_row == NOISE_BLOCK:
            self._draw_noise(columns.normals)
        if self.task.plain.disturbance and 'disturbance' not in self.task.ranges:
            self._set_forces(columns.cars)

        laps = self._run_loop(columns)
        if self.task.is_noisy:
            self._noise_row += 1
        if laps:
            self._note_laps(columns.cars['finished'])

    def _run_loop(self, columns: BatchColumns) -> int:
        """Step the cars on all cores; return how many laps they have finished."""
        model = self._model
        row = self._noise_row
        edges = self._edges
        step = self._loop
        if step is None:
            step = compiled_for(step_cars, model, columns, row, 0, 0)
            self._loop = step

        if len(edges) == 2:  # noqa: PLR2004 (first and last)
            return step(model, columns, row, 0, self.num_envs)

        if self._threads is None:
            self._threads = ThreadPoolExecutor(len(edges) - 2)
        futures = [
            self._threads.submit(step, model, columns, row, first, last)
            for first, last in pairwise(edges[1:])
        ]
        laps = step(model, columns, row, 0, edges[1])
        return laps + sum(future.result() for future in futures)

    def _set_forces(self, cars: Any) -> None:  # noqa: ANN401 (an array of records)
        """Set the force on each car, from a disturbance that changes over time or place."""
        disturbance = self.task.plain.disturbance
        assert disturbance is not None  # noqa: S101 (`_step_all` has checked it)
        along = cars['s'] if self.task.track else cars['x']
        times = cars['steps'] * self.task.ts
        pairs = zip(times.tolist(), along.tolist(), strict=True)
        cars['force'] = [disturbance(t, s) for t, s in pairs]

    def _note_laps(self, finished: Floats) -> None:
        """Add the laps that were finished in this step, by their times [s], to those before."""
        for car in np.flatnonzero(~np.isnan(finished)).tolist():
            self._lap_times[car] += (float(finished[car]),)
            finished[car] = np.nan

    def _info(self) -> dict[str, Any]:
        """Return what is known of the cars besides the observations."""
        assert self._columns is not None  # noqa: S101 (`reset` has set it)
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

    def _begin(self, cars: Cars, options: Options = None) -> None:
        """Begin an episode with each of these cars, in the next step."""
        assert self._columns is not None  # noqa: S101 (`reset` has set it)
        values = self.task.draw(self._next_shares(cars), options)
        self._columns.starts[cars] = values[:, : len(STARTS)]

        records = self._columns.cars
        records['noise'][cars] = values[:, len(STARTS)]
        records['is_new'][cars] = True
        if self.task.ranges:
            self._vary(cars, dict(zip(self.task.draws, values.T, strict=True)))

        for car in cars.tolist():
            self._lap_times[car] = ()

    def _next_shares(self, cars: Cars) -> Floats:
        """Return the random values of a new episode of these cars, from 0 to 1."""
        episodes = self._used_shares[cars]
        is_used_up = episodes == _EPISODES
        if is_used_up.any():
            for car in cars[is_used_up].tolist():
                self._episode_generators[car].random(out=self._shares[car])
            episodes[is_used_up] = 0

        self._used_shares[cars] = episodes + 1
        shares: Floats = self._shares[cars, episodes]
        return shares

    def _vary(self, cars: Cars, draws: Mapping[str, Floats]) -> None:
        """Give these cars the values of `ranges` that were drawn."""
        assert self._columns is not None  # noqa: S101 (`reset` has set it)
        records = self._columns.cars

        for name in self.task.ranges:
            if name == 'delay':
                self._set_delays(cars, draws['delay'])
            elif name == 'disturbance':
                records['force'][cars] = draws['disturbance']
            else:
                records[name][cars] = draws[name]

    def _set_delays(self, cars: Cars, delays: Floats) -> None:
        """Delay the commands to these cars, by [s]; also to the servo unless it was given."""
        assert self._columns is not None  # noqa: S101 (`reset` has set it)
        records = self._columns.cars
        steps = np.array([in_steps(delay, self.task.ts) for delay in delays.tolist()])
        names = ['motor', 'servo'] if self.task.scenario.servo is None else ['motor']
        for name in names:
            records[f'{name}_whole'][cars] = steps[:, 0]
            records[f'{name}_early'][cars] = steps[:, 1]

    def close_extras(self, **_: Any) -> None:  # noqa: ANN401 (as Gymnasium's)
        """End the threads."""
        if self._threads:
            self._threads.shutdown()

    def __getstate__(self) -> dict[str, Any]:
        """Leave threads and compiled code out of a copy, which has its own."""
        return {**self.__dict__, '_threads': None, '_loop': None}


def spaces(task: DrivingTask) -> tuple[Box, Box]:
    """Return the spaces of the observations and of the actions."""
    observations = Box(-task.high, task.high, dtype=np.float64)
    return observations, Box(-1.0, 1.0, (len(task.actions),))
