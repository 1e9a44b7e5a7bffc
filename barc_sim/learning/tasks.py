"""What the environments ask for: observations, actions, rewards and ends, of one car or of many.

The functions take numbers or arrays alike: each is written once for the single environment, the
batch, and the policy that drives a run, which is here, too.
"""

from __future__ import annotations

import os
from bisect import bisect_right
from itertools import pairwise, product
from math import inf, isnan, pi, radians
from operator import itemgetter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from barc_sim.control.cruise_control import SPEED
from barc_sim.control.lane import STEERING_LIMIT
from barc_sim.control.speed import ACCELERATION_LIMIT, SPEED_REFERENCE
from barc_sim.errors import UserError, extra
from barc_sim.simulation.closed_loop import LIMITS, check_arguments, plant_of
from barc_sim.simulation.fast import Plants
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.parameters import ROWS
from barc_sim.vehicle.track import Pose

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from barc_sim.control.lane import Curvature
    from barc_sim.control.speed import Gain
    from barc_sim.vehicle.plant import Plant

    Floats = NDArray[np.float64]

#: [m] where the road ahead is observed: its curvature or its incline.
AHEAD = (0.0, 5.0, 10.0, 15.0, 20.0)
MAX_SPEED = 50.0  #: [m/s] A faster car's episode ends.
BEHIND = -10.0  #: [m] So does that of a car that rolls so far back, before the start of the hills.
_START_E_PSI = 0.2  #: [rad] either way
#: The options of `simulate` and `lap` that an environment has.
OPTIONS = 'road', 'track', 'vehicle', 'dynamics', 'lateral', 'noise', 'delay', 'servo', 'ts'
_PARAMETERS = *Vehicle._fields, *LateralParameters._fields
#: What may be drawn anew for each episode, and its limits.
_VARIED = {name: (ROWS | LIMITS)[name] for name in (*_PARAMETERS, 'noise', 'delay')}


#: What a car measures, and its latest command: speed to hold less the measured one [m/s], e_y [m],
#: e_psi [rad], speed along the car's axis [m/s], acceleration [m/s²], steering [rad].
SEEN = 'error', 'e_y', 'e_psi', 'speed', 'motor', 'servo'


