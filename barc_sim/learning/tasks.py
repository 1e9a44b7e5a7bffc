"""The tasks of the environments: observations, actions, rewards and ends.

The laws are written once for the single environment, for the compiled batch, and for `Policy`,
which drives a run.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from math import copysign, inf, isnan, pi
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from barc_sim.cli.packages import extra
from barc_sim.control.lane import STEERING_LIMIT
from barc_sim.control.pilots import Pilot
from barc_sim.errors import UserError
from barc_sim.interfaces.records import Command
from barc_sim.learning.options import (
    OF_RUN,
    OPTIONS,
    checked_numbers,
    checked_ranges,
    option_of,
    scenario_of,
)
from barc_sim.learning.preview import AHEAD, Preview
from barc_sim.simulation.closed_loop import LAP_SPEED, LAP_TRACK, chosen_scenario
from barc_sim.simulation.scenario import LIMITS, Scenario
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import BicycleState, Vehicle
from barc_sim.vehicle.law import law
from barc_sim.vehicle.parameters import needs_track

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from os import PathLike

    from numpy.typing import NDArray

    from barc_sim.control.situation import Situation
    from barc_sim.vehicle.plant import NoiseLevels, Plant

    Floats = NDArray[np.float64]
    Column = Any  #: a list or tuple of numbers in Python, an array in compiled code

MAX_SPEED = 50.0  #: [m/s] A faster car's episode ends.
BEHIND = -10.0  #: [m] So does that of a car that rolls so far back, before the start of the hills.
#: The start of an episode, the first of what it draws: [m], [m], [rad], [m/s].
STARTS = ('s', 'e_y', 'e_psi', 'v')
_START_E_PSI = 0.2  #: [rad] either way
_SPEED = LIMITS['speed_reference']._replace(between=(1e-3, LIMITS['speed_reference'].between[1]))
#: The numbers of the tasks, by which their laws are chosen.
HILLS, LANE, RACE = range(3)


class CarSignals(NamedTuple):
    """What a car measures, and its latest command."""

    error: float  #: [m/s] speed to hold less the measured one
    e_y: float  #: [m]
    e_psi: float  #: [rad]
    speed: float  #: [m/s] along the car's axis
    motor: float  #: [m/s²]
    servo: float  #: [rad]


class Rules(NamedTuple):
    """The numbers of a task, as its laws take them."""

    task: int  #: `HILLS`, `LANE` or `RACE`
    limits: CarSignals  #: the bounds of signals and commands, either way
    speed: float  #: [m/s] to hold, or typical
    half_width: float  #: [m] of the track; infinite on a road
    length: float  #: [m] of the track or road
    has_track: bool
    is_closed: bool  #: a lap ends no episode


@law
def within(value: float, limit: float) -> float:
    """Return the number from -`limit` to `limit` that is nearest to a value."""
    return value if -limit <= value <= limit else copysign(limit, value)


@law
def command_of(rules: Rules, speed_command: float, action: Column) -> Command:
    """Return the command of an action.

    `speed_command` [m/s²] is that of the PID, which `Lane` uses.
    """
    limits = rules.limits
    first = within(action[0], 1.0)
    if rules.task == HILLS:
        return Command(first * limits.motor, 0.0)
    if rules.task == LANE:
        return Command(speed_command, first * limits.servo)
    return Command(first * limits.motor, within(action[1], 1.0) * limits.servo)


@law
def observe(rules: Rules, signals: CarSignals, observation: Column) -> int:
    """Store what a task observes of a car; return how many numbers: what is ahead follows them."""
    limits = rules.limits
    if rules.task == HILLS:
        observation[0] = within(signals.error, limits.error)
        observation[1] = within(signals.speed, limits.speed)
        observation[2] = within(signals.motor, limits.motor)
        return 3

    observation[0] = within(signals.e_y, limits.e_y)
    observation[1] = within(signals.e_psi, limits.e_psi)
    observation[2] = within(signals.speed, limits.speed)
    if rules.task == LANE:
        observation[3] = within(signals.servo, limits.servo)
        return 4
    observation[3] = within(signals.motor, limits.motor)
    observation[4] = within(signals.servo, limits.servo)
    return 5


@law
def reward(rules: Rules, way: float, e_y: float, v: float) -> float:
    """Return the reward of a step of `way` [m] that ended in this state."""
    if rules.task == HILLS:
        return 1.0 - abs(rules.speed - v) / rules.speed
    if rules.task == LANE:
        return 1.0 - abs(e_y) / rules.half_width
    return way


@law
def is_over(rules: Rules, s: float, e_y: float, v: float) -> bool:
    """Return whether the car is off the track, or beyond the limits."""
    if abs(v) > MAX_SPEED:
        return True
    if not rules.has_track:
        return s < BEHIND
    return abs(e_y) > rules.half_width or (not rules.is_closed and s >= rules.length)


class DrivingTask:
    """A task: its options, plant, observations, actions, rewards and ends.

    Attributes
    ----------
    scenario
        The options as a value.
    plain
        The plant of the options alone, without a draw from `ranges`.
    draws
        What an episode draws, by name: from and to. `STARTS` come first, then `noise`.
    rules
        The record that the laws take.
    high
        The bounds of an observation, shape (numbers,).
    """

    number: ClassVar[int]  #: `HILLS`, `LANE` or `RACE`
    #: What is observed of the measured `CarSignals`.
    measured: ClassVar[tuple[str, ...]] = ('e_y', 'e_psi', 'speed')
    #: What an action commands, each from -1 to 1: that share of the limit. It is observed, too.
    actions: ClassVar[tuple[str, ...]]
    course: ClassVar[Mapping[str, str]] = {'track': LAP_TRACK, 'road': 'flat'}
    default_speed: ClassVar[float] = LAP_SPEED
    start_speeds: ClassVar[tuple[float, float]] = (0.0, 2.0)  #: from and to, as shares of it

    def __init__(
        self,
        *,
        speed: float | None = None,
        acceleration_limit: float = Scenario.acceleration_limit,
        ranges: Mapping[str, tuple[float, float]] | None = None,
        scenario: Scenario | Mapping[str, Any] | None = None,
        **options: Any,  # noqa: ANN401 (of `simulate` and `lap`)
    ) -> None:
        """Take options by name, or a scenario.

        Parameters
        ----------
        speed
            [m/s] to hold, or typical.
        acceleration_limit
            [m/s²] maximum commanded acceleration and deceleration.
        ranges
            The limits of the values that each episode draws at random, by the name of the option,
            or of the parameter of vehicle or tyres:
            `{'mass': (1500.0, 2500.0), 'delay': (0.0, 0.1)}`.
        scenario
            A run as a value, or a dict of its fields, in place of `speed`, `acceleration_limit` and
            `options`. The speed is its `speed_reference`; its ends end no episode.
        options
            Fields of a `Scenario`: those that `learning.options.OPTIONS` names.

        Raises
        ------
        UserError
            if an option is unknown or out of its limits, or the scenario has a field for which an
            environment has no part.
        """
        by_name = self._scenario_of_options(speed, acceleration_limit, options)
        default = self._scenario_of_options()
        self.scenario = chosen_scenario(scenario_of(scenario), by_name, default)
        self._check_scenario()
        self.speed = self.scenario.speed_reference

        self.plain = self.plant({})
        self.road = self.plain.road
        self.track = self.plain.track
        self.ts = self.plain.ts
        self.ranges = checked_ranges(ranges)
        self._check_ranges()

        self._set_course()
        self._set_draws()
        self._set_bounds()

    def _scenario_of_options(
        self,
        speed: float | None = None,
        acceleration_limit: float = Scenario.acceleration_limit,
        options: Mapping[str, Any] = MappingProxyType({}),
    ) -> Scenario:
        """Return the scenario of the options of an environment; UserError: one is unknown."""
        allowed = self._allowed_options()
        for name in options:
            if name not in allowed:
                names = [*allowed, 'speed', 'acceleration_limit', 'ranges', 'scenario']
                raise UserError(f'option {name!r} must be one of {", ".join(names)}')
        if speed is None:
            speed = self.default_speed
        _SPEED.check(speed, 'speed')

        values: dict[str, Any] = dict(self.course)
        for name, value in options.items():
            if value not in (None, ''):
                values[name] = option_of(name, value)
        return Scenario(speed_reference=speed, acceleration_limit=acceleration_limit, **values)

    def _allowed_options(self) -> list[str]:
        return [name for name in OPTIONS if name != 'track' or name in self.course]

    def _check_scenario(self) -> None:
        """Raise UserError if an environment has no part for a field of the scenario."""
        scenario = self.scenario
        if 'track' in self.course and not scenario.track:
            raise needs_track(f'{type(self).__name__}-v0')
        _SPEED.check(scenario.speed_reference, 'speed_reference')

        allowed = {*self._allowed_options(), *OF_RUN}
        for name in scenario.changes():
            if name not in allowed:
                raise UserError(
                    f'scenario {scenario!r} has {name}, which is no option of '
                    f'{type(self).__name__}-v0: leave it out'
                )

    def _check_ranges(self) -> None:
        """Raise UserError if there is no plant at a corner of the ranges."""
        for corner in product(*self.ranges.values()):
            self.plant(dict(zip(self.ranges, corner, strict=True)))

    def _set_course(self) -> None:
        """Set the size of track or road, and what is observed ahead."""
        track = self.track
        if track:
            self.length = track.length
            self.half_width = 0.5 * track.width
            self.ahead = Preview(track.starts, track.curvature, track.is_closed)
            self._max_ahead = 1.0 / self.half_width
        else:
            self.length = self.road.starts[-1]
            self.half_width = inf
            self.ahead = Preview(self.road.starts, self._incline)
            self._max_ahead = 0.5 * pi

    def _incline(self, x: Floats) -> Floats:
        """Return the incline [rad] at places [m]."""
        inclines: Floats = np.radians(self.road.grade_deg(x))
        return inclines

    def _set_draws(self) -> None:
        """Set what an episode draws, and what its options may set."""
        slowest, fastest = self.start_speeds
        beside = 0.0
        turned = 0.0
        self._allowed = {'s': LIMITS['distance'].between, 'v': (-MAX_SPEED, MAX_SPEED)}
        if self.track:
            beside = self.half_width / 3.0
            turned = _START_E_PSI
            self._allowed['s'] = (0.0, self.length)
            self._allowed['e_y'] = (-self.half_width, self.half_width)
            self._allowed['e_psi'] = (-pi, pi)

        level = self.plain.sensor.noise.v_x
        self.draws = {
            's': (0.0, self.length),
            'e_y': (-beside, beside),
            'e_psi': (-turned, turned),
            'v': (slowest * self.speed, fastest * self.speed),
            'noise': (level, level),
            **self.ranges,
        }
        self._lows = np.array([low for low, _ in self.draws.values()])
        self._spans = np.array([high - low for low, high in self.draws.values()])
        self._columns = {name: column for column, name in enumerate(self.draws)}

        sensor = self.plain.sensor
        self._noise = sensor.noise
        self.is_noisy = sensor.is_noisy or 'noise' in self.ranges
        #: Whether what is measured is the true motion.
        self.is_exact = not (self.is_noisy or sensor.delay)

    def _set_bounds(self) -> None:
        """Set the bounds of signals, commands and observations, and the record of the laws."""
        self.limits = CarSignals(
            error=2.0 * MAX_SPEED,
            e_y=2.0 * self.half_width,
            e_psi=pi,
            speed=MAX_SPEED,
            motor=self.scenario.acceleration_limit,
            servo=STEERING_LIMIT,
        )

        bounds = self.limits._asdict()
        bounds_of_signals = [bounds[name] for name in (*self.measured, *self.actions)]
        self._signals = [0.0] * len(bounds_of_signals)
        self.high = np.array([*bounds_of_signals, *[self._max_ahead] * len(AHEAD)])

        self.rules = Rules(
            task=self.number,
            limits=self.limits,
            speed=float(self.speed),
            half_width=self.half_width,
            length=self.length,
            has_track=self.track is not None,
            is_closed=self.track is not None and self.track.is_closed,
        )

    def plant(self, draws: Mapping[str, float]) -> Plant:
        """Return the plant of an episode with these values of `ranges`."""
        scenario = self.scenario
        episode = replace(
            scenario,
            vehicle=_with_values(scenario.vehicle or Vehicle(), draws),
            lateral=_with_values(scenario.lateral or LateralParameters(), draws),
            delay=draws.get('delay', scenario.delay),
            disturbance=draws.get('disturbance', scenario.disturbance),
        )
        return episode.plant()

    def noise(self, speed_level: float) -> NoiseLevels:
        """Return the levels of an episode whose noise of the speed is `speed_level` [m/s]."""
        return self._noise._replace(v_x=speed_level)

    def draw(self, shares: Floats, options: Mapping[str, float] | None) -> Floats:
        """Return the random values of an episode, or of many.

        Parameters
        ----------
        shares
            From 0 to 1, the places in the limits that `draws` has: shape (numbers,), or
            (episodes, numbers).
        options
            A start that is not drawn, by name.

        Returns
        -------
        The values, in the order of `draws`, of the same shape.

        Raises
        ------
        UserError
            if an option is unknown, or out of its limits.
        """
        values: Floats = self._lows + self._spans * shares
        if options is not None:
            for name, value in checked_numbers('options', options, self._allowed).items():
                values[..., self._columns[name]] = value
        return values

    def state(self, draws: Mapping[str, float]) -> BicycleState:
        """Return the first state of an episode."""
        s = draws['s']
        v = draws['v']
        if self.track:
            pose = self.track.place(s, draws['e_y'], draws['e_psi'])
            return BicycleState(pose.x, pose.y, pose.psi, v)
        return BicycleState(s, 0.0, 0.0, v)

    def action(self, action: Any) -> list[float]:  # noqa: ANN401 (a user's)
        """Return the numbers of an action; UserError: it is not an action."""
        try:
            numbers: list[float] = np.asarray(action).tolist()
            if len(numbers) == len(self.actions) and not isnan(sum(numbers)):
                return numbers
        except (TypeError, ValueError):
            pass
        raise self._not_an_action(action)

    def action_rows(self, actions: Any, cars: int) -> Floats:  # noqa: ANN401 (as above)
        """Return the actions of many cars, shape (cars, numbers); UserError as of one."""
        try:
            rows = np.ascontiguousarray(actions, np.float64)
            if rows.shape == (cars, len(self.actions)) and not np.isnan(rows).any():
                return rows
        except (TypeError, ValueError):
            pass
        raise self._not_an_action(actions)

    def _not_an_action(self, action: object) -> UserError:
        return UserError(
            f'action {action}: each car takes a list of {" and ".join(self.actions)}, from -1 to 1 '
            'and not NaN'
        )

    def observe(self, signals: CarSignals, ahead: Column) -> Floats:
        """Return the observation of a car, shape (numbers,); `ahead` is as `Preview` returns it."""
        observe(self.rules, signals, self._signals)
        return np.array([*self._signals, *ahead])


def _with_values(record: Any, values: Mapping[str, float]) -> Any:  # noqa: ANN401 (a NamedTuple)
    """Return a record with those of the values that it has a field for."""
    return record._replace(**{name: values[name] for name in record._fields if name in values})


class Hills(DrivingTask):
    r"""Hold a speed over hills, as `acc` does.

    Action, shape (1,)
        acceleration: ±1 is ±`acceleration_limit`, 8 m/s²
    Observation, shape (8,)
        0. the error: `speed` minus the measured speed [m/s], ±100
        1. the measured speed [m/s], ±50
        2. the latest command [m/s²], ±`acceleration_limit`
        3. to 7. the incline [rad] 0, 5, 10, 15 and 20 m ahead, ±π/2
    Reward
        1 - \|error\| / `speed`, of the true speed: 1 at the speed, 0 at a standstill
    Start
        anywhere on the road, at up to twice the speed
    End
        faster than 50 m/s, or 10 m before the start of the road
    """

    number = HILLS
    measured = ('error', 'speed')
    actions = ('motor',)
    course: ClassVar = {'road': 'lab'}
    default_speed = Scenario.speed_reference


class Lane(DrivingTask):
    r"""Keep the lane at a given speed, which the PID of `acc` holds.

    Action, shape (1,)
        front steering angle: ±1 is ±0.5 rad, positive to the left
    Observation, shape (9,), measured
        0. e_y: distance to the left of the centre line [m], ±width
        1. e_psi: heading minus the heading of the centre line [rad], ±π
        2. speed [m/s], ±50
        3. the latest steering command [rad], ±0.5
        4. to 8. curvature of the centre line [1/m] 0, 5, 10, 15 and 20 m ahead, ±2/width
    Reward
        1 - \|e_y\| / half width: 1 on the centre line, 0 at the edge
    Start
        anywhere on the track, at `speed`, up to a sixth of the width beside the line
    End
        off the track, or faster than 50 m/s
    """

    number = LANE
    actions = ('servo',)
    start_speeds = (1.0, 1.0)


class Race(DrivingTask):
    """Get as far along the track as possible.

    Action, shape (2,)
        acceleration: ±1 is ±`acceleration_limit`, 8 m/s²; and steering, as in `Lane`
    Observation, shape (10,), measured
        as in `Lane`, with the latest acceleration command [m/s²] before the steering command
    Reward
        the distance along the track since the state before [m]
    Start
        as in `Lane`, at up to twice `speed`
    End
        as in `Lane`
    """

    number = RACE
    actions = ('motor', 'servo')


TASKS: Mapping[str, type[DrivingTask]] = {each.__name__: each for each in (Hills, Lane, Race)}


class Policy(Pilot):
    """A policy as a pilot: it drives a run as in its environment.

    A policy of `barc_sim/Lane-v0` or `barc_sim/Race-v0` steers in `lap`, and one of
    `barc_sim/Hills-v0` is a controller for `simulate`; `barc acc --policy FILE` takes both.
    """

    def __init__(
        self,
        policy: Callable[[Any], Any] | str | PathLike[str],
        task: str = 'Lane',
        **options: Any,  # noqa: ANN401 (of the environment)
    ) -> None:
        """Take a function of the observation that returns the action, or the path of an ONNX file.

        UserError: its action for an observation of zeros is not an action of the task.
        """
        self.task = TASKS[task](**options)
        self._policy = policy if callable(policy) else OnnxPolicy(policy)
        self.task.action(self._policy(np.zeros(len(self.task.high))))
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next situation is the first."""
        self._motor = 0.0
        self._servo = 0.0

    @property
    def plans_speed(self) -> bool:
        """Whether its actions command the acceleration, too."""
        return 'motor' in self.task.actions

    def command(self, situation: Situation) -> Command:
        """Return the command of the policy's action."""
        speed = situation.measured.v_x
        ahead: Column
        if self.task.track:
            track, place = situation.on_track()
            error = self.task.speed - speed
            e_y = place.e_y
            e_psi = place.e_psi
            ahead = [track.curvature(place.s + d) for d in AHEAD]
        else:
            error = situation.reference - speed
            e_y = 0.0
            e_psi = 0.0
            ahead = self.task.ahead(situation.along)

        signals = CarSignals(error, e_y, e_psi, speed, self._motor, self._servo)
        observation = self.task.observe(signals, ahead)
        action = self.task.action(self._policy(observation))
        command = command_of(self.task.rules, 0.0, action)
        self._motor = command.motor
        self._servo = command.servo
        return command


