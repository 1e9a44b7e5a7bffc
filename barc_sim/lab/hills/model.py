"""Judges `bikeFE`: each equation in seeded states.

No state passes through zero speed within a step: sensible models differ there. barc_sim's holds the
car at a standstill; the lab's equation does not.
"""

from __future__ import annotations

from collections import Counter
from math import inf, pi, radians
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.check.code import Finding, Row, judges
from barc_sim.lab.check.laws import Law, Mistake, Situation, read
from barc_sim.vehicle.bike_model import GRAVITY, L_F, L_R, Vehicle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.lab.check.code import Judged, JudgedCode
    from barc_sim.lab.check.laws import Floats, Range

TS = 0.02  #: [s]
EQUATIONS = ('x', 'y', 'psi', 'v')  #: in the order of what bikeFE returns
LABELS = {
    'model.x': 'Model: position x',
    'model.y': 'Model: position y',
    'model.psi': 'Model: heading \N{GREEK SMALL LETTER PSI}',
    'model.v': 'Model: speed v',
    'model.reverse': 'Model: in reverse',
    'model.general': 'Model: another car',
}
_LAB = Vehicle()
#: Inputs are the arguments of bikeFE with l_f and l_r; results are `x_next` to `v_next`.
BIKE = Law(
    *read(
        Path(__file__).with_name('bike.txt'),
        GRAVITY=GRAVITY,
        MASS=_LAB.mass,
        DRAG=_LAB.air_drag_coeff,
        FRICTION=_LAB.friction,
    )
)
#: A car that coasts on the flat; in the order of bikeFE's arguments.
_COASTING: dict[str, Range] = {
    'x': (-200.0, 200.0),  # [m]
    'y': (-50.0, 50.0),  # [m]
    'psi': (-pi, pi),  # [rad]
    'v': (3.0, 20.0),  # [m/s]
    'a': (0.0, 0.0),  # [m/s²]
    'd_f': (0.0, 0.0),  # [rad]
    'a0': (0.0, 0.0),  # [N s²/m²]
    'm': (_LAB.mass, _LAB.mass),  # [kg]
    'Ff': (0.0, 0.0),  # [N]
    'theta': (0.0, 0.0),  # [rad]
    'ts': (TS, TS),  # [s]
}


def _situation(
    name: str, concerns: str, *, l_f: float = L_F, l_r: float = L_R, **ranges: Range
) -> Situation:
    return Situation(name, concerns, {**_COASTING, **ranges}, {'l_f': l_f, 'l_r': l_r})


_LEFT, _RIGHT, _STEERED = (0.05, 0.5), (-0.5, -0.05), (-0.5, 0.5)
_COMMAND, _DRAG, _FRICTION = (1.0, 8.0), (0.1, 2.0), (20.0, 500.0)
_BACKWARDS = (-15.0, -3.0)
_UPHILL, _DOWNHILL, _HILLS = (
    (radians(low), radians(high)) for low, high in ((2.0, 30.0), (-30.0, -2.0), (-30.0, 30.0))
)
_TURN = _situation('a left turn', 'x y psi', d_f=_LEFT)

