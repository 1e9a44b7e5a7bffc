"""Judges a relay: what it commands for each key, after a release, and after silence."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import degrees, radians
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.errors import UserError
from barc_sim.lab.check.code import Finding
from barc_sim.lab.user_code.folder import BY_EYE, NOT_WRITTEN, Command, TimedTwist
from barc_sim.vehicle.parameters import PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from barc_sim.lab.hills.code import HillsCode

LABELS = {
    'relay.forward': 'Relay: up and down',
    'relay.steering': 'Relay: left and right',
    'relay.units': 'Relay: m/s² and radians',
    'relay.release': 'Relay: a released key',
    'relay.rate': 'Relay: commands a second',
    'relay.silence': 'Relay: no driver',
}
_PRESSED, _RELEASED, _END = 1.0, 3.0, 5.0  #: [s]
_PERIOD = 0.05  #: [s] between the Twists of a held key
_HELD = 2.9  #: [s] The relay has had 1.9 s to turn the wheels.
_LATER = 4.9  #: [s] 1.9 s after the release, or after the last Twist
_LAST = 4.0  #: [s] Commands after this time follow a silence of 1 s.
_NEGLIGIBLE = {'motor': 0.05, 'servo': 0.005}  #: [m/s²] and [rad]
_TOLERANCE = 1e-6
_PRESSES = 4  #: of a key that a program reads itself, from 1 to 3 s
_SLOW, _FAST = 10.0, 200.0  #: [Hz] A rate between these is full marks.
_PARAMETERS = {each.name: float(each.default) for each in PARAMETERS if 'refuse' in each.name}


class _Key(NamedTuple):
    """A key, and its Twist."""

    name: str
    linear_x: float
    angular_z: float

    @property
    def sign(self) -> float:
        """The sign that its command has."""
        return self.linear_x + self.angular_z


_UP, _DOWN = _Key('up', 1.0, 0.0), _Key('down', -1.0, 0.0)
_LEFT, _RIGHT = _Key('left', 0.0, 1.0), _Key('right', 0.0, -1.0)
_NOTHING = Command(0.0, 0.0, 0.0)
Drives = dict[_Key, list[Command]]
_Held = dict[_Key, dict[str, Command]]  # the command of each key, by the field that is judged


def judge_relay(code: HillsCode) -> list[Finding]:
    """Return a finding for each criterion `relay.…`; all are skipped if it is not written yet.

    What cannot be judged here, of a program that reads the terminal, is open.
    """
    try:
        drives = {
            key: code.relay_commands(_twists(key), _END) for key in (_UP, _DOWN, _LEFT, _RIGHT)
        }
        silent = code.relay_commands(_twists(_UP, released=False), _END)
    except UserError as error:
        text = str(error)
        skipped, is_open = NOT_WRITTEN in text, BY_EYE in text
        return [Finding(name, 0.0, text, skipped=skipped, open=is_open) for name in LABELS]
    has_keys = bool(code.relay_keys())
    held = {
        key: {field: _held(drives[key], field, has_keys) for field in _NEGLIGIBLE} for key in drives
    }
    judges: Mapping[str, Callable[[], tuple[float, str]]] = {
        'relay.forward': partial(_direction, 'motor', (_UP, _DOWN), _FORWARD, held),
        'relay.steering': partial(_direction, 'servo', (_LEFT, _RIGHT), _STEERING, held),
        'relay.units': partial(_bounded, drives),
        'relay.release': partial(_release, drives),
        'relay.rate': partial(_rate, drives[_UP], has_keys),
        'relay.silence': partial(_silence, silent),
    }
    findings = [Finding(name, *judges[name]()) for name in LABELS]
    return [_without_release(each) if has_keys else each for each in findings]


def _without_release(finding: Finding) -> Finding:
    """Leave open what a program of a terminal cannot know: a terminal sends no release."""
    if finding.passed or finding.criterion not in ('relay.release', 'relay.silence'):
        return finding
    message = f'{finding.message}; a terminal sends no release: {BY_EYE}'
    return replace(finding, score=0.0, message=message, open=True)


def _held(commands: Sequence[Command], field: str, has_keys: bool) -> Command:
    """Return the command of a held key; of one that is pressed some times, the largest."""
    if not has_keys:
        return _at(commands, _HELD)
    while_held = [each for each in commands if _PRESSED <= each.t < _RELEASED]
    return max(while_held, key=lambda each: abs(getattr(each, field)), default=_NOTHING)


def _twists(key: _Key, *, released: bool = True) -> list[TimedTwist]:
    """Return the Twists of a key that is held, with the zero of its release."""
    count = round((_RELEASED - _PRESSED) / _PERIOD)
    twists = [TimedTwist(_PRESSED + k * _PERIOD, key.linear_x, key.angular_z) for k in range(count)]
    return twists + ([TimedTwist(_RELEASED, 0.0, 0.0)] if released else [])


def _at(commands: Sequence[Command], t: float) -> Command:
    """Return the command that holds at `t` [s]."""
    return next((each for each in reversed(commands) if each.t <= t), _NOTHING)


#: Sentences: the wrong sign, no effect, an effect on the other value, too, and all right.
_FORWARD = (
    '{name} commands a motor of {value:+.3g} m/s²: the sign is wrong',
    '{name} does not change the motor: it comes as linear.x',
    '{name} turns the wheels, too, by {other:+.3g} rad',
    'up commands {:+.3g} m/s², down {:+.3g} m/s²',
)
_STEERING = (
    '{name} commands a servo of {value:+.3g} rad: left is positive',
    '{name} does not turn the wheels: it comes as angular.z',
    '{name} changes the motor, too, to {other:+.3g} m/s²',
    'left turns the wheels by {:+.3g} rad, right {:+.3g}',
)


def _direction(
    field: str, keys: tuple[_Key, _Key], sentences: tuple[str, ...], commands: _Held
) -> tuple[float, str]:
    """Judge what two keys do to a field of `Command`, and not to the other."""
    faults, score, values = [], 0.0, []
    for key in keys:
        held = commands[key][field]._asdict()
        value, (other,) = held[field], _NEGLIGIBLE.keys() - {field}
        values.append(value)
        if value * key.sign < -_NEGLIGIBLE[field]:
            fault = 0
        elif abs(value) <= _NEGLIGIBLE[field]:
            fault = 1
        elif abs(held[other]) > _NEGLIGIBLE[other]:
            fault, score = 2, score + 0.25
        else:
            score += 0.5
            continue
        faults.append(sentences[fault].format(name=key.name, value=value, other=held[other]))
    return score, '; '.join(faults) or sentences[3].format(*values)


#: The maximum motor [m/s²] and servo [rad]; beyond is what is in other units.
_BOUNDS = {'servo': 0.8, 'motor': _PARAMETERS['refuse_motor_above']}
_BEYOND = {
    'servo': 'servo reaches {0:.3g} rad, which is {2:.0f}°: the wheels of a car turn by about 0.5 '
    'rad. Is it in degrees ({0:.3g}° are {3:.3g} rad), or does it grow without a limit?',
    'motor': 'motor reaches {0:.3g} m/s²: the simulator refuses more than {1:g}',
}


def _bounded(drives: Drives) -> tuple[float, str]:
    """Judge the maximum values of the commands, either way."""
    faults, reached = [], {}
    for field, bound in _BOUNDS.items():
        values = [abs(getattr(each, field)) for drive in drives.values() for each in drive]
        value = reached[field] = max(values, default=0.0)
        if value > bound + _TOLERANCE:
            faults.append(_BEYOND[field].format(value, bound, degrees(value), radians(value)))
    right = 'motor up to {motor:.3g} m/s², servo up to {servo:.3g} rad'
    return 1.0 - bool(faults), '; '.join(faults) or right.format(**reached)


def _release(drives: Drives) -> tuple[float, str]:
    faults = []
    _, motor, servo = _at(drives[_UP], _PRESSED - _PERIOD)
    if abs(motor) > _NEGLIGIBLE['motor'] or abs(servo) > _NEGLIGIBLE['servo']:
        faults.append(f'without a key it commands {motor:+.3g} m/s² and {servo:+.3g} rad')
    for key in (_UP, _DOWN):
        later = _at(drives[key], _LATER).motor
        if later * key.sign > _NEGLIGIBLE['motor']:
            faults.append(f'after the release of {key.name} it goes on with {later:+.3g} m/s²')
    for key in (_LEFT, _RIGHT):
        released, later = (abs(_at(drives[key], t).servo) for t in (_RELEASED, _LATER))
        if later > released + _NEGLIGIBLE['servo']:
            faults.append(f'after the release of {key.name} the wheels go on turning')
    right = 'a released key neither drives on nor turns the wheels further'
    checks = 1 + len(drives)
    return 1.0 - len(faults) / checks, '; '.join(faults) or right


def _silence(commands: Sequence[Command]) -> tuple[float, str]:
    _, motor, _ = _at(commands, _LATER)
    if commands[-1].t < _LAST:
        return 1.0, 'in silence it commands nothing, and the simulator brakes after 0.5 s'
    if motor > _NEGLIGIBLE['motor']:
        return 0.0, (
            f'{_LATER - _RELEASED:.1f} s after the last Twist it still commands {motor:+.3g} m/s²: '
            'a car whose driver is gone drives on. Keep the time of the last Twist'
        )
    return 1.0, 'after silence it does not drive on'


def _rate(commands: Sequence[Command], has_keys: bool) -> tuple[float, str]:
    count = sum(_PRESSED <= each.t < _RELEASED for each in commands)
    rate = count / (_RELEASED - _PRESSED)
    text = f'{rate:.0f} commands a second while a key is held'
    if rate > _FAST:
        return 0.5, f'{text}: is the sleep of its loop missing? 20 are enough'
    if has_keys and rate < _SLOW and count >= _PRESSES:
        return 1.0, 'a command at each key; a held key repeats about 30 times a second'
    if rate < _SLOW - _TOLERANCE:
        return rate / _SLOW, f'{text}: the lab has dt = 0.05 s, 20 a second'
    return 1.0, text
