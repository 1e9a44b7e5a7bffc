"""Answers each state with a command: what the node `controller` computes, without ROS.

Tables list the controllers of speed and lane by name.
"""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING, Any

from barc_sim.control.excitation import PRBS, CoastDown, SineSteer, Steps
from barc_sim.control.lane import LANE, LaneLQR, PurePursuit, Stanley, speed_profile
from barc_sim.control.mpc import MPC, SpeedMPC
from barc_sim.control.pilots import (
    LaneKeeping,
    LanePilot,
    Pilot,
    SpeedPilot,
    as_lane_pilot,
    as_pilot,
)
from barc_sim.control.situation import Navigator
from barc_sim.control.speed import (
    ACCELERATION_LIMIT,
    FIRST_DT,
    LQR,
    NO_LIMIT,
    PID,
    SPEED_REFERENCE,
)
from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import ParameterDeclaration
from barc_sim.interfaces.records import Command
from barc_sim.interfaces.stamps import NANOSECONDS
from barc_sim.vehicle.road import signal

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.control.lane import LaneLaw
    from barc_sim.control.situation import Situation
    from barc_sim.control.speed import Controller, Gain
    from barc_sim.interfaces.records import VehicleState
    from barc_sim.vehicle.road import Signal
    from barc_sim.vehicle.track import Pose, Track

    #: Takes a function that returns a sentence, so that a suppressed warning costs nothing.
    Warn = Callable[[Callable[[], str]], None]

#: By the name that `--controller-type` and the parameter `controller_type` take.
TYPES: Mapping[str, type[Controller]] = {
    'pid': PID,
    'lqr': LQR,
    'prbs': PRBS,
    'steps': Steps,
    'coast-down': CoastDown,
}
DEFAULT_TYPE = 'pid'
#: By the name that `--lane` and the parameter `lane_type` take.
LANE_TYPES: Mapping[str, type[LaneLaw]] = {
    'lqr': LaneLQR,
    'stanley': Stanley,
    'pure-pursuit': PurePursuit,
    'mpc': MPC,
    'speed-mpc': SpeedMPC,
    'sine-steer': SineSteer,
}
DEFAULT_LANE = 'lqr'
#: The gains of all speed controllers in `TYPES`, by name.
GAINS: Mapping[str, Gain] = {
    name: gain for controller in TYPES.values() for name, gain in controller.gains.items()
}
#: The terms of all speed controllers in `TYPES`, by name.
TERMS: Mapping[str, str] = {
    name: meaning for controller in TYPES.values() for name, meaning in controller.terms.items()
}
_FASTEST = 1e6  #: [m/s] A faster state is refused.
_FARTHEST = 1e9  #: [m], [rad] So is a state farther away on a track: squares can be infinite.
_TYPE = ParameterDeclaration(
    'controller_type', DEFAULT_TYPE, f'which controller: {", ".join(TYPES)}', read_only=True
)
_LANE_TYPE = ParameterDeclaration(
    'lane_type', DEFAULT_LANE, f'steering law on a track: {", ".join(LANE_TYPES)}', read_only=True
)
#: Of the speed on a track.
PROFILE = [
    ParameterDeclaration(
        f'{name}_limit',
        0.0,
        f'maximum {name} acceleration [m/s²] of the speed profile on a track, whose maximum is '
        'speed_reference; 0: no profile',
        (0.0, 100.0),
    )
    for name in ('lateral', 'longitudinal')
]
SPEED = ParameterDeclaration(
    'speed_reference', SPEED_REFERENCE, 'the speed to hold [m/s]', (-100.0, 100.0)
)
LIMIT = ParameterDeclaration(
    'acceleration_limit',
    ACCELERATION_LIMIT,
    'maximum commanded acceleration and deceleration [m/s²]',
    (0.01, NO_LIMIT),
)
_PARAMETERS = [
    SPEED,
    ParameterDeclaration(
        'reference',
        '',
        'a CSV file with the columns time_s,speed_mps or distance_m,speed_mps: the speed to hold, '
        'until speed_reference is set',
        read_only=True,
    ),
]


def reference_of(given: object) -> Signal:
    """Return the speed to hold [m/s] over time and distance, from a function or a CSV file."""
    return signal(given, SPEED._replace(name='reference'), 'speed_mps')