SITUATIONS = (
    _situation('coasting along the x axis', 'x', psi=(0.0, 0.0)),
    _situation('accelerating on the flat', 'x y v', a=_COMMAND),
    _situation('braking on the flat', 'v', a=(-8.0, -1.0)),
    # Without drag and friction, because models differ in sign(0).
    _situation('setting off', 'v', v=(0.0, 0.0), a=_COMMAND),
    _TURN,
    _situation('a right turn', 'x y psi', d_f=_RIGHT),
    _situation('uphill', 'v', theta=_UPHILL),
    _situation('downhill', 'v', theta=_DOWNHILL),
    _situation('rolling friction', 'v', Ff=_FRICTION),
    _situation('air drag', 'v', a0=_DRAG),
    _situation(
        "the lab's car on hills",
        'x y psi v',
        a=(-8.0, 8.0),
        d_f=_STEERED,
        a0=(_LAB.air_drag_coeff, _LAB.air_drag_coeff),
        Ff=(_LAB.friction, _LAB.friction),
        theta=_HILLS,
    ),
)
#: The lab's road has none of these.
REVERSE = (
    _situation('reversing to the left', 'x y psi', v=_BACKWARDS, d_f=_LEFT),
    _situation('reversing to the right', 'x y psi', v=_BACKWARDS, d_f=_RIGHT),
    _situation('drag and friction in reverse', 'v', v=_BACKWARDS, a0=_DRAG, Ff=_FRICTION),
    _situation('rolling back on a hill', 'v', v=_BACKWARDS, Ff=_FRICTION, theta=_UPHILL),
)
GENERAL = (
    _situation(
        'another mass and time step',
        'x y psi v',
        v=(4.0, 20.0),
        a=(-4.0, 8.0),
        d_f=_STEERED,
        a0=_DRAG,
        m=(500.0, 3000.0),
        Ff=_FRICTION,
        theta=_HILLS,
        ts=(0.005, 0.1),
    ),
)


def with_lengths(l_f: float, l_r: float) -> Situation:
    """Return the situation for a function that takes the axle distances [m]."""
    return _situation('axles at other distances', 'x y psi', l_f=l_f, l_r=l_r, d_f=_STEERED)


#: Relative to max(|expected|, 1): far above rounding errors, far below any mistake.
_TOLERANCE = 1e-9
_PROPORTIONAL = 1e-6  #: relative error of a change that is the right one but for a factor
_MIN_LOSS, _FACTOR, _SIGN = 0.1, 0.4, 0.6  #: of an equation's points; see `Trial.loss`
_ABSENT = 'Absent'  #: the topic of equations that are not there, each of which counts
#: After so many failures the code is not called again: each call can use its whole time budget.
_MAX_FAILURES = 4
_STATES = 250  #: of each situation
_OTHER_L_F, _OTHER_L_R = 1.2, 1.9  #: [m]


def close(got: Floats, expected: Floats) -> Floats:
    """Return where `got` equals `expected`, to rounding; False where it is not finite."""
    with np.errstate(invalid='ignore', over='ignore'):
        near = np.abs(got - expected) <= _TOLERANCE * np.maximum(1.0, np.abs(expected))
    return np.asarray(near & np.isfinite(got), dtype=np.bool_)


class Trial:
    """The states of one situation, with the expected and the actual results."""

    def __init__(self, situation: Situation, seed: int, count: int = _STATES) -> None:
        """Expect what the law computes; there are no results yet."""
        self.situation = situation
        self.rows = [Row(*values) for values in situation.rows(seed, count)]
        self.inputs = dict(zip(Row._fields, np.array(self.rows).T, strict=True))
        self.inputs |= {name: np.full(count, value) for name, value in situation.fixed.items()}
        law = BIKE.compute(self.inputs)
        self.expected = {name: law[f'{name}_next'] for name in EQUATIONS}
        self.got = {name: np.full(count, np.nan) for name in EQUATIONS}  #: NaN if the code failed
        self.failure = ''

    def run(self, code: JudgedCode, *, assigned: bool = False) -> None:
        """Call `bikeFE` in each state."""
        try:
            results = np.array(code.bike_fe(self.rows, **self.situation.fixed, assigned=assigned))
            self.got = dict(zip(EQUATIONS, results.T, strict=True))
        except UserError as error:
            self.failure = str(error)

    def right(self, name: str, cause: Mistake | None = None) -> Floats:
        """Return the states in which the equation of `name` is right, shape `(n,)`.

        What follows from a `cause` is right, too.
        """
        right = close(self.got[name], self.expected[name])
        if cause:
            law = BIKE.compute(self.known, cause.formulas)
            right = np.logical_or(right, close(self.got[name], law[f'{name}_next']))
        return right

    @property
    def known(self) -> dict[str, Floats]:
        """The inputs, and what the code returned."""
        return self.inputs | {f'{name}_got': got for name, got in self.got.items()}

    def loss(self, name: str) -> float:
        """Return how wrong the equation of `name` is, from 0 to 1, by the change over the step.

        A constant that is off by little costs little, a factor more, a sign most; what is absent,
        or has nothing to do with the right change, costs all.
        """
        if self.right(name).all():
            return 0.0
        old = self.inputs[name]
        got, right = self.got[name] - old, self.expected[name] - old
        size = float(np.vdot(right, right))
        factor = float(np.vdot(got, right)) / size if size else 0.0
        if np.abs(got - factor * right).max() <= _PROPORTIONAL * np.abs(got).max() and factor:
            return min(abs(factor - 1.0), _FACTOR) if factor > 0.0 else _SIGN
        error = np.sqrt(np.vdot(got - right, got - right) / size) if size else inf
        return float(min(error, 1.0)) if error >= 0.0 else 1.0


