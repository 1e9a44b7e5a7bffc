"""Defines the messages between the live page and its server.

States go to the page in binary messages: rows of little-endian float64, one value per name in
`COLUMNS`, NaN where a value is unknown. All other messages are JSON with a `type`.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cache
from itertools import takewhile
from math import isfinite
from sys import float_info
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

from barc_sim.control.cruise_control import (
    DEFAULT_TYPE,
    LIMIT,
    SPEED,
    TERMS,
)
from barc_sim.control.driver import DriverInput
from barc_sim.control.lane import LANE, LaneLaw
from barc_sim.control.pilots import SpeedPilot
from barc_sim.control.speed import ACCELERATION_LIMIT, PID, Gain, speed_controller
from barc_sim.errors import UserError
from barc_sim.interfaces.nodes import CONTROLLER, SIMULATOR
from barc_sim.interfaces.parameters import ParameterDeclaration
from barc_sim.interfaces.topics import ECU, ENVIRONMENT, LANE_STATE, PID_STATE, TRACK_STATE
from barc_sim.simulation.closed_loop import check_ahead
from barc_sim.simulation.log import columns_of
from barc_sim.simulation.metrics import TrackLap, TrackLaps
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.parameters import ROWS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from barc_sim.control.cruise_control import CruiseControl
    from barc_sim.control.pilots import Pilot
    from barc_sim.simulation.metrics import Lap, Laps
    from barc_sim.vehicle.road import Road
    from barc_sim.vehicle.track import Track

#: The topics whose columns are copied into a row.
TOPICS = (ENVIRONMENT, ECU, TRACK_STATE, LANE_STATE, PID_STATE)
#: The terms of controllers other than the PID.
OTHER_TERMS = tuple(name for name in TERMS if name not in PID.terms)


def _copied_columns() -> Iterator[str]:
    """Yield the names of the values that are copied from messages; `lap` is another one's."""
    for topic in TOPICS:
        for name in columns_of(topic).values():
            yield 'track_lap' if name == 'lap' else name


#: A row's values: the state, true if the measurement error is known, then columns of the log.
COLUMNS = (
    't',  # [s] since the first state
    'x',  # [m] along the road's surface; on a track, on the map
    'y',  # [m] to the left
    'psi',  # [rad] heading
    'speed',  # [m/s] along the vehicle
    'measured_speed',  # [m/s]
    'absolute_speed',  # [m/s] along and across the vehicle
    'lap',  # number of the lap: each reset, return to the start and finish line begins one
    *_copied_columns(),
    *OTHER_TERMS,
)


def _slider(parameter: ParameterDeclaration, meaning: str, maximum: float) -> Gain:
    """Return the slider of a parameter, from 0 to `maximum`; the limits are the parameter's."""
    return Gain(float(parameter.default), parameter.unit, meaning, maximum, parameter.between)


#: Sliders of every controller, in addition to its gains.
SHARED_SLIDERS = {
    'speed_reference': _slider(SPEED, 'speed to hold', 20.0),
    'acceleration_limit': _slider(LIMIT, 'acceleration limit', 20.0),
}
#: The sliders of the car: parameters of the simulator that may be set while it drives.
CAR = {
    'noise_v_x': _slider(ROWS['noise_v_x'], 'noise of the measured speed', 1.0),
    'sensor_delay': _slider(ROWS['sensor_delay'], 'delay of the sensor', 0.5),
    'motor_delay': _slider(ROWS['motor_delay'], 'delay of the motor', 0.5),
    'motor_limit': _slider(ROWS['motor_limit'], 'limit of the motor, 0: none', 20.0),
}
_OF_RUN = ('road', 'distance', 'laps')
#: Short names of the sliders, if they differ from the parameter's.
_SHORT = {
    'speed_reference': 'speed',
    'acceleration_limit': 'limit',
    'noise_v_x': 'noise',
    'motor_delay': 'delay',
    'motor_limit': 'motor limit',
}
_LONGEST_SYMBOL = 8  #: characters; in a longer name, underscores become spaces
_PI = {'kp': 4.0, 'ki': 8.0, 'kd': 0.0}
#: Presets for a PID that also change the car, in addition to the controller's own presets.
_OF_CAR = {
    'Noise': {'kp': 4.0, 'ki': 8.0, 'kd': 2.0, 'noise_v_x': 0.1},
    'Delay': {**_PI, 'kp': 10.0, 'motor_delay': 0.2},
    'Windup': {**_PI, 'acceleration_limit': 100.0, 'motor_limit': 6.0},
}
BUTTONS = ('reset', 'reset_controller', 'finish')