class OnnxPolicy:
    """The policy in an ONNX file: one input of shape (1, numbers), and the action first."""

    def __init__(self, path: str | PathLike[str]) -> None:
        """Open the file.

        UserError: there is no such file, onnxruntime is not installed, or it holds no such policy.
        """
        self.path = path
        name = str(path)
        if not Path(name).is_file():
            raise UserError(f'{name!r} cannot be read: there is no such file')

        onnxruntime = extra('onnxruntime', repr(name), 'onnx')
        try:
            self._session = onnxruntime.InferenceSession(name, providers=['CPUExecutionProvider'])
            (entry,) = self._session.get_inputs()
        except Exception as error:  # noqa: BLE001 (of many kinds)
            raise UserError(f'{name!r} is not an ONNX file with one input: {error}') from None

        self._entry = entry.name
        self._kind = np.float64 if 'double' in entry.type else np.float32

    def __call__(self, observation: Floats) -> Any:  # noqa: ANN401 (an array)
        """Return the action."""
        try:
            answers = self._session.run(None, {self._entry: observation.astype(self._kind)[None]})
            return answers[0][0]
        except Exception as error:  # noqa: BLE001 (as above)
            raise UserError(f'{str(self.path)!r}: {error}') from None

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the path alone: a session of onnxruntime cannot be pickled."""
        return OnnxPolicy, (self.path,)
