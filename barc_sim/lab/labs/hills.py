"""The lab of the hills: a model, a PID and a relay; `bikeFE` and the relay are judged here.

No state of the model passes through zero speed within a step: sensible models differ there.
barc_sim's holds the car at a standstill; the lab's equation does not.
"""

from __future__ import annotations

from functools import partial
from math import degrees, radians
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab import handout
from barc_sim.lab.judge import Finding, Lab, Part
from barc_sim.lab.labs.pid import LABELS, TS, HillsCode, judge_pid
from barc_sim.lab.laws import Judge, close, read, run
from barc_sim.lab.user_code.folder import BY_EYE, NOT_WRITTEN, Command, TimedTwist
from barc_sim.vehicle.bike_model import GRAVITY, L_F, L_R, Vehicle
from barc_sim.vehicle.parameters import PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from barc_sim.lab.laws import Index, Inputs, Situation, Trial, Verdict


EQUATIONS = ('x_next', 'y_next', 'psi_next', 'v_next')  #: in the order of what bikeFE returns
MODEL_LABELS = {
    'model.x': 'Model: position x',
    'model.y': 'Model: position y',
    'model.psi': 'Model: heading \N{GREEK SMALL LETTER PSI}',
    'model.v': 'Model: speed v',
    'model.reverse': 'Model: in reverse',
    'model.general': 'Model: another car',
}
_LAB = Vehicle()
BIKE = read(
    Path(__file__).with_name('bike.txt'),
    GRAVITY=GRAVITY,
    MASS=_LAB.mass,
    DRAG=_LAB.air_drag_coeff,
    FRICTION=_LAB.friction,
    TS=TS,
    L_F=L_F,
    L_R=L_R,
)
ROAD, REVERSE, GENERAL, LENGTHS = BIKE.situations.values()
*ARGUMENTS, _, _ = ROAD[0].values  #: of bikeFE
_MIN_LOSS = 0.1  #: of an equation's points
_STATES = 250  #: of each situation


@np.errstate(all='ignore')
def judge_model(
    code: HillsCode, seed: int, criteria: Collection[str] = tuple(MODEL_LABELS)
) -> list[Finding]:
    """Return a finding for each of the four equations on the lab's road, and those beyond it."""
    road = _run(code, seed, ROAD)
    if random := _randomness(code, road):
        return [Finding(name, 0.0, random) for name in MODEL_LABELS]
    judge = Judge(BIKE, close, _call, partial(_line, code), _MIN_LOSS)
    verdicts = judge.judge(road, EQUATIONS)
    elsewhere, hidden = _hidden(judge, road, *_run(code, seed, LENGTHS))
    findings = []
    for criterion, (name, verdict) in zip(MODEL_LABELS, verdicts.items(), strict=False):
        message = verdict.message or _right(road)
        if name in hidden:
            message += f' of a car with l_f = l_r; of another one not: {hidden[name]}'
        findings.append(Finding(criterion, verdict.score, message))
    for criterion, situations in {'model.reverse': REVERSE, 'model.general': GENERAL}.items():
        if criterion in criteria:
            trials = _run(code, seed, situations)
            trials += elsewhere if situations is GENERAL else []
            findings.append(Finding(criterion, *_beyond(judge, road, verdicts, trials)))
    return findings


def _run(code: HillsCode, seed: int, situations: Sequence[Situation]) -> list[Trial]:
    """Call `bikeFE` in all of the `situations`."""
    return run(
        lambda inputs: code.bike_fe(*_arguments(inputs)), EQUATIONS, situations, seed, _STATES
    )


def _arguments(inputs: Inputs, part: slice = slice(None)) -> tuple[list[list[float]], float, float]:
    """Return the arguments of calls, and the lengths."""
    rows: list[list[float]] = np.array([inputs[name][part] for name in ARGUMENTS]).T.tolist()
    return rows, float(inputs['l_f'][0]), float(inputs['l_r'][0])


def _hidden(
    judge: Judge, road: Sequence[Trial], trial: Trial
) -> tuple[list[Trial], dict[str, str]]:
    """Return the trial at other axle distances, and the mistakes that show only there.

    Other differences there are no mistake: a file may have 0.5 in place of l_r / (l_f + l_r).
    """
    wrong = [name for name in trial.tests if not judge.is_right(trial, name)]
    if trial.failure or any(judge.loss(road, name) for name in trial.tests):
        return [], {}
    causes = judge.causes([trial], wrong, road)
    named = {n: cause for n, cause in causes.items() if cause.formulas and not cause.is_general}
    others = {name: BIKE.right(trial.inputs, name)[0] for name in EQUATIONS if name not in named}
    texts = {name: judge.placed([trial], name, cause) for name, cause in named.items()}
    return [trial._replace(got={**trial.got, **others})], texts