class Task:
    """The options that all environments have, and what each makes of them."""

    #: The observation's numbers: of `SEEN`, by name, and the bounds of each, either way.
    observed: ClassVar[Mapping[str, float]]
    #: What an action commands, each from -1 to 1: that share of the limit.
    actions: ClassVar[tuple[str, ...]]
    course: ClassVar[Mapping[str, str]] = {'track': 'L', 'road': 'flat'}
    default_speed: ClassVar[float] = 6.0
    start_speeds: ClassVar[tuple[float, float]] = (0.0, 2.0)  #: from and to, as shares of it

    def __init__(
        self,
        *,
        speed: float | None = None,
        acceleration_limit: float = ACCELERATION_LIMIT,
        ranges: Mapping[str, tuple[float, float]] | None = None,
        **options: Any,  # noqa: ANN401 (of `simulate` and `lap`)
    ) -> None:
        """Take `OPTIONS` by the names that they have in `simulate` and `lap`.

        `ranges` has the limits of what each episode draws anew, by the name of the option or of
        the parameter of vehicle or tyres: `{'mass': (1500.0, 2500.0), 'delay': (0.0, 0.1)}`.

        UserError: an option is unknown, or out of its limits.
        """
        for name in options.keys() - {*OPTIONS}:
            all_names = *OPTIONS, 'speed', 'acceleration_limit', 'ranges'
            raise UserError(f'option {name!r} must be one of {", ".join(all_names)}')
        if options.get('track') and 'track' not in self.course:
            raise UserError(
                f'track {options["track"]!r}: these hills are on a straight road: leave it out'
            )
        self.speed = self.default_speed if speed is None else speed
        SPEED.check(self.speed, 'speed')
        given = {name: each for name, each in options.items() if each not in (None, '')}
        check_arguments(acceleration_limit=acceleration_limit)
        self.limits = {'motor': acceleration_limit, 'servo': STEERING_LIMIT}
        self._options: dict[str, Any] = {**self.course, **given}
        like = self.plant({})
        self.road, self.track, self.ts = like.road, like.track, like.ts
        self.noise = like.sensor.noise
        self._options |= {'road': self.road, 'track': self.track}  # read once
        self.ranges = dict(ranges or {})
        for name, (low, high) in self.ranges.items():
            if name not in _VARIED:
                raise UserError(f'ranges: {name!r} must be one of {", ".join(_VARIED)}')
            for value in (low, high):
                _VARIED[name].check(value, f'ranges: {name}')
        self.is_noisy = any(self.noise) or 'noise' in self.ranges
        #: Whether episodes have plants of their own.
        self.varies = bool(self.ranges or self.is_noisy)
        #: Whether `delay` is that of the servo, too.
        self.delays_servo = 'servo' not in given
        for corner in product(*self.ranges.values()):
            self.plant(dict(zip(self.ranges, corner, strict=True)))
        self.length = self.track.length if self.track else self.road.starts[-1]  # [m]
        self.half_width = 0.5 * self.track.width if self.track else inf  # [m]
        if track := self.track:
            self.ahead = _preview(track.starts, track.curvature, track.is_closed)
        else:
            self.ahead = _preview(self.road.starts, lambda x: radians(self.road.grade_deg(x)))
        ahead = [1.0 / self.half_width if self.track else 0.5 * pi] * len(AHEAD)
        known = {**self.limits, 'e_y': 2.0 * self.half_width}
        bounds = [known.get(name, bound) for name, bound in self.observed.items()]
        self.high = np.array([*bounds, *ahead])
        self._low, self._own = -self.high, itemgetter(*map(SEEN.index, self.observed))

    def plant(self, drawn: Mapping[str, float], seed: int = 0) -> Plant:
        """Return the plant of an episode with these of `ranges`, and this seed of the noise."""
        options = self._options | {'seed': seed}
        for name, kind in (('vehicle', Vehicle), ('lateral', LateralParameters)):
            if mine := {each: drawn[each] for each in drawn.keys() & {*kind._fields}}:
                options[name] = (options.get(name) or kind())._replace(**mine)
        if 'delay' in drawn:
            options['delay'] = drawn['delay']
        if 'noise' in drawn:
            options['noise'] = self.noise._replace(v_x=drawn['noise'])
        return plant_of(**options)

    def batch(self, n: int) -> Plants:
        """Return the plants of `n` cars."""
        return Plants(n, self.plant({}), max(self.ranges.get('delay', (0.0,))))

    def draw(self, shares: Any) -> dict[str, Any]:  # noqa: ANN401 (numbers or arrays)
        """Return the numbers of an episode, by name, at these shares of `ranges`."""
        pairs = zip(self.ranges.items(), shares, strict=True)
        return {name: low + (high - low) * share for (name, (low, high)), share in pairs}

    def command(self, action: Any) -> tuple[Any, float]:  # noqa: ANN401 (of numbers)
        """Return what `commands` does, of the action of one car; UserError: it is none."""
        try:
            shares = [1.0 if x > 1.0 else max(x, -1.0) for x in np.asarray(action).tolist()]
            if len(shares) == len(self.actions) and not isnan(sum(shares)):
                return self.commands(shares)
        except (TypeError, ValueError):
            pass
        raise UserError(self.no_action.format(action))

    @property
    def no_action(self) -> str:
        """What is wrong with an action that is none."""
        return (
            f'action {{}}: each car takes a list of {" and ".join(self.actions)}, from -1 to 1 and '
            'not NaN'
        )

    def commands(self, shares: Any) -> tuple[Any, Any]:  # noqa: ANN401 (of numbers or arrays)
        """Return acceleration, None for the PID's, and steering of an action's shares."""
        motor = shares[0] * self.limits['motor'] if 'motor' in self.actions else None
        return motor, shares[-1] * self.limits['servo'] if 'servo' in self.actions else 0.0

    def start(self, shares: Any, options: Mapping[str, Any] | None) -> dict[str, Any]:  # noqa: ANN401
        """Return where an episode begins: at random `shares`, or as the `options` give it."""
        s, e_y, e_psi, v = shares
        least, most = self.start_speeds
        start = {'s': s * self.length}
        if self.track:
            start['e_y'] = (2.0 * e_y - 1.0) * self.track.width / 6.0
            start['e_psi'] = (2.0 * e_psi - 1.0) * _START_E_PSI
        start['v'] = self.speed * (least + (most - least) * v)
        for name, value in (options or {}).items():
            if name not in start:
                raise UserError(f'options: {name!r} must be one of {", ".join(start)}')
            start[name] = value + 0.0 * start[name]
        return start

    def pose(self, start: Mapping[str, Any]) -> Pose:
        """Return the pose on the map at which an episode begins."""
        if self.track:
            return self.track.place(start['s'], start['e_y'], start['e_psi'])
        return Pose(start['s'], 0.0 * start['s'], 0.0 * start['s'])

    def observe(self, seen: tuple[Any, ...], ahead: Any) -> Floats:  # noqa: ANN401 (or arrays)
        """Return the observation, of shape (numbers,), or (cars, numbers).

        `seen` is what `SEEN` names, and `ahead` the curvature [1/m], or incline [rad], at each of
        `AHEAD`.
        """
        values = np.array((*self._own(seen), *ahead)).T
        np.maximum(values, self._low, out=values)
        within: Floats = np.minimum(values, self.high, out=values)
        return within

    def is_over(self, s: Any, e_y: Any, v: Any) -> Any:  # noqa: ANN401 (flags of arrays)
        """Return whether the car is off the track, or beyond the limits."""
        if not self.track:
            return (abs(v) > MAX_SPEED) | (s < BEHIND)
        over = (abs(e_y) > self.half_width) | (abs(v) > MAX_SPEED)
        return over if self.track.is_closed else over | (s >= self.length)

    def reward(self, way: Any, e_y: Any, v: Any) -> Any:  # noqa: ANN401
        """Return the reward of a step of `way` [m] that ended there."""
        raise NotImplementedError