def _run(code: JudgedCode, seed: int, situations: Sequence[Situation]) -> list[Trial]:
    """Call `bikeFE` in all of the `situations`."""
    trials = [Trial(situation, seed) for situation in situations]
    failures: list[str] = []
    for trial in trials:
        if len(failures) < _MAX_FAILURES:
            trial.run(code)
        else:
            trial.failure = failures[-1]
        failures += filter(None, [trial.failure])
    return trials


def _at_other_lengths(code: JudgedCode, seed: int) -> tuple[Situation, ...]:
    """Return the situation at other axle distances, those that the function takes."""
    rows = Trial(_TURN, seed).rows
    try:
        usual = code.bike_fe(rows)
    except UserError:
        return ()
    try:
        l_f = L_F if code.bike_fe(rows, l_f=_OTHER_L_F) == usual else _OTHER_L_F
        l_r = L_R if code.bike_fe(rows, l_r=_OTHER_L_R) == usual else _OTHER_L_R
    except UserError:
        l_f, l_r = _OTHER_L_F, _OTHER_L_R
    return () if (l_f, l_r) == (L_F, L_R) else (with_lengths(l_f, l_r),)


@np.errstate(all='ignore')
def judge_equations(code: JudgedCode, seed: int) -> list[Finding]:
    """Return a finding for each of the four equations, in states of the lab's road.

    An equation loses as much as it is wrong, see `Trial.loss`: the mean over the situations that
    test it, and that over all others; for one known mistake no more than for a sign. A mistake in
    several equations counts once: each of them loses its share.
    """
    trials = _run(code, seed, SITUATIONS)
    if random := _randomness(code, trials):
        return [Finding(f'model.{name}', 0.0, random) for name in EQUATIONS]
    losses = {name: loss for name in EQUATIONS if (loss := _loss(trials, name))}
    causes = _causes(trials, [*losses])
    times = Counter(cause.kind for cause in causes.values())
    own = _own_lengths(code, seed, trials)
    elsewhere = [name for name in EQUATIONS if _loss(own, name)]
    beyond = _causes(own, elsewhere, trials) if elsewhere else {}
    placed: dict[str, str] = {}  # one mistake has one line
    findings: list[Finding] = []
    for name in EQUATIONS:
        message, score = _right(trials), 1.0
        if cause := causes.get(name):
            is_absent, most = cause.topic == _ABSENT, _SIGN if cause.topic else 1.0
            score -= losses[name] if is_absent else min(losses[name] / times[cause.kind], most)
            text = cause.sentence
            placed[text] = placed.get(text) or _placed(code, trials, name, cause)
            message = placed[text] + text
        elif name in beyond:
            text = _placed(code, own, name, beyond[name]) + beyond[name].sentence
            message += f' of a car with l_f = l_r; of another one not: {text}'
        findings.append(Finding(f'model.{name}', score, message, cause))
    return findings