class RequestError(ValueError):
    """A message that the page never sends."""


class Tune(NamedTuple):
    """Set a parameter of the controller or the car; `RunFacts.check` has its limits."""

    name: str
    value: float


class Press(NamedTuple):
    """Press one of `BUTTONS`."""

    button: str


class Pause(NamedTuple):
    """Pause simulated time, or resume it."""

    on: bool


Request = DriverInput | Tune | Press | Pause


class Status(NamedTuple):
    """Status of a run that no topic carries; None if unknown."""

    missed: int | None = None  #: commands that missed their deadline
    paused: bool | None = None


def encode(kind: str, **fields: Any) -> str:  # noqa: ANN401 (any JSON value)
    """Return a JSON message to the page, of the type `kind`."""
    return json.dumps({'type': kind, **fields}, separators=(',', ':'), allow_nan=False)


def parse(message: str | bytes) -> Request:
    """Return the request in a page's message; RequestError: it is malformed."""
    if not isinstance(message, str):
        raise RequestError('a page sends text, not binary data')
    try:
        fields = json.loads(message, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise RequestError(f'not JSON: {error}') from None
    if not isinstance(fields, dict):
        raise RequestError('a JSON object is expected')

    kind = fields.pop('type', None)
    names = set(fields)
    if kind == 'drive' and names == set(DriverInput._fields):
        return _driver_input(fields)
    if kind == 'tune' and names == {'name', 'value'} and isinstance(fields['name'], str):
        return Tune(fields['name'], _number(fields['value'], float_info.max))
    if kind in list(BUTTONS) and not fields:  # a list: `kind` may be of any type
        return Press(kind)
    if kind == 'pause' and names == {'on'} and isinstance(fields['on'], bool):
        return Pause(fields['on'])
    raise RequestError('unknown request')


def _driver_input(fields: Mapping[str, object]) -> DriverInput:
    values = {name: _number(value, 1.0) for name, value in fields.items()}
    request = DriverInput(**values)
    if request.brake < 0.0:
        raise RequestError('the brake is from 0 to 1')
    return request


def _no_number(name: str) -> NoReturn:
    raise ValueError(f'{name} is not a number')


def _number(value: object, limit: float) -> float:
    """Return `value` if it is a number from -limit to limit."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise RequestError('a number is expected')
    if not abs(value) <= limit:  # NaN isn't, either
        raise RequestError(f'a number from {-limit:g} to {limit:g} is expected')
    return float(value)


class RunFacts(NamedTuple):
    """Facts of a run that the page shows and no topic has: the present settings of its nodes."""

    simulator: Callable[[], Mapping[str, Any]] = dict  #: parameters of `vehicle_simulator`
    control: CruiseControl | None = None  #: of the node `controller`
    road: Road | None = None
    track: Track | None = None
    status: Callable[[], Status] = Status
    finish: Callable[[], None] | None = None  #: ends the run
    options: Mapping[str, str] = {}  #: more options of the run, for the command to copy

    @property
    def gains(self) -> dict[str, Gain]:
        """The gains by parameter: of the lane controller on a track, else of the controller."""
        if not self.track:
            return dict(self.speed.gains)
        if not self.control or not self.control.lane:
            return {}
        lane = self.control.lane.lane
        return {LANE + name: gain for name, gain in lane.gains.items()}

    @property
    def speed(self) -> Pilot:
        """The pilot of the speed; without a controller, one of the run's PID."""
        return self.control.speed if self.control else SpeedPilot(speed_controller())

    @property
    def sliders(self) -> dict[str, Gain]:
        """The sliders by parameter; none for an identification drive, which holds no speed."""
        if not self.speed.follows_reference:
            return {}
        if self.track:
            return {**self.gains, 'speed_reference': SHARED_SLIDERS['speed_reference']}
        return {**self.gains, **SHARED_SLIDERS, **CAR}

    @property
    def distance(self) -> float:
        """The distance of a lap, on a track of the run [m]; 0: none."""
        if self.track:
            return float(self.simulator().get('laps', 0) * self.track.length)
        return float(self.simulator().get('distance', 0.0))

    def limits(self, name: str) -> tuple[float, float]:
        """Return what a slider's parameter can be, ends included."""
        low, high = self.sliders[name].between
        if name == SPEED.name and self.distance:
            low = 0.0
        return low, high

    def check(self, name: str, value: float) -> None:
        """Raise UserError, as the command line does, if a slider's parameter cannot be `value`."""
        slider = self.sliders.get(name)
        if not slider:
            raise UserError(f'{name}: this page has no such slider')
        ParameterDeclaration(name, slider.default, slider.meaning, slider.between).check(value)
        if name == SPEED.name:
            check_ahead(value, self.distance)

    @property
    def values(self) -> dict[str, Any]:
        """The present values of the sliders, if known."""
        values = dict(self.simulator())
        if self.control:
            values.update(self.control.values)
        return {name: values[name] for name in self.sliders if name in values}


def facts(mode: str, run: RunFacts) -> dict[str, Any]:
    """Return the fields of the message `hello`.

    Parameters
    ----------
    mode
        `acc` or `teleop`.
    run
        The facts of the run; unknown parameters are left out.
    """
    pilot = run.speed
    simulator = run.simulator()
    car = Vehicle()
    controller_type = run.control.controller_type if run.control else ''

    fields = {
        'mode': mode,
        'columns': COLUMNS,
        'road': run.road and road_facts(run.road),
        'axles': [-simulator.get('l_r', car.l_r), simulator.get('l_f', car.l_f)],
        'mass': simulator.get('mass', car.mass),
        'terms': list(pilot.terms),
        'sliders': {name: _slider_facts(run, name) for name in run.sliders},
        'presets': _presets(pilot),
        'controller_type': controller_type or DEFAULT_TYPE,
        'tuning': run.values,
        'run': {**_run_options(run), **run.options},
        'can_finish': run.finish is not None,
    }

    if run.track:
        fields |= track_facts(run.track)
    return fields


def _slider_facts(run: RunFacts, name: str) -> dict[str, Any]:
    gain = run.sliders[name]
    low, high = run.limits(name)

    return {
        'label': _label(name, gain),
        'short': _short(name),
        'unit': '' if gain.unit == '-' else gain.unit,
        'max': gain.slider,
        'limits': (low, high),
        'expected': f'a number from {low:g} to {high:g}',
        'node': node_of(name),
    }


def _run_options(run: RunFacts) -> dict[str, Any]:
    """Return what the page shows of the run's options."""
    simulator = run.simulator()
    if run.track:
        lane_type = run.control.lane_type if run.control else ''
        return {'track': run.track.name, 'lane': lane_type, 'laps': simulator.get('laps', 1)}
    return {name: simulator[name] for name in _OF_RUN if name in simulator}


def node_of(parameter: str) -> str:
    """Return the name of the node that has a slider's parameter."""
    return SIMULATOR if parameter in CAR else CONTROLLER


@cache
def track_facts(track: Track) -> dict[str, Any]:
    """Return the fields that a page of a track has, with the centre line."""
    s = track.samples()
    columns: dict[str, Any] = {'s': s, **track.place(s)._asdict(), 'curvature': track.curvature(s)}
    points = {name: column.round(6).tolist() for name, column in columns.items()}

    return {
        'mode': 'track',
        'track': {**points, 'length': track.length, 'width': track.width},
        'terms': [f'steer_{name}' for name in LaneLaw.terms],
        'presets': {},
    }


def _presets(pilot: Pilot) -> dict[str, dict[str, float]]:
    """Return the values of each preset, for all sliders except the speed reference."""
    presets = dict(pilot.presets)
    if presets:
        presets |= _OF_CAR
    defaults = {'acceleration_limit': ACCELERATION_LIMIT, **dict.fromkeys(CAR, 0.0)}
    return {name: {**defaults, **gains} for name, gains in presets.items()}


def _short(name: str) -> str:
    """Return a slider's short name; a short lane gain, such as `q_e_y`, keeps its name."""
    gain = name.removeprefix(LANE)
    is_symbol = gain != name and len(gain) <= _LONGEST_SYMBOL
    default = gain if is_symbol else gain.replace('_', ' ')
    return _SHORT.get(name, default)


def _label(name: str, gain: Gain) -> str:
    """Return a slider's label, such as `Proportional gain, kp [1/s]`."""
    unit = '' if gain.unit == '-' else f' [{gain.unit}]'
    symbol = '' if name in SHARED_SLIDERS or name in CAR else f', {name.removeprefix(LANE)}'
    return f'{gain.meaning.capitalize()}{symbol}{unit}'


def road_facts(road: Road) -> dict[str, list[float]]:
    """Return the starts [m] and the grades [deg] of the road's stretches."""
    return {'starts': list(road.starts), 'grades_deg': list(road.grades_deg)}


def lap_facts(
    laps: Laps | TrackLaps, settings: Callable[[int], str] = lambda _: '', first: int = 0
) -> dict[str, Any]:
    """Return the present lap, the last one, the best one, and the number of laps.

    On a track, only finished laps are counted, and a table of laps is added.

    Parameters
    ----------
    laps
        The laps of the run so far.
    settings
        Returns the gains of a lap in words, by its number.
    first
        The number of the first lap to list in `finished`, which has those that have ended.
    """

    def fields(lap: Lap | TrackLap | None) -> dict[str, Any] | None:
        if lap is None:
            return None
        return {**_lap(lap), 'gains': settings(lap.number)}

    finished: Sequence[Lap | TrackLap] = laps.finished
    new = takewhile(lambda lap: lap.number >= first, reversed(finished))
    facts: dict[str, Any] = {
        'current': fields(laps.current),
        'last': fields(finished[-1] if finished else None),
        'best': fields(laps.best),
        'finished': [fields(lap) for lap in new],
    }
    if isinstance(laps, TrackLaps):
        facts['count'] = len(finished)
        facts['table'] = [fields(lap) for lap in laps.rows]
    else:
        facts['count'] = laps.current.number + 1
    return facts


def stretch_facts(lap: Lap) -> list[dict[str, Any]]:
    """Return the results of each stretch of a lap, for a table."""
    return [_finite(asdict(stretch)) for stretch in lap.summary.stretches]


def _lap(lap: Lap | TrackLap) -> dict[str, Any]:
    if isinstance(lap, TrackLap):
        return {**_finite(lap._asdict()), 'time': lap.time if lap.is_finished else None}

    summary = lap.summary
    return _finite(
        {
            'number': lap.number,
            'start': lap.start,
            'end': lap.end,
            'rms': summary.rms_error_after_run_up,
            'maximum': summary.max_error_after_run_up,
            'overshoot': summary.overshoot,
            'settling': summary.settling_time,
        }
    )


def _finite(fields: dict[str, Any]) -> dict[str, Any]:
    """Return the fields with None in place of NaN and infinity."""
    return {name: value if isfinite(value) else None for name, value in fields.items()}