def _preview(
    starts: Sequence[float], at: Callable[[float], float], is_closed: bool = False
) -> Callable[[Any], Any]:
    """Return a function of s [m]: what is at each of `AHEAD` from there; a row each, of an array.

    `at` changes at `starts` alone, [m], of which the last is the length where the way `is_closed`:
    so does this function at the places that lie so far before them, and is a table.
    """
    length = starts[-1] if is_closed else inf
    ends = sorted({start - d for start in starts for d in AHEAD})
    if is_closed:
        ends = sorted({end % length for end in ends})
    middles = [ends[0] - 1.0, *(0.5 * (a + b) for a, b in pairwise(ends)), ends[-1] + 1.0]
    table = [tuple(at(middle + d) for d in AHEAD) for middle in middles]
    if is_closed:
        table[0] = table[-1] = tuple(at(0.5 * (ends[-1] + ends[0] + length) + d) for d in AHEAD)
    places, rows = np.array(ends), np.array(table).T

    def ahead(s: Any) -> Any:  # noqa: ANN401 (a number or an array)
        if isinstance(s, float):
            return table[bisect_right(ends, s % length if is_closed else s)]
        s = s - np.floor(s / length) * length if is_closed else s  # as `%` does, in a third
        return rows.take(places.searchsorted(s, 'right'), 1)

    return ahead


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

    observed = MappingProxyType({'error': 100.0, 'speed': MAX_SPEED, 'motor': 0.0})
    actions = ('motor',)
    course = MappingProxyType({'road': 'lab'})
    default_speed = SPEED_REFERENCE

    def reward(self, way: Any, e_y: Any, v: Any) -> Any:  # noqa: ANN401, ARG002
        """Return the reward of a step of `way` [m] that ended there."""
        return 1.0 - abs(self.speed - v) / self.speed


