"""The environments: one car, stepped by the plant of a run, and many in one NumPy batch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from barc_sim.control.speed import speed_controller
from barc_sim.errors import UserError
from barc_sim.learning.tasks import TASKS, Task
from barc_sim.simulation.fast import PIDs
from barc_sim.vehicle.bike_model import Command, State

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from barc_sim.learning.rendering import Picture

    Floats = NDArray[np.float64]
    Options = Mapping[str, Any] | None

#: Random numbers of an episode before those of its `ranges`: the start, and the noise's seed.
_DRAWS = 5


def spaces(task: Task) -> tuple[Box, Box]:
    """Return the spaces of the observations and of the actions."""
    return Box(-task.high, task.high, dtype=np.float64), Box(-1.0, 1.0, (len(task.actions),))


class CarEnv(gymnasium.Env[Any, Any]):
    """One car: the plant of the runs, to the last bit.

    What is observed, commanded and rewarded is in `learning.tasks`, by the environment's name.
    `info` has s [m] and, on a track, e_y [m], the number of the lap, the time since it began [s],
    and the times of the laps so far; a lap ends no episode. `reset` takes where the car starts as
    options: `{'s': 0.0, 'e_y': 0.0, 'e_psi': 0.0, 'v': 0.0}`, or some of these.

    `render` returns the picture of a replay, of shape (360, 640, 3), or shows it in a window.
    """

    metadata: dict[str, Any] = {'render_modes': ['human', 'rgb_array'], 'render_fps': 50}  # noqa: RUF012

    def __init__(self, task: str, render_mode: str | None = None, **options: Any) -> None:  # noqa: ANN401
        """Take the name of a task, and its options."""
        self.task = TASKS[task](**options)
        self.observation_space, self.action_space = spaces(self.task)
        self.render_mode, self._is_shown = render_mode, render_mode == 'human'
        self._picture: Picture | None = None
        self._plant: Any = None  # a Plant, from the first reset on
        self.metadata = self.metadata | {'render_fps': round(1.0 / self.task.ts)}
        self._pid = speed_controller(limit=self.task.limits['motor'])

    def reset(self, *, seed: int | None = None, options: Options = None) -> tuple[Floats, Any]:
        """Begin an episode."""
        super().reset(seed=seed)
        task = self.task
        shares = self.np_random.random(_DRAWS + len(task.ranges)).tolist()
        start = {name: float(x) for name, x in task.start(shares[:4], options).items()}
        if not self._plant or task.varies:
            self._plant = task.plant(task.draw(shares[_DRAWS:]), int(shares[4] * 2.0**53))
        self._plant.place(State(*task.pose(start), start['v']), near=start['s'])
        self._pid.reset()
        self._command, self._near, self._steps = Command(), start['s'], 0
        self._lap, self._lap_began = 0, None if start['s'] else 0.0
        self._lap_times: tuple[float, ...] = ()
        if self._picture:
            self._picture.begin()
        found = self._observe()
        if self._is_shown:
            self.render()
        return found

    def step(self, action: Any) -> tuple[Floats, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """Go one step of the plant."""
        task, plant, before = self.task, self._plant, self._s
        motor, servo = task.command(action)
        if motor is None:
            motor = self._pid.acc_calculate(task.speed, self._speed, task.ts)
        self._command = Command(motor, servo)
        plant.advance(self._command)
        self._steps += 1
        observation, info = self._observe()
        s, e_y, v = self._s, info.get('e_y', 0.0), plant.state.v
        reward = task.reward(s - before, e_y, v)
        if self._is_shown:
            self.render()
        return observation, reward, task.is_over(s, e_y, v), False, info

    def render(self) -> Any:  # noqa: ANN401 (as Gymnasium's)
        """Return a picture of the car where it is now, or show it in a window."""
        if not self.render_mode:
            return None
        if not self._picture:
            from barc_sim.learning.rendering import Picture  # noqa: PLC0415 (slow)

            self._picture = Picture(self.task, in_window=self._is_shown)
        return self._picture.draw(self._plant, self._command, self._steps * self.task.ts)

    def close(self) -> None:
        """Close the window."""
        if self._picture:
            self._picture.close()

    def _observe(self) -> tuple[Floats, dict[str, Any]]:
        """Return the observation, and `info`."""
        task, plant, track = self.task, self._plant, self.task.track
        s, e_y, e_psi, _ = plant.frenet or (plant.state.x, 0.0, 0.0, 0.0)
        info, speed, self._s = {'s': s}, plant.v_x, s
        if track:
            if plant.lap > self._lap:
                began = self._steps * plant.ts - plant.lap_time
                if self._lap_began is not None:
                    self._lap_times = *self._lap_times, began - self._lap_began
                self._lap, self._lap_began = plant.lap, began
            info = {
                's': s,
                'e_y': e_y,
                'lap': plant.lap,
                'lap_time': plant.lap_time,
                'lap_times': self._lap_times,
            }
        if task.is_noisy:
            (s, y, psi, speed, _, _), _ = plant.sensor.measure(plant.motion())
            if track:
                s, e_y, e_psi, _ = track.frenet(s, y, psi, self._near)
        self._near, self._speed = s, speed
        seen = task.speed - speed, e_y, e_psi, speed, *self._command
        return task.observe(seen, task.ahead(s)), info


class CarVectorEnv(VectorEnv[Any, Any, Any]):
    """Many cars in one batch of NumPy arrays, each as `CarEnv` steps it, to 1e-12.

    Car `i` has the random numbers of a `CarEnv` that was reset with `seed + i`. An episode ends
    beyond the limits, or after `max_episode_steps`; with the next step its car starts anew, and
    that action counts for nothing. The numbers of `info` are arrays.
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
        """Take the name of a task, its options, and how many cars there are."""
        self.task, self.num_envs = TASKS[task](**options), num_envs
        self.single_observation_space, self.single_action_space = spaces(self.task)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._max_steps = max_episode_steps or np.iinfo(np.intp).max
        self._generators: list[np.random.Generator] = []

    def reset(self, *, seed: int | None = None, options: Options = None) -> tuple[Floats, Any]:
        """Begin an episode with each car; those that come later begin by chance."""
        n, task = self.num_envs, self.task
        if seed is not None or not self._generators:
            first = np_random(seed)[1] if seed is None else seed
            self._generators = [np_random(first + i)[0] for i in range(n)]
        self._plants = task.batch(n)
        self._pids = PIDs(n, speed_controller(limit=task.limits['motor']), task.ts)
        self._motor, self._servo, self._near = np.zeros((3, n))
        self._over = np.zeros(n, np.bool_)
        self._begin(np.arange(n), options)
        return self._observe(), self._info()

    def step(self, actions: Any) -> tuple[Floats, Floats, Any, Any, dict[str, Any]]:  # noqa: ANN401
        """Go one step with each car; those whose episode is over begin a new one instead."""
        task, plants = self.task, self._plants
        shares = np.maximum(-1.0, np.minimum(np.asarray(actions, np.float64).T, 1.0))
        if shares.shape != self.action_space.shape[::-1] or np.isnan(shares).any():
            raise UserError(task.no_action.format(actions))
        motor, servo = task.commands(shares)
        if motor is None:
            motor = self._pids.control(task.speed, self._speed)
        self._motor, self._servo = motor, servo + 0.0 * motor
        before = plants.s
        plants.advance(self._motor, self._servo)
        restarted = np.flatnonzero(self._over)
        if restarted.size:
            self._begin(restarted)
        observation = self._observe()
        rewards = task.reward(plants.s - before, plants.e_y, plants.v)
        terminated = task.is_over(plants.s, plants.e_y, plants.v)
        truncated = plants.steps >= self._max_steps
        rewards[restarted] = 0.0
        terminated[restarted] = truncated[restarted] = False
        self._over = terminated | truncated
        return observation, rewards, terminated, truncated, self._info()

    def _begin(self, cars: NDArray[np.intp], options: Options = None) -> None:
        """Begin an episode with each of these."""
        task, plants = self.task, self._plants
        count = _DRAWS + len(task.ranges)
        shares = np.array([self._generators[car].random(count) for car in cars.tolist()]).T
        start = task.start(shares[:4], options)
        drawn = task.draw(shares[_DRAWS:])
        plants.vary(cars, drawn)
        if 'delay' in drawn:
            plants.motor.delay_some(cars, drawn['delay'])
            if task.delays_servo:
                plants.servo.delay_some(cars, drawn['delay'])
        if task.is_noisy:
            speeds = drawn.get('noise', np.full(len(cars), task.noise.v_x)).tolist()
            levels = [task.noise._replace(v_x=level) for level in speeds]
            plants.make_noise(cars, levels, (shares[4] * 2.0**53).astype(np.int64).tolist())
        plants.place(cars, task.pose(start), start)
        self._pids.reset(cars)
        self._motor[cars] = self._servo[cars] = 0.0
        self._near[cars] = start['s']

    def _observe(self) -> Floats:
        task, plants = self.task, self._plants
        s, e_y, e_psi = plants.s, plants.e_y, plants.e_psi
        measured: Any = plants.measure()
        if task.is_noisy:
            s, y, psi, *_ = measured
            if task.track:
                s, e_y, e_psi, _ = task.track.frenet(s, y, psi, self._near)  # type: ignore[assignment]
        self._near, self._speed = s, measured.v_x
        seen = task.speed - self._speed, e_y, e_psi, self._speed, self._motor, self._servo
        return task.observe(seen, task.ahead(s))

    def _info(self) -> dict[str, Any]:
        plants = self._plants
        if not self.task.track:
            return {'s': plants.s.copy()}
        return {
            's': plants.s.copy(),
            'e_y': plants.e_y.copy(),
            'lap': plants.lap.astype(np.intp),
            'lap_time': plants.steps * plants.ts - plants.lap_began,
            'lap_times': plants.lap_times.copy(),
        }
