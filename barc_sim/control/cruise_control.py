"""Answers each state with a command: what the node `controller` computes, without ROS.

Tables list the controllers of speed and lane by name.
"""

from __future__ import annotations

from math import isfinite, nan
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.control.excitation import PRBS, CoastDown, SineSteer, Steps
from barc_sim.control.lane import LANE, LaneKeeping, LaneLQR, PurePursuit, Stanley, speed_profile
from barc_sim.control.mpc import MPC, SpeedMPC
from barc_sim.control.speed import (
    ACCELERATION_LIMIT,
    FIRST_DT,
    LQR,
    NO_LIMIT,
    PID,
    SPEED_REFERENCE,
    as_controller,
    gain_parameters,
)
from barc_sim.errors import Parameter, UserError
from barc_sim.vehicle.parameters import NANOSECONDS
from barc_sim.vehicle.road import signal

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.control.lane import LaneLaw
    from barc_sim.control.speed import Controller, Gain
    from barc_sim.vehicle.road import Signal
    from barc_sim.vehicle.track import Track

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
#: The gains of all of them, by name.
GAINS: Mapping[str, Gain] = {
    name: gain for controller in TYPES.values() for name, gain in controller.gains.items()
}
#: The terms of all of them, by name.
TERMS: Mapping[str, str] = {
    name: meaning for controller in TYPES.values() for name, meaning in controller.terms.items()
}
_FASTEST = 1e6  #: [m/s] A faster state is refused.
_TYPE = Parameter(
    'controller_type', DEFAULT_TYPE, f'which controller: {", ".join(TYPES)}', read_only=True
)
_LANE_TYPE = Parameter(
    'lane_type', DEFAULT_LANE, f'steering law on a track: {", ".join(LANE_TYPES)}', read_only=True
)
#: Of the speed on a track.
PROFILE = [
    Parameter(
        f'{name}_limit',
        0.0,
        f'maximum {name} acceleration [m/s²] of the speed profile on a track, whose maximum is '
        'speed_reference; 0: no profile',
        (0.0, 100.0),
    )
    for name in ('lateral', 'longitudinal')
]
SPEED = Parameter('speed_reference', SPEED_REFERENCE, 'the speed to hold [m/s]', (-100.0, 100.0))
LIMIT = Parameter(
    'acceleration_limit',
    ACCELERATION_LIMIT,
    'maximum commanded acceleration and deceleration [m/s²]',
    (0.01, NO_LIMIT),
)
_PARAMETERS = [
    SPEED,
    Parameter(
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


class Answer(NamedTuple):
    """The command that a controller computed for a state, with its reference."""

    reference: float  #: [m/s]
    speed: float  #: [m/s] that the controller received
    acceleration: float  #: [m/s²]
    stamp: int  #: [ns] of the state
    steering: float = 0.0  #: [rad]


class CruiseControl:
    """A controller with its parameters; its dt is the difference of the states' stamps.

    On a track `lane` steers.
    """

    def __init__(
        self,
        controller: Controller | None,
        declare: Callable[[list[Parameter]], dict[str, Any]],
        acceleration_limit: float,
        refuse: Warn,
        warn: Warn,
        track: Track | None = None,
        lane: object = None,
    ) -> None:
        """Use `controller`, an object with `acc_calculate`; by default, the parameter chooses it.

        On a `track` it uses `lane`, an object with `steer_calculate`, likewise. `declare` declares
        parameters and returns their values; `acceleration_limit` [m/s²] is a default. `refuse` gets
        the reason why a state or a reference is refused, and `warn` gets other warnings.
        """
        self._refuse, self._warn = refuse, warn
        self.controller = as_controller(controller or _chosen(declare, _TYPE, TYPES))
        self._see = getattr(controller, 'see', None)  # takes its place: of a policy
        self.lane: LaneKeeping | None = None
        if track:
            self.lane = LaneKeeping(lane or _chosen(declare, _LANE_TYPE, LANE_TYPES), track)
        self.is_pid = self.controller.terms.keys() == PID.terms.keys()
        self._previous: int | None = None  # [ns] stamp of the latest state
        self.values: dict[str, Any] = {}  #: the parameters by name
        self._reference: Signal | None = None  # over time and place
        self._start: int | None = None  # [ns] stamp of the first state
        self.configure(declare(self.parameters(acceleration_limit)))
        self.reset()

    def parameters(self, acceleration_limit: float = ACCELERATION_LIMIT) -> list[Parameter]:
        """Return the declarations of the parameters: gains first.

        `acceleration_limit` [m/s²] is the default of that parameter.
        """
        limit = LIMIT._replace(default=acceleration_limit)
        table = [*gain_parameters(self.controller), limit, *_PARAMETERS]
        if self.lane:
            gains = gain_parameters(self.lane.lane) if self.lane.gains else []
            table += [*(each._replace(name=LANE + each.name) for each in gains), *PROFILE]
        return table

    def configure(self, values: Mapping[str, Any]) -> None:
        """Set parameters."""
        if 'speed_reference' in values:
            file = values.get('reference')
            self._has_file = bool(file)
            self._reference = reference_of(file) if file else None
        self.values.update(values)
        if self.lane:
            self.lane.set_gains({name: self.values[LANE + name] for name in self.lane.gains})
            if not self._has_file:
                self._reference = self._profile(self.lane.track)
        controller = self.controller
        for name in controller.gains:
            setattr(controller, name, self.values[name])
        controller.output_max = self.values['acceleration_limit']
        controller.output_min = -controller.output_max

    def _profile(self, track: Track) -> Signal | None:
        speed, *limits = (self.values[each.name] for each in (SPEED, *PROFILE))
        return speed_profile(track, speed, *limits) if min(speed, *limits) > 0.0 else None

    def refer(self, speed: float) -> None:
        """Hold `speed` [m/s] from now on, unless it is refused."""
        try:
            SPEED.check(speed)
            self.configure({SPEED.name: speed})
        except UserError as error:
            why = str(error)
            self._refuse(lambda: why)

    def reference(self, t: float, x: float) -> float:
        """Return the speed to hold [m/s] at `t` seconds and `x` metres after the start."""
        return self._reference(t, x) if self._reference else float(self.values[SPEED.name])

    def reset(self) -> None:
        """Begin anew."""
        self.controller.reset()
        if self.lane:
            self.lane.reset()
        self._start = self._previous = None
        self._answer = Answer(nan, nan, nan, 0)  # the latest

    def take_state(
        self, stamp: int, speed: float, x: float = 0.0, y: float = 0.0, psi: float = 0.0
    ) -> Answer | None:
        """Return the answer to the state stamped `stamp` [ns]; None: it is refused."""
        if not abs(speed) <= _FASTEST:  # NaN, too
            self._refuse(lambda: f'a state whose speed is {speed} m/s')
            return None
        if self.lane and not isfinite(x + y + psi):
            self._refuse(lambda: f'a state at x={x}, y={y}, psi={psi}')
            return None
        dt = FIRST_DT
        if self._start is None or stamp < self._start:
            self._start = stamp
        if self._previous is not None:
            dt = (stamp - self._previous) / NANOSECONDS
            if dt < 0.0:
                back = -dt
                self._warn(lambda: f'time went back by {back:g} s: the controller is reset')
                self.controller.reset()
                dt = FIRST_DT
        self._previous = stamp
        steering = 0.0
        if self.lane:
            steering, x = self.lane.steer(x, y, psi, speed), self.lane.place.s
        reference = self.reference((stamp - self._start) / NANOSECONDS, x)
        if self._see:
            self._see(x)
        acceleration = float(self.controller.acc_calculate(reference, speed, dt))
        if self.lane:
            acceleration = self.lane.acceleration(acceleration)
        self._answer = Answer(reference, speed, acceleration, stamp, steering)
        return self._answer

    def computed(self) -> dict[str, Any]:
        """Return the fields of the message about the latest answer: the reference and the terms.

        The message is a PidState if `is_pid`, else a ControllerState. The reference is NaN for
        commands that a user's function gives, and for a law that plans the speed itself.
        """
        controller, answer = self.controller, self._answer
        holds = getattr(controller, 'holds_speed', not (self.lane and self.lane.plans_speed))
        reference = answer.reference if holds else nan
        terms = {name: float(getattr(controller, name)) for name in controller.terms}
        named = terms if self.is_pid else {'names': [*terms], 'values': [*terms.values()]}
        return {
            'reference': reference,
            'measurement': answer.speed,
            'error': reference - answer.speed,
            'output': answer.acceleration,
            'saturated': bool(controller.saturated),
            **named,
        }


def _chosen(
    declare: Callable[[list[Parameter]], dict[str, Any]],
    parameter: Parameter,
    types: Mapping[str, Callable[[], Any]],
) -> Any:  # noqa: ANN401 (of one of the types)
    """Return a new controller of the type that the parameter names."""
    kind = declare([parameter])[parameter.name]
    if kind not in types:
        raise UserError(
            f'parameter {parameter.name} of controller is {kind!r}: expected {" or ".join(types)}'
        )
    return types[kind]()