class Lane(Task):
    r"""Keep the lane at a given speed, which the PID of `acc` holds.

    Action, shape (1,)
        front steering angle: ±1 is ±0.5 rad, positive to the left
    Observation, shape (9,), measured
        0. e_y: distance to the left of the centre line [m], ±width
        1. e_psi: heading less that of the centre line [rad], ±π
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

    observed = MappingProxyType({'e_y': 0.0, 'e_psi': pi, 'speed': MAX_SPEED, 'servo': 0.0})
    actions = ('servo',)
    start_speeds = (1.0, 1.0)

    def reward(self, way: Any, e_y: Any, v: Any) -> Any:  # noqa: ANN401, ARG002
        """Return the reward of a step of `way` [m] that ended there."""
        return 1.0 - abs(e_y) / self.half_width


class Race(Task):
    """Get as far along the track as possible.

    Action, shape (2,)
        acceleration: ±1 is ±`acceleration_limit`, 8 m/s²; and steering, as in `Lane`
    Observation, shape (10,), measured
        as in `Lane`, with the latest acceleration command [m/s²] before that of the steering
    Reward
        the way along the track since the state before [m]
    Start
        as in `Lane`, at up to twice `speed`
    End
        as in `Lane`
    """

    observed = MappingProxyType(
        {'e_y': 0.0, 'e_psi': pi, 'speed': MAX_SPEED, 'motor': 0.0, 'servo': 0.0}
    )
    actions = ('motor', 'servo')

    def reward(self, way: Any, e_y: Any, v: Any) -> Any:  # noqa: ANN401, ARG002
        """Return the reward of a step of `way` [m] that ended there."""
        return way


TASKS: Mapping[str, type[Task]] = {each.__name__: each for each in (Hills, Lane, Race)}


class Policy:
    """A policy in the place of a run's own controllers: it drives as in its environment.

    One of `barc_sim/Lane-v0` or `barc_sim/Race-v0` is a lane controller, as of `lap`, and one of
    `barc_sim/Hills-v0` a speed controller, as of `simulate`; `barc acc --policy FILE` takes each.

    Examples
    --------
    >>> from barc_sim import lap
    >>> def policy(observation):
    ...     e_y, e_psi, speed, latest, curvature, *ahead = observation
    ...     return [6.0 * curvature - 0.4 * e_y - 1.2 * (e_psi + 1.5 * curvature)]
    >>> log = lap(Policy(policy), 'oval', laps=1)
    >>> print(f'{abs(log.e_y).max():.2f} m off the line')
    0.04 m off the line
    """

    gains: ClassVar[Mapping[str, Gain]] = {}
    terms: ClassVar[Mapping[str, str]] = {}
    output_min, output_max, saturated = -inf, inf, False

    def __init__(
        self,
        policy: Callable[[Any], Any] | str | os.PathLike[str],
        task: str = 'Lane',
        **options: Any,  # noqa: ANN401 (of the environment)
    ) -> None:
        """Take a function of the observation that returns the action, or the path of an ONNX file.

        UserError: its action for an observation of zeros is none of the task.
        """
        self.task = TASKS[task](**options)
        self._policy = policy if callable(policy) else onnx_policy(policy)
        self.task.command(self._policy(np.zeros(len(self.task.high))))
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next call is the first."""
        self._motor = self._servo = self._x = 0.0
        if len(self.task.actions) > 1:
            self.acceleration = 0.0  #: [m/s²] in place of the speed controller's

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the front angle [rad] for errors in metres and radians, and a speed in m/s."""
        ahead = [curvature(d) for d in AHEAD]
        self._act(self.task.speed - speed, e_y, e_psi, speed, ahead)
        if len(self.task.actions) > 1:
            self.acceleration = self._motor
        return self._servo

    def see(self, x: float) -> None:
        """Take the measured place on the road [m], before each call of `acc_calculate`."""
        self._x = x

    def acc_calculate(self, speed_reference: float, speed_current: float, dt: float) -> float:  # noqa: ARG002
        """Return the acceleration [m/s²] for speeds in m/s."""
        ahead = self.task.ahead(self._x)
        self._act(speed_reference - speed_current, 0.0, 0.0, speed_current, ahead)
        return self._motor

    def _act(self, error: float, e_y: float, e_psi: float, speed: float, ahead: Any) -> None:  # noqa: ANN401
        seen = error, e_y, e_psi, speed, self._motor, self._servo
        motor, self._servo = self.task.command(self._policy(self.task.observe(seen, ahead)))
        self._motor = motor or 0.0


def onnx_policy(path: str | os.PathLike[str]) -> Callable[[Any], Any]:
    """Return the policy in an ONNX file: one input of shape (1, numbers), and the action first.

    UserError: there is no such file, onnxruntime is not installed, or it holds no such policy.
    """
    name = os.fspath(path)
    if not os.path.isfile(name):  # noqa: PTH113 (as it is given)
        raise UserError(f'{name!r} cannot be read: there is no such file')
    onnxruntime = extra('onnxruntime', repr(name), 'onnx')
    try:
        session = onnxruntime.InferenceSession(name, providers=['CPUExecutionProvider'])
        (given,) = session.get_inputs()
    except Exception as error:  # noqa: BLE001 (of many kinds)
        raise UserError(f'{name!r} is no ONNX file of one input: {error}') from None
    kind = np.float64 if 'double' in given.type else np.float32

    def policy(observation: Floats) -> Any:  # noqa: ANN401 (an array)
        try:
            return session.run(None, {given.name: observation.astype(kind)[None]})[0][0]
        except Exception as error:  # noqa: BLE001 (as above)
            raise UserError(f'{name!r}: {error}') from None

    return policy