def _beyond(
    judge: Judge, road: Sequence[Trial], verdicts: Mapping[str, Verdict], trials: Sequence[Trial]
) -> tuple[float, str]:
    """Judge the equations in states that the lab's road has not.

    What follows from a mistake on the road is not taken off again.
    """
    scores: list[float] = []
    wrong: list[str] = []
    for name, verdict in verdicts.items():
        score = 1.0 if verdict.is_named and verdict.score else verdict.score
        if score == 1.0 == verdict.score and (loss := judge.loss(trials, name)):
            score, wrong = 1.0 - loss, [*wrong, name]
        scores.append(score)
    message = _right(trials)
    if wrong:
        # A cause must explain the results on the lab's road, too.
        message = judge.placed(trials, wrong[0], judge.causes(trials, wrong[:1], road)[wrong[0]])
    elif any(verdict.score < 1.0 for verdict in verdicts.values()):
        message = 'no mistake but those above'
    return float(np.mean(scores)), message


def _right(trials: Sequence[Trial]) -> str:
    return f'right in all {len(trials) * _STATES:,} states'


def _line(code: HillsCode, trial: Trial, name: str, index: Index, wrong: list[float]) -> str:
    (k,) = index
    values = {key: float(each[k]) for key, each in trial.known.items()}
    if name == 'v_next':  # the force that follows from it
        rate = (values['got_v_next'] - values['v']) / values['ts']
        wrong = [*wrong, values['m'] * (rate - values['a'])]
    right = [float(BIKE.right(trial.inputs, each)[0][k]) for each in EQUATIONS]
    request = code.request(*_arguments(trial.inputs, slice(k, k + 1)))
    return code.line_of('functions', request, wrong, right)


def _call(trial: Trial, index: Index) -> str:
    values = (f'{name}={trial.inputs[name][index]:.6g}' for name in ARGUMENTS)
    return f'bikeFE({", ".join(values)})'


def _randomness(code: HillsCode, trials: Sequence[Trial]) -> str:
    """Return a message if the same arguments give different results, else an empty string."""
    trial = next((trial for trial in trials if not trial.failure), None)
    if trial is None:
        return ''
    try:
        again = np.array(code.bike_fe(*_arguments(trial.inputs))).T
    except UserError as error:
        return f'a second call with the same arguments fails: {error}'
    before = np.array([*trial.got.values()])
    differing = np.flatnonzero(np.any(before != again, axis=0))
    if not differing.size:
        return ''
    k = int(differing[0])
    first, then = (', '.join(f'{x:.9g}' for x in each[:, k]) for each in (before, again))
    return (
        'the same arguments give different results: does bikeFE use random numbers or change a '
        f'global variable? {_call(trial, (k,))} first gave [{first}], then [{then}]'
    )


RELAY_LABELS = {
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


def judge_relay(code: HillsCode) -> list[Finding]:
    """Return a finding for each criterion `relay.…`; all are skipped if it is not written yet.

    That of a program that reads keys itself is open.
    """
    try:
        drives = {
            key: code.relay_commands(_twists(key), _END) for key in (_UP, _DOWN, _LEFT, _RIGHT)
        }
        silent = code.relay_commands(_twists(_UP, released=False), _END)
    except UserError as error:
        text = str(error)
        skipped, is_open = NOT_WRITTEN in text, BY_EYE in text
        return [Finding(name, 0.0, text, skipped=skipped, open=is_open) for name in RELAY_LABELS]
    held = {key: _at(commands, _HELD) for key, commands in drives.items()}
    judges: Mapping[str, Callable[[], tuple[float, str]]] = {
        'relay.forward': partial(_direction, 'motor', (_UP, _DOWN), _FORWARD, held),
        'relay.steering': partial(_direction, 'servo', (_LEFT, _RIGHT), _STEERING, held),
        'relay.units': partial(_bounded, drives),
        'relay.release': partial(_release, drives),
        'relay.rate': partial(_rate, drives[_UP]),
        'relay.silence': partial(_silence, silent),
    }
    return [Finding(name, *judges[name]()) for name in RELAY_LABELS]


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
    field: str,
    keys: tuple[_Key, _Key],
    sentences: tuple[str, ...],
    commands: Mapping[_Key, Command],
) -> tuple[float, str]:
    """Judge what two keys do to a field of `Command`, and not to the other."""
    faults, score, values = [], 0.0, []
    for key in keys:
        held = commands[key]._asdict()
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


def _rate(commands: Sequence[Command]) -> tuple[float, str]:
    count = sum(_PRESSED <= each.t < _RELEASED for each in commands)
    rate = count / (_RELEASED - _PRESSED)
    text = f'{rate:.0f} commands a second while a key is held'
    if rate > _FAST:
        return 0.5, f'{text}: is the sleep of its loop missing? 20 are enough'
    if rate < _SLOW - _TOLERANCE:
        return rate / _SLOW, f'{text}: the lab has dt = 0.05 s, 20 a second'
    return 1.0, text


HILLS = Lab(
    handout.HILLS,
    HillsCode,
    {
        'model': Part(MODEL_LABELS, lambda code, its, names: judge_model(code, its.seed, names)),
        'controller': Part(LABELS, judge_pid),
        'relay': Part(RELAY_LABELS, lambda code, *_: judge_relay(code)),
    },
)