class CruiseControl:
    """A pilot with its parameters; its dt is the difference of the states' stamps.

    The speed to hold is the parameter `speed_reference`, a number that `hold_speed` sets. If the
    parameter `reference` names a file, or a track has a speed profile, the speed to hold is a
    function of time and position instead. A number that is set later replaces the file, as the
    user or an outer loop then decides; on a track it is the maximum of a new profile. The method
    `reference` returns the present value.

    Attributes
    ----------
    speed
        The pilot of the speed.
    lane
        On a track, the one that both keeps the lane and holds the speed; otherwise None.
    situation, command
        The latest ones; None and NaN before the first state.
    values
        The parameters by name.
    """

    def __init__(
        self,
        controller: object,
        declare: Callable[[list[ParameterDeclaration]], dict[str, Any]],
        acceleration_limit: float,
        refuse: Warn,
        warn: Warn,
        track: Track | None = None,
        lane: object = None,
    ) -> None:
        """Use `controller`, an object with `acc_calculate`; by default, the parameter chooses it.

        On a `track` it uses `lane`, an object with `steer_calculate`, likewise. Either can be a
        `Pilot`. `declare` declares parameters and returns their values; `acceleration_limit` [m/s²]
        is a default. `refuse` gets the reason why a state or a reference is refused, and `warn`
        gets other warnings.
        """
        self._refuse = refuse
        self._warn = warn

        self.speed = as_pilot(controller or _chosen(declare, _TYPE, TYPES))
        self.lane: LaneKeeping | None = None
        if track:
            steering = as_lane_pilot(lane or _chosen(declare, _LANE_TYPE, LANE_TYPES))
            self.lane = LaneKeeping(self.speed, steering)
        self._pilot: Pilot = self.lane or self.speed
        self._navigator = Navigator(track)
        self.is_pid = self.speed.terms.keys() == PID.terms.keys()

        self._previous: int | None = None  # [ns] stamp of the latest state
        self._start: int | None = None  # [ns] stamp of the first state
        self._reference: Signal | None = None  # over time and place
        self.values: dict[str, Any] = {}
        self.configure(declare(self.parameters(acceleration_limit)))
        self.reset()

    @property
    def controller_type(self) -> str:
        """The name of the speed controller among `TYPES`; empty: it is another one."""
        if isinstance(self.speed, SpeedPilot):
            return _name_of(self.speed.controller, TYPES)
        return ''

    @property
    def lane_type(self) -> str:
        """The name of the steering law among `LANE_TYPES`; empty: it is another one, or none."""
        if self.lane and isinstance(self.lane.lane, LanePilot):
            return _name_of(self.lane.lane.controller, LANE_TYPES)
        return ''

    def parameters(
        self, acceleration_limit: float = ACCELERATION_LIMIT
    ) -> list[ParameterDeclaration]:
        """Return the declarations of the parameters: gains first.

        `acceleration_limit` [m/s²] is the default of that parameter.
        """
        limit = LIMIT._replace(default=acceleration_limit)
        table = [*gain_parameters(self.speed), limit, *_PARAMETERS]
        if self.lane:
            gains = gain_parameters(self.lane.lane)
            table += [gain._replace(name=LANE + gain.name) for gain in gains]
            table += PROFILE
        return table

    def configure(self, values: Mapping[str, Any]) -> None:
        """Set parameters: all of them at first, then those that change."""
        if SPEED.name in values:
            # Only the first call can have a file: `reference` is fixed for a run. So a later
            # `speed_reference` replaces the file.
            file = values.get('reference')
            self._has_file = bool(file)
            self._reference = reference_of(file) if file else None
        self.values.update(values)
        self._held = float(self.values[SPEED.name])
        if self._navigator.track and not self._has_file:
            self._reference = self._profile(self._navigator.track)
        self._pilot.set_gains({name: self.values[name] for name in self._pilot.gains})
        self._pilot.limit(self.values['acceleration_limit'])

    def _profile(self, track: Track) -> Signal | None:
        """Return the fastest speed on the track; None: a limit is 0, which stands for none."""
        speed = self.values[SPEED.name]
        across, along = (self.values[limit.name] for limit in PROFILE)
        if min(speed, across, along) <= 0.0:
            return None
        return speed_profile(track, speed, across, along)

    def hold_speed(self, speed: float) -> None:
        """Hold `speed` [m/s] from now on, unless it is refused."""
        try:
            SPEED.check(speed)
            self.configure({SPEED.name: speed})
        except UserError as error:
            refusal = str(error)
            self._refuse(lambda: refusal)

    def reference(self, t: float, x: float) -> float:
        """Return the speed to hold [m/s] at `t` seconds and `x` metres after the start."""
        return self._reference(t, x) if self._reference else self._held

    def reset(self) -> None:
        """Begin anew."""
        self._pilot.reset()
        self._navigator.reset()
        self._start = None
        self._previous = None
        self.situation: Situation | None = None
        self.command = Command(nan, nan)

    def take_state(self, stamp: int, measured: VehicleState) -> Command | None:
        """Return the answer to the state stamped `stamp` [ns]; None: it is refused."""
        if not abs(measured.v_x) <= _FASTEST:  # NaN, too
            self._refuse(lambda: f'a state whose speed is {measured.v_x} m/s')
            return None
        if self.lane and not _is_near(measured):
            self._refuse(lambda: f'a state at x={measured.x}, y={measured.y}, psi={measured.psi}')
            return None

        dt = FIRST_DT
        if self._start is None or stamp < self._start:
            self._start = stamp
        if self._previous is not None:
            dt = (stamp - self._previous) / NANOSECONDS
            if dt < 0.0:
                back = -dt
                self._warn(lambda: f'time went back by {back:g} s: the controller is reset')
                self._pilot.reset()
                dt = FIRST_DT
        self._previous = stamp

        t = (stamp - self._start) / NANOSECONDS
        self.situation = self._navigator.situation(t, dt, measured, self.reference)
        self.command = self._pilot.command(self.situation)
        return self.command

    @property
    def makes_plans(self) -> bool:
        """Whether `predicted` returns poses."""
        return self._pilot.plan is not None

    def predicted(self) -> Pose:
        """Return the poses of the latest plan, as arrays."""
        assert self._pilot.plan is not None  # noqa: S101 (it makes plans)
        return self._navigator.poses(self._pilot.plan)

    def computed(self) -> dict[str, Any]:
        """Return the fields of the message about the latest command: the reference and the terms.

        The message is a PidState if `is_pid`, else a ControllerState. The reference is NaN for a
        pilot that does not follow it.
        """
        assert self.situation  # noqa: S101 (a state was answered)
        speed = self.situation.measured.v_x
        reference = self.situation.reference if self._pilot.follows_reference else nan
        values: dict[str, Any] = {
            'reference': reference,
            'measurement': speed,
            'error': reference - speed,
            'output': float(self.command.motor),
            'saturated': bool(self.speed.saturated),
        }

        terms = dict(zip(self.speed.terms, map(float, self.speed.values()), strict=True))
        if self.is_pid:
            values |= terms
        else:
            values |= {'names': [*terms], 'values': [*terms.values()]}
        return values