@judges('model.reverse')
def judge_reverse(code: JudgedCode, seed: int, equations: Sequence[Finding] = ()) -> Judged:
    """Return the finding on all equations together, at negative speeds."""
    return _judge_beyond(code, seed, _run(code, seed, REVERSE), equations)


@judges('model.general')
def judge_general(code: JudgedCode, seed: int, equations: Sequence[Finding] = ()) -> Judged:
    """Return the finding on all equations together, with another car.

    Other axle distances are tried if the function takes them.
    """
    lengths = _at_other_lengths(code, seed)
    trials = _run(code, seed, (*GENERAL, *lengths))
    trials += [] if lengths else _own_lengths(code, seed, trials)
    return _judge_beyond(code, seed, trials, equations)


def _own_lengths(code: JudgedCode, seed: int, trials: Sequence[Trial]) -> list[Trial]:
    """Return a trial with other axle distances in the file's own variables, if it names a mistake.

    Other differences there are no mistake: a file may have 0.5 in place of l_r / (l_f + l_r).
    """
    if any(_loss(trials, name) for name in ('x', 'y', 'psi')):
        return []
    trial = Trial(with_lengths(_OTHER_L_F, _OTHER_L_R), seed)
    trial.run(code, assigned=True)
    wrong = [name for name in EQUATIONS if not trial.right(name).all()]
    named = {} if trial.failure else _named([*trials, trial], wrong)
    named = {n: cause for n, cause in named.items() if not cause.is_general}
    trial.got |= {name: trial.expected[name] for name in wrong if name not in named}
    return [trial] if named else []


def _judge_beyond(
    code: JudgedCode, seed: int, trials: Sequence[Trial], equations: Sequence[Finding]
) -> Judged:
    """Judge the results in states that the lab's road has not.

    What follows from a mistake in the `equations`, judged before, is not taken off again.
    """
    causes = (each.evidence if each.score else None for each in equations)
    known = dict(zip(EQUATIONS, causes, strict=False))
    right = {n: [trial.right(n, known.get(n)) for trial in trials] for n in EQUATIONS}
    score = float(np.mean([*right.values()]))
    if any(not each.passed for each in equations):
        score = max(score, mean_score(equations))
    if not (wrong := [name for name in EQUATIONS if not np.all(right[name])]):
        again = any(_loss(trials, name) for name in EQUATIONS)
        return score, 'no mistake but those above' if again else _right(trials)
    # A cause must explain the results on the lab's road, too.
    cause = _causes(trials, wrong[:1], _run(code, seed, SITUATIONS))[wrong[0]]
    return score, _placed(code, trials, wrong[0], cause) + cause.sentence


def mean_score(findings: Sequence[Finding]) -> float:
    """Return the mean score of findings."""
    return float(np.mean([each.score for each in findings]))


def _loss(trials: Sequence[Trial], name: str) -> float:
    """Return how wrong the equation of `name` is, from 0 to 1."""
    tested: list[float] = []
    other: list[float] = []
    for trial in trials:
        (tested if name in trial.situation.concerns.split() else other).append(trial.loss(name))
    loss = 1.0 - (1.0 - np.mean(tested or [0.0])) * (1.0 - np.mean(other or [0.0]))
    return float(max(loss, _MIN_LOSS)) if loss else 0.0


def _right(trials: Sequence[Trial]) -> str:
    return f'right in all {sum(len(trial.rows) for trial in trials):,} states'


