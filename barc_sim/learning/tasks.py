"""The tasks of the environments: observations, actions, rewards and ends.

The laws are written once for the single environment, for the compiled batch, and for `Policy`,
which drives a run.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import fields, replace
from itertools import product
from math import copysign, inf, isnan, pi
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from barc_sim.cli.limits import not_between
from barc_sim.cli.packages import extra
from barc_sim.control.lane import STEERING_LIMIT
from barc_sim.control.pilots import Pilot
from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import parameters_of
from barc_sim.interfaces.records import Command
from barc_sim.simulation.closed_loop import LAP_SPEED, LAP_TRACK, chosen_scenario
from barc_sim.simulation.scenario import LIMITS, Scenario
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import BicycleState, Vehicle
from barc_sim.vehicle.law import law
from barc_sim.vehicle.parameters import needs_track
from barc_sim.vehicle.plant import Actuator, NoiseLevels
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.track import Track, in_lap

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from os import PathLike

    from numpy.typing import NDArray

    from barc_sim.control.situation import Situation
    from barc_sim.vehicle.plant import Plant

    Floats = NDArray[np.float64]
    Numbers = Any  #: a number of one car, or an array of many
    Column = Any  #: a list or tuple of numbers in Python, an array in compiled code

#: [m] where the road ahead is observed: its curvature or its incline.
AHEAD = (0.0, 5.0, 10.0, 15.0, 20.0)
BLOCK = 64  #: measurements whose noise is drawn at once
MAX_SPEED = 50.0  #: [m/s] A faster car's episode ends.
BEHIND = -10.0  #: [m] So does that of a car that rolls so far back, before the start of the hills.
_START_E_PSI = 0.2  #: [rad] either way
#: The fields of a `Scenario` that are options of an environment.
OPTIONS = 'road', 'track', 'vehicle', 'dynamics', 'lateral', 'noise', 'delay', 'servo', 'ts'
#: Further fields that a scenario may have: the speed, its limit, and ends, which end no episode.
_OF_RUN = 'speed_reference', 'acceleration_limit', 'distance', 'laps', 'max_duration'
_SPEED = LIMITS['speed_reference']._replace(between=(1e-3, LIMITS['speed_reference'].between[1]))
#: What `ranges` may have, and its limits.
_VARIED = {
    row.name: row.between
    for row in (
        *parameters_of(Vehicle),
        *parameters_of(LateralParameters),
        LIMITS['noise'],
        LIMITS['delay'],
    )
}
#: The numbers of the tasks, by which their laws are chosen.
HILLS, LANE, RACE = range(3)


class Seen(NamedTuple):
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
    limits: Seen  #: the bounds of what is seen and commanded, either way
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
def command_of(rules: Rules, of_speed: float, action: Column) -> Command:
    """Return the command of an action; `of_speed` [m/s²] is that of the PID, which `Lane` uses."""
    if rules.task == HILLS:
        return Command(within(action[0], 1.0) * rules.limits.motor, 0.0)
    if rules.task == LANE:
        return Command(of_speed, within(action[0], 1.0) * rules.limits.servo)
    motor = within(action[0], 1.0) * rules.limits.motor
    return Command(motor, within(action[1], 1.0) * rules.limits.servo)


@law
def observe(rules: Rules, seen: Seen, ahead: Column, observation: Column) -> None:
    """Store the observation of a car; `ahead` are the values at each of `AHEAD`."""
    limits = rules.limits
    if rules.task == HILLS:
        observation[0] = within(seen.error, limits.error)
        observation[1] = within(seen.speed, limits.speed)
        observation[2] = within(seen.motor, limits.motor)
        count = 3
    else:
        observation[0] = within(seen.e_y, limits.e_y)
        observation[1] = within(seen.e_psi, limits.e_psi)
        observation[2] = within(seen.speed, limits.speed)
        count = 3
        if rules.task == RACE:
            observation[count] = within(seen.motor, limits.motor)
            count += 1
        observation[count] = within(seen.servo, limits.servo)
        count += 1
    for value in ahead:
        observation[count] = value
        count += 1


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


class Task:
    """A task: its options, plant, observations, actions, rewards and ends."""

    number: ClassVar[int]  #: `HILLS`, `LANE` or `RACE`
    measured: ClassVar[tuple[str, ...]] = ('e_y', 'e_psi', 'speed')  #: and observed, of `Seen`
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
        scenario: Scenario | None = None,
        **options: Any,  # noqa: ANN401 (of `simulate` and `lap`)
    ) -> None:
        """Take `OPTIONS` by the names that they have in `simulate` and `lap`, or a `scenario`.

        A scenario has the speed as `speed_reference`; its ends end no episode, and gains,
        controllers and others beyond `OPTIONS` are refused. `ranges` has the limits of the values
        that each episode draws at random, by the name of the option, or of the parameter of vehicle
        or tyres: `{'mass': (1500.0, 2500.0), 'delay': (0.0, 0.1)}`.

        UserError: an option is unknown, or out of its limits.
        """
        made = self._of_options(speed, acceleration_limit, options)
        self.scenario = chosen_scenario(scenario, made, self._of_options())
        self._check_scenario()
        self.speed = self.scenario.speed_reference
        #: Whether `delay` is that of the servo, too.
        self.delays_servo = self.scenario.servo is None
        self.plain = self.plant({})  #: the plant of the options alone
        self.road, self.track, self.ts = self.plain.road, self.plain.track, self.plain.ts
        self._noise = self.plain.sensor.noise  # of the sensor's kind, but of `np_random`
        self.ranges = _checked('ranges', ranges, _VARIED, are_pairs=True)
        for corner in product(*self.ranges.values()):
            self.plant(dict(zip(self.ranges, corner, strict=True)))
        slowest, fastest = self.start_speeds
        starts = {'v': (slowest * self.speed, fastest * self.speed)}  # from and to
        self._allowed = {'s': LIMITS['distance'].between, 'v': (-MAX_SPEED, MAX_SPEED)}
        if track := self.track:
            self.length, self.half_width = track.length, 0.5 * track.width  # [m]
            self.ahead = Preview(track.starts, track.curvature, track.is_closed)
            max_ahead, e_y = 1.0 / self.half_width, self.half_width
            starts |= {'e_y': (-e_y / 3.0, e_y / 3.0), 'e_psi': (-_START_E_PSI, _START_E_PSI)}
            self._allowed |= {'s': (0.0, self.length), 'e_y': (-e_y, e_y), 'e_psi': (-pi, pi)}
        else:
            self.length, self.half_width = self.road.starts[-1], inf
            self.ahead = Preview(self.road.starts, lambda x: np.radians(self.road.grade_deg(x)))
            max_ahead = 0.5 * pi
        self.is_noisy = any(self._noise) or 'noise' in self.ranges
        #: What an episode draws, each from and to.
        self.draws = {'s': (0.0, self.length), **starts, 'noise': (self._noise.v_x,) * 2}
        self.draws |= self.ranges
        #: The bounds of what is seen and commanded, either way.
        self.limits = Seen(
            error=2.0 * MAX_SPEED,
            e_y=2.0 * self.half_width,
            e_psi=pi,
            speed=MAX_SPEED,
            motor=self.scenario.acceleration_limit,
            servo=STEERING_LIMIT,
        )
        bounds = self.limits._asdict()
        observed = [bounds[name] for name in (*self.measured, *self.actions)]
        self.high = np.array([*observed, *[max_ahead] * len(AHEAD)])
        self.rules = Rules(
            task=self.number,
            limits=self.limits,
            speed=float(self.speed),
            half_width=self.half_width,
            length=self.length,
            has_track=self.track is not None,
            is_closed=self.track is not None and self.track.is_closed,
        )

    def _of_options(
        self,
        speed: float | None = None,
        acceleration_limit: float = Scenario.acceleration_limit,
        options: Mapping[str, Any] = MappingProxyType({}),
    ) -> Scenario:
        """Return the scenario of the options of an environment; UserError: one is unknown."""
        allowed = self._allowed_options()
        for name in options.keys() - {*allowed}:
            allowed += 'speed', 'acceleration_limit', 'ranges', 'scenario'
            raise UserError(f'option {name!r} must be one of {", ".join(allowed)}')
        speed = self.default_speed if speed is None else speed
        _SPEED.check(speed, 'speed')
        given = {name: _of_json(name, each) for name, each in options.items()}
        chosen = {name: each for name, each in given.items() if each not in (None, '')}
        return Scenario(
            speed_reference=speed,
            acceleration_limit=acceleration_limit,
            **{**self.course, **chosen},
        )

    def _allowed_options(self) -> list[str]:
        return [name for name in OPTIONS if name != 'track' or name in self.course]

    def _check_scenario(self) -> None:
        """Raise UserError if an environment has no part for a field of the scenario."""
        scenario = self.scenario
        if 'track' in self.course and not scenario.track:
            raise needs_track(f'{type(self).__name__}-v0')
        _SPEED.check(scenario.speed_reference, 'speed_reference')
        for name in scenario.changes().keys() - {*self._allowed_options(), *_OF_RUN}:
            raise UserError(
                f'scenario {scenario!r} has {name}, which is no option of {type(self).__name__}-v0:'
                ' leave it out'
            )

    def plant(self, drawn: Mapping[str, float]) -> Plant:
        """Return the plant of an episode with these values of `ranges`."""
        scenario = self.scenario
        varied = replace(
            scenario,
            vehicle=_varied(scenario.vehicle or Vehicle(), drawn),
            lateral=_varied(scenario.lateral or LateralParameters(), drawn),
            delay=drawn.get('delay', scenario.delay),
        )
        return varied.plant()

    def noise(self, of_speed: float) -> NoiseLevels:
        """Return the levels of an episode whose noise of the speed is `of_speed` [m/s]."""
        return self._noise._replace(v_x=of_speed)

    def draw(self, shares: Numbers, options: Mapping[str, float] | None) -> dict[str, Numbers]:
        """Return the random values of an episode, at these shares of `draws`, or from `options`.

        UserError: an option is unknown, or out of its limits.
        """
        pairs = zip(self.draws.items(), shares, strict=True)
        drawn = {name: low + (high - low) * share for (name, (low, high)), share in pairs}
        for name, value in _checked('options', options, self._allowed).items():
            drawn[name] = value + 0.0 * drawn[name]
        return drawn

    def state(self, drawn: Mapping[str, Numbers]) -> BicycleState:
        """Return the first state of an episode."""
        s, v = drawn['s'], drawn['v']
        if self.track:
            return BicycleState(*self.track.place(s, drawn['e_y'], drawn['e_psi']), v)
        return BicycleState(s, 0.0 * s, 0.0 * s, v)

    def action(self, given: Any) -> list[float]:  # noqa: ANN401 (a user's)
        """Return the numbers of an action; UserError: it is not an action."""
        try:
            numbers: list[float] = np.asarray(given).tolist()
            if len(numbers) == len(self.actions) and not isnan(sum(numbers)):
                return numbers
        except (TypeError, ValueError):
            pass
        raise self._not_an_action(given)

    def action_rows(self, given: Any, cars: int) -> Floats:  # noqa: ANN401 (as above)
        """Return the actions of many cars, shape (cars, numbers); UserError as of one."""
        try:
            rows = np.ascontiguousarray(given, np.float64)
            if rows.shape == (cars, len(self.actions)) and not np.isnan(rows).any():
                return rows
        except (TypeError, ValueError):
            pass
        raise self._not_an_action(given)

    def _not_an_action(self, given: object) -> UserError:
        return UserError(
            f'action {given}: each car takes a list of {" and ".join(self.actions)}, from -1 to 1 '
            'and not NaN'
        )

    def observe(self, seen: Seen, ahead: Column) -> Floats:
        """Return the observation of a car, shape (numbers,)."""
        observation = [0.0] * len(self.high)
        observe(self.rules, seen, ahead, observation)
        return np.array(observation)


def _varied(record: Any, drawn: Mapping[str, float]) -> Any:  # noqa: ANN401 (a NamedTuple)
    """Return a record with those of the drawn values that it has."""
    return record._replace(**{name: drawn[name] for name in record._fields if name in drawn})


def _checked(
    what: str,
    given: Any,  # noqa: ANN401 (a user's)
    limits: Mapping[str, tuple[float, float]],
    *,
    are_pairs: bool = False,
) -> dict[str, Any]:
    """Return a new dict of what is given by name; UserError: it is none, or beyond the limits."""
    try:
        values = {} if given is None else dict(given)
    except (TypeError, ValueError):
        raise UserError(f'{what}: {given!r} is not a dict: give each value by its name') from None
    for name, value in values.items():
        if name not in limits:
            raise UserError(f'{what}: {name!r} must be one of {", ".join(limits)}')
        try:
            low, high = value if are_pairs else (value, value)
        except (TypeError, ValueError):
            raise UserError(
                f'{what}: {name}: {value!r} is not a pair of numbers: give (lowest, highest)'
            ) from None
        for each in (low, high):
            if why := not_between(each, *limits[name]):
                raise UserError(f'{what}: {name}: {why}')
    return values


#: The options that are records, by name.
_RECORDS: Mapping[str, type[Any]] = {
    'vehicle': Vehicle,
    'lateral': LateralParameters,
    'servo': Actuator,
    'noise': NoiseLevels,
}
_COURSES: Mapping[str, type[Any]] = {'road': Road, 'track': Track}


def _of_json(name: str, value: Any) -> Any:  # noqa: ANN401 (of any option)
    """Return an option's value; the JSON of an environment's specification has lists and dicts.

    UserError: a value of a record is out of its limits.
    """
    if name in _RECORDS and type(value) is list:
        kind = _RECORDS[name]
        if len(value) != len(kind._fields):
            raise UserError(
                f'{name} {value!r} has {len(value)} numbers: expected {", ".join(kind._fields)}'
            )
        return kind(*value)
    if name in _COURSES and isinstance(value, dict):
        kind = _COURSES[name]
        names = [each.name for each in fields(kind) if each.init]
        if not set(names) <= value.keys():
            raise UserError(f'{name} {value!r} must have {", ".join(names)}')
        return kind(**{each: value[each] for each in names})
    return value


class Table(NamedTuple):
    """The values of a course at each of `AHEAD`, as a law takes them."""

    edges: Column  #: [m] places, in order, where a value changes
    rows: Column  #: the values before the first edge, between two, and beyond the last
    length: float  #: [m] of the course
    is_closed: bool


@law
def ahead_at(table: Table, s: float, near: int) -> int:
    """Return the number of the row for a place [m]; `near` is one not far from it."""
    s = in_lap(table, s)
    edges = table.edges
    while near < len(edges) and s >= edges[near]:
        near += 1
    while near > 0 and s < edges[near - 1]:
        near -= 1
    return near


class Preview:
    """The values of a course at each of `AHEAD` from a place: a function of s [m].

    The values are constant between `starts` [m], whose last one is the length if the course
    `is_closed`. So they change only where one of `AHEAD` reaches a start, and are a table.
    """

    def __init__(
        self, starts: Sequence[float], at: Callable[[Floats], Floats], is_closed: bool = False
    ) -> None:
        """Tabulate the values that `at` returns for places [m]."""
        length = starts[-1]
        places = np.subtract.outer(starts, AHEAD)
        edges = np.unique(places % length if is_closed else places)
        first, last = (0.0, length) if is_closed else (edges[0] - 1.0, edges[-1] + 1.0)
        middles = 0.5 * (np.append(first, edges) + np.append(edges, last))
        rows = at(np.add.outer(AHEAD, middles)).T
        self.table = Table(edges.tolist(), [*map(tuple, rows.tolist())], length, is_closed)

    def __call__(self, s: float) -> tuple[float, ...]:
        """Return the values ahead of `s` [m]."""
        table = self.table
        values: tuple[float, ...] = table.rows[bisect_right(table.edges, in_lap(table, s))]
        return values


class Hills(Task):
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


class Lane(Task):
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


class Race(Task):
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


TASKS: Mapping[str, type[Task]] = {each.__name__: each for each in (Hills, Lane, Race)}


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
            error, e_y, e_psi = self.task.speed - speed, place.e_y, place.e_psi
            ahead = [track.curvature(place.s + d) for d in AHEAD]
        else:
            error, e_y, e_psi = situation.reference - speed, 0.0, 0.0
            ahead = self.task.ahead(situation.along)

        seen = Seen(error, e_y, e_psi, speed, self._motor, self._servo)
        action = self.task.action(self._policy(self.task.observe(seen, ahead)))
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

    def __call__(self, observation: Floats) -> Numbers:
        """Return the action."""
        try:
            answers = self._session.run(None, {self._entry: observation.astype(self._kind)[None]})
            return answers[0][0]
        except Exception as error:  # noqa: BLE001 (as above)
            raise UserError(f'{str(self.path)!r}: {error}') from None

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the path alone: a session of onnxruntime cannot be pickled."""
        return OnnxPolicy, (self.path,)
