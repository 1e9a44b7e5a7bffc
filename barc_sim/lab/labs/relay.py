"""Judges a relay by its commands while a driver presses and releases each key."""

from __future__ import annotations

from math import degrees, inf, radians
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.control.driver import RATE, STALE_AFTER
from barc_sim.lab.files import ErrorKind, UserCodeError
from barc_sim.lab.judge import Finding
from barc_sim.lab.user_code.folder import TimedCommand, TimedTwist
from barc_sim.simulation.stepper import StepperOptions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from barc_sim.lab.confined.process import JudgedCode


LABELS = {
    'relay.forward': 'Relay: up and down',
    'relay.steering': 'Relay: left and right',
    'relay.units': 'Relay: m/s² and radians',
    'relay.release': 'Relay: a released key',
    'relay.rate': 'Relay: commands a second',
}
# A drive [s]: a key is pressed, then released.
_PRESS = 1.0
_RELEASE = 3.0
_END = 5.0
_PERIOD = 0.05  #: [s] between the Twists of a held key
_AFTER_PRESS = 2.9  #: [s] 1.9 s after the press, enough to turn the wheels
_AFTER_RELEASE = 4.9  #: [s] 1.9 s after the release
_NEGLIGIBLE = {'motor': 0.05, 'servo': 0.005}  #: [m/s²] and [rad]
_TOLERANCE = 1e-6
# A rate between these gets full marks.
_MIN_RATE = 10.0  #: [Hz]
_MAX_RATE = 200.0  #: [Hz]


#: By key: linear.x and angular.z of its Twist; their sum is the right sign of its command.
_KEYS = {'up': (1.0, 0.0), 'down': (-1.0, 0.0), 'left': (0.0, 1.0), 'right': (0.0, -1.0)}
_NOTHING = TimedCommand(0.0, 0.0, 0.0)


def relay_commands(
    code: JudgedCode, twists: Sequence[TimedTwist], duration: float
) -> list[TimedCommand]:
    """Return the commands of a new relay from 0 to `duration` [s], while it gets `twists`."""
    reply = code.call('relay_commands', twists, duration, _relay_calls(twists, duration))
    return [TimedCommand(*row) for row in reply]


def _relay_calls(twists: Sequence[TimedTwist], duration: float) -> list[TimedTwist]:
    """Return the calls of a function `relay`, as the relay node makes them.

    After a Twist that is too old, the node passes zeros.
    """
    nothing = TimedTwist(-inf, 0.0, 0.0)
    calls = []
    for k in range(round(duration * RATE)):
        t = k * (1.0 / RATE)
        latest = max((each for each in twists if each.t <= t + 1e-9), default=nothing)
        twist = latest if t - latest.t <= STALE_AFTER else nothing
        calls.append(twist._replace(t=t))
    return calls


def judge_relay(code: JudgedCode) -> list[Finding]:
    """Return a finding for each criterion `relay.…`.

    All are skipped where `relay.py` is still the template's, because the relay is optional in the
    usual rubric, and `barc new` writes a `relay.py` for everybody. Model and controller are not
    optional: their templates get 0 points.
    """
    try:
        drives = {key: relay_commands(code, _twists(*twist), _END) for key, twist in _KEYS.items()}
    except UserCodeError as error:
        if error.kind is not ErrorKind.NOT_WRITTEN:
            raise
        return [Finding(name, 0.0, str(error), skipped=True) for name in LABELS]

    commands = {key: _at(drive, _AFTER_PRESS) for key, drive in drives.items()}
    verdicts = {
        'relay.forward': _direction('motor', ('up', 'down'), _FORWARD, commands),
        'relay.steering': _direction('servo', ('left', 'right'), _STEERING, commands),
        'relay.units': _bounded(drives),
        'relay.release': _release(drives),
        'relay.rate': _rate(drives['up']),
    }
    return [Finding(name, *verdict) for name, verdict in verdicts.items()]


def _twists(linear_x: float, angular_z: float) -> list[TimedTwist]:
    """Return the Twists of a key that is pressed and held, and the zero of its release."""
    count = round((_RELEASE - _PRESS) / _PERIOD)
    twists = [TimedTwist(_PRESS + k * _PERIOD, linear_x, angular_z) for k in range(count)]
    return [*twists, TimedTwist(_RELEASE, 0.0, 0.0)]


def _at(commands: Sequence[TimedCommand], t: float) -> TimedCommand:
    """Return the command that holds at `t` [s]."""
    return next((each for each in reversed(commands) if each.t <= t), _NOTHING)


class _Sentences(NamedTuple):
    """The messages on two keys."""

    wrong_sign: str
    no_effect: str
    effect_on_other: str
    right: str


