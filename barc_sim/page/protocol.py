"""The messages between the live page and its server.

States go to the page in binary messages: rows of little-endian float64, one value per name in
`COLUMNS`, NaN where a value is unknown. All else is JSON with a `type`.
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple, NoReturn

from barc_sim.control.controller import Gain
from barc_sim.control.pid import ACCELERATION_LIMIT, PID, SPEED_REFERENCE
from barc_sim.control.types import GAINS, TERMS
from barc_sim.simulation.log import COMMAND, ENVIRONMENT, PID_STATE, columns_of

#: The topics whose columns a row has as they are.
TOPICS = (ENVIRONMENT, COMMAND, PID_STATE)
#: The terms of controllers other than the PID.
OTHER_TERMS = tuple(name for name in TERMS if name not in PID.terms)
#: A row's values: the true state, where the measurement's error is known, then columns of the log.
COLUMNS = (
    't',  # [s] since the first state
    'x',  # [m] along the road's surface
    'y',  # [m] to the left
    'psi',  # [rad] heading
    'speed',  # [m/s] along the vehicle
    'measured_speed',  # [m/s]
    'absolute_speed',  # [m/s] along and across the vehicle
    'lap',  # number of the lap: each reset and each return to the start begins one
    *(name for topic in TOPICS for name in columns_of(topic).values()),
    *OTHER_TERMS,
)
#: The sliders that every controller has beside its gains.
OTHERS = {
    'speed_reference': Gain(SPEED_REFERENCE, 'm/s', 'speed to hold', 20.0),
    'acceleration_limit': Gain(ACCELERATION_LIMIT, 'm/s²', 'acceleration limit', 20.0),
}
#: The sliders of the car: parameters of the simulator that may be set while it drives.
CAR = {
    'noise_v_x': Gain(0.0, 'm/s', 'noise of the measured speed', 1.0),
    'motor_delay': Gain(0.0, 's', 'delay of the motor', 0.5),
    'motor_limit': Gain(0.0, 'm/s²', 'limit of the motor, 0: none', 20.0),
}
CONTROLLER, SIMULATOR = 'controller', 'vehicle_simulator'
#: The parameters that the page may set, and the node of each.
TUNABLE = dict.fromkeys((*GAINS, *OTHERS), CONTROLLER) | dict.fromkeys(CAR, SIMULATOR)


#: `compare` shows the run before, and `again` drives with the present values: after the end.
BUTTONS = ('reset', 'reset_controller', 'finish', 'compare', 'again')


class RequestError(ValueError):
    """A message that our page does not send."""


class Drive(NamedTuple):
    """Drive as `cmd_vel` does."""

    linear: float = 0.0  #: share of the maximum acceleration, from -1 to 1
    angular: float = 0.0  #: share of the maximum steering rate, from -1 to 1, left is positive
    brake: float = 0.0  #: share of the maximum deceleration, from 0 to 1, down to a standstill


class Tune(NamedTuple):
    """Set a parameter of the controller or the car."""

    name: str
    value: float


class Press(NamedTuple):
    """Press one of `BUTTONS`."""

    button: str


class Pause(NamedTuple):
    """Pause simulated time, or resume it."""

    on: bool


Request = Drive | Tune | Press | Pause


class File(NamedTuple):
    """A file to download."""

    kind: str  #: media type
    name: str
    body: bytes


class Status(NamedTuple):
    """What no topic of a run carries; None where it is unknown."""

    missed: int | None = None  #: commands that missed their deadline
    slipped: int | None = None  #: periods by which time has fallen behind the wall clock
    paused: bool | None = None


def encode(kind: str, **fields: Any) -> str:  # noqa: ANN401 (whatever JSON can hold)
    """Return the message of a type to the page."""
    return json.dumps({'type': kind, **fields}, separators=(',', ':'), allow_nan=False)


def parse(message: str | bytes) -> Request:
    """Return the request in a message of a page."""
    if not isinstance(message, str):
        raise RequestError('a page sends text, not binary data')
    try:
        fields = json.loads(message, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise RequestError(f'not JSON: {error}') from None
    if not isinstance(fields, dict):
        raise RequestError('a JSON object is expected')
    kind = fields.pop('type', None)
    if kind == 'drive' and {'linear', 'angular'} <= set(fields) <= set(Drive._fields):
        drive = Drive(**{name: _number(value, 1.0) for name, value in fields.items()})
        if drive.brake < 0.0:
            raise RequestError('the brake is from 0 to 1')
        return drive
    if kind == 'tune' and set(fields) == {'name', 'value'} and fields['name'] in [*TUNABLE]:
        return Tune(fields['name'], _number(fields['value'], 1e9))
    if kind in [*BUTTONS] and not fields:
        return Press(kind)
    if kind == 'pause' and set(fields) == {'on'} and isinstance(fields['on'], bool):
        return Pause(fields['on'])
    raise RequestError('unknown request')


def _no_number(name: str) -> NoReturn:
    raise ValueError(f'{name} is not a number')


def _number(value: object, limit: float) -> float:
    """Return `value` if it is a number from -limit to limit."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise RequestError('a number is expected')
    if not abs(value) <= limit:  # NaN isn't, either
        raise RequestError(f'a number from {-limit:g} to {limit:g} is expected')
    return float(value)