def _name_of(controller: object, types: Mapping[str, type[Any]]) -> str:
    """Return the name of the controller's class in a table; empty: it has none."""
    return next((name for name, kind in types.items() if type(controller) is kind), '')


def _is_near(measured: VehicleState) -> bool:
    """Return whether a pose is within the limit; NaN is not."""
    return abs(measured.x) + abs(measured.y) + abs(measured.psi) <= _FARTHEST


def gain_parameters(pilot: Pilot) -> list[ParameterDeclaration]:
    """Return a parameter for each gain of a pilot, with its present value as the default."""
    return [
        ParameterDeclaration(name, value, f'{gain.meaning} [{gain.unit}]', gain.between)
        for (name, gain), value in zip(pilot.gains.items(), pilot.gain_values.values(), strict=True)
    ]


def _chosen(
    declare: Callable[[list[ParameterDeclaration]], dict[str, Any]],
    parameter: ParameterDeclaration,
    types: Mapping[str, Callable[[], Any]],
) -> Any:  # noqa: ANN401 (of one of the types)
    """Return a new controller of the type that the parameter names."""
    kind = declare([parameter])[parameter.name]
    if kind not in types:
        raise UserError(
            f'parameter {parameter.name} of controller is {kind!r}: expected {" or ".join(types)}'
        )
    return types[kind]()