def _causes(
    trials: Sequence[Trial], wrong: Sequence[str], others: Sequence[Trial] = ()
) -> dict[str, Mistake]:
    """Return for each wrong equation the failure, the mistake, or its largest error."""
    if failed := [trial for trial in trials if trial.failure]:
        if len(failed) == len(trials):
            return dict.fromkeys(wrong, Mistake(_ABSENT, failed[0].failure, {}, ''))
        text = f'{failed[0].failure} ({failed[0].situation.name})'
        return dict.fromkeys(wrong, Mistake('', text, {}, text))
    named = _named([trial for trial in (*others, *trials) if not trial.failure], wrong)
    return {name: named.get(name) or _largest_error(trials, name) for name in wrong}


def _named(trials: Sequence[Trial], wrong: Sequence[str]) -> dict[str, Mistake]:
    """Return the mistake in each wrong equation, if the law's file has it."""
    results = joined([trial.got for trial in trials])
    named = BIKE.explain(
        joined([trial.known for trial in trials]),
        {f'{name}_next': got for name, got in results.items()},
        [f'{name}_next' for name in wrong],
        lambda one, other: bool(close(one, other).all()),
    )
    return {name.removesuffix('_next'): cause for name, cause in named.items()}


def _placed(code: JudgedCode, trials: Sequence[Trial], name: str, cause: Mistake) -> str:
    """Return the file and line of a wrong equation, with a colon; empty if none is known.

    It is the first line that gives a value of the wrong law to a name, and where there is none the
    one that returns.
    """
    # The last one is the most general.
    trial = next((each for each in reversed(trials) if not each.right(name).all()), None)
    if trial is None or trial.failure:
        return ''
    k = int(np.argmax(np.abs(trial.got[name] - trial.expected[name])))
    values = {key: value[k] for key, value in trial.known.items()}
    wrong = {*BIKE.changed(trial.known, cause, [k]), values[f'{name}_got']}
    if name == 'v':  # the force that follows from it
        wrong.add(values['m'] * ((values['v_got'] - values['v']) / values['ts'] - values['a']))
    row, lengths = trial.rows[k], trial.situation.fixed.values()
    right = [each[k] for each in trial.expected.values()]
    place = code.line_of('model_at', ([row], *lengths), wrong, right)
    return f'{place}: ' if place else ''


def joined(parts: Sequence[dict[str, Floats]]) -> dict[str, Floats]:
    """Return the arrays of several parts, one after the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _largest_error(trials: Sequence[Trial], name: str) -> Mistake:
    """Return a mistake that says where an equation is wrong, and its largest error."""
    bad = [trial.situation.name for trial in trials if not trial.right(name).all()]
    where = 'everywhere' if len(bad) == len(trials) else f'in: {", ".join(bad)}'
    errors = [np.abs(trial.got[name] - trial.expected[name]) for trial in trials]
    trial, error = max(zip(trials, errors, strict=True), key=lambda item: float(item[1].max()))
    row = int(error.argmax())
    text = (
        f'{name}_next is wrong {where}. The largest error: {_call_text(trial.rows[row])} gave '
        f'{trial.got[name][row]:.9g}, expected {trial.expected[name][row]:.9g}'
    )
    return Mistake('', text, {}, text)


def _randomness(code: JudgedCode, trials: Sequence[Trial]) -> str:
    """Return a message if the same arguments give different results, else an empty string."""
    trial = next((trial for trial in trials if not trial.failure), None)
    if trial is None:
        return ''
    try:
        again = np.array(code.bike_fe(trial.rows))
    except UserError as error:
        return f'a second call with the same arguments fails: {error}'
    before = np.array([*trial.got.values()]).T
    differing = np.flatnonzero(~np.all(before == again, axis=1))
    if not differing.size:
        return ''
    k = int(differing[0])
    first, then = (', '.join(f'{value:.9g}' for value in values[k]) for values in (before, again))
    return (
        'the same arguments give different results: does bikeFE use random numbers or change a '
        f'global variable? {_call_text(trial.rows[k])} first gave [{first}], then [{then}]'
    )


def _call_text(row: Row) -> str:
    return f'bikeFE({", ".join(f"{name}={value:.6g}" for name, value in row._asdict().items())})'