_FORWARD = _Sentences(
    wrong_sign='{key} commands motor {value:+.3g} m/s²: the sign is wrong',
    no_effect='{key} does not change motor: the key arrives as linear.x',
    effect_on_other='{key} turns the wheels, too, by {other:+.3g} rad',
    right='up commands {:+.3g} m/s², down {:+.3g} m/s²',
)
_STEERING = _Sentences(
    wrong_sign='{key} commands servo {value:+.3g} rad: left is positive',
    no_effect='{key} does not turn the wheels: the key arrives as angular.z',
    effect_on_other='{key} changes motor, too, to {other:+.3g} m/s²',
    right='left turns the wheels by {:+.3g} rad, right by {:+.3g} rad',
)


def _direction(
    field: str, keys: Sequence[str], sentences: _Sentences, commands: Mapping[str, TimedCommand]
) -> tuple[float, str]:
    """Judge whether two keys change a field of `TimedCommand`, and only this one."""
    other_field = 'servo' if field == 'motor' else 'motor'
    score = 0.0
    faults = []
    values = []
    for key in keys:
        value = getattr(commands[key], field)
        other = getattr(commands[key], other_field)
        changes_other = abs(other) > _NEGLIGIBLE[other_field]
        values.append(value)

        if value * sum(_KEYS[key]) < -_NEGLIGIBLE[field]:
            faults.append(sentences.wrong_sign.format(key=key, value=value))
        elif abs(value) <= _NEGLIGIBLE[field]:
            fault = sentences.no_effect.format(key=key)
            if changes_other:
                fault += ', and the order is [motor, servo]'
            faults.append(fault)
        elif changes_other:
            score += 0.25
            faults.append(sentences.effect_on_other.format(key=key, other=other))
        else:
            score += 0.5
    return score, '; '.join(faults) or sentences.right.format(*values)


#: The maximum servo [rad] and motor [m/s²]; a larger value is probably in other units.
_BOUNDS = {'servo': 0.8, 'motor': StepperOptions().refuse_motor_above}
_BEYOND = {
    'servo': 'servo reaches {0:.3g} rad, which is {2:.0f}°: the wheels of a car turn by about 0.5 '
    'rad. Is it in degrees ({0:.3g}° are {3:.3g} rad), or does it grow without a limit?',
    'motor': 'motor reaches {0:.3g} m/s²: the simulator refuses more than {1:g}',
}


def _bounded(drives: Mapping[str, Sequence[TimedCommand]]) -> tuple[float, str]:
    """Judge the maximum sizes of the commands, of either sign."""
    maxima = {}
    faults = []
    for field, bound in _BOUNDS.items():
        values = [abs(getattr(each, field)) for drive in drives.values() for each in drive]
        value = max(values, default=0.0)
        maxima[field] = value
        if value > bound + _TOLERANCE:
            faults.append(_BEYOND[field].format(value, bound, degrees(value), radians(value)))
    right = 'motor up to {motor:.3g} m/s², servo up to {servo:.3g} rad'
    return 1.0 - bool(faults), '; '.join(faults) or right.format(**maxima)


def _release(drives: Mapping[str, Sequence[TimedCommand]]) -> tuple[float, str]:
    """Judge the commands before a key is pressed, and after it is released."""
    faults = []
    first = _at(drives['up'], _PRESS - _PERIOD)
    if abs(first.motor) > _NEGLIGIBLE['motor'] or abs(first.servo) > _NEGLIGIBLE['servo']:
        faults.append(
            f'without a key it commands {first.motor:+.3g} m/s² and {first.servo:+.3g} rad'
        )
    for key in ('up', 'down'):
        motor = _at(drives[key], _AFTER_RELEASE).motor
        if motor * sum(_KEYS[key]) > _NEGLIGIBLE['motor']:
            faults.append(f'after the release of {key} motor is still {motor:+.3g} m/s²')
    for key in ('left', 'right'):
        at_release = abs(_at(drives[key], _RELEASE).servo)
        later = abs(_at(drives[key], _AFTER_RELEASE).servo)
        if later > at_release + _NEGLIGIBLE['servo']:
            faults.append(f'after the release of {key} the wheels turn further')

    right = 'after the release of a key the motor stops, and the wheels turn no further'
    checks = 1 + len(drives)
    return 1.0 - len(faults) / checks, '; '.join(faults) or right


def _rate(commands: Sequence[TimedCommand]) -> tuple[float, str]:
    """Judge the number of commands a second while a key is held."""
    count = sum(_PRESS <= each.t < _RELEASE for each in commands)
    rate = count / (_RELEASE - _PRESS)
    text = f'{rate:.0f} commands a second while a key is held'
    if rate > _MAX_RATE:
        return 0.5, f'{text}: is the sleep of its loop missing? 20 are enough'
    if rate < _MIN_RATE - _TOLERANCE:
        return rate / _MIN_RATE, f'{text}: the lab asks for one every 0.05 s, 20 a second'
    return 1.0, text
