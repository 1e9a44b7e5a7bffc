"""Judges the model: each equation in seeded states, and all of them along the road."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.bike_model import L_F, L_R, bikeFE
from barc_sim.checking.diagnosis import causes, close
from barc_sim.checking.equations import NAMES, arguments
from barc_sim.checking.finding import Finding
from barc_sim.checking.situations import SITUATIONS, Situation, with_lengths
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.checking.code import Code, Next, Row
    from barc_sim.checking.equations import Floats

#: Where the code fails so often, it is asked no more: each time may take its whole time budget.
_ENOUGH = 4
_OTHER_L_F, _OTHER_L_R = 1.2, 1.9  #: [m]


@dataclass(eq=False)
class _Answered:
    """A situation's states, what was expected of them and what came."""

    situation: Situation
    rows: list[Row]
    l_f: float
    l_r: float
    expected: Floats  #: shape `(n, 4)`
    got: Floats  #: shape `(n, 4)`, NaN where the code failed
    failure: str = ''

    def right(self, column: int) -> Floats:
        return close(self.got[:, column], self.expected[:, column])


def judge_equations(code: Code, seed: int) -> list[Finding]:
    """Return a finding for each of the four equations.

    An equation's score is the mean, over the situations that concern it, of the share of states in
    which it is right, times that share over the other situations, where it has nothing to do but
    to stay out of the way. Lengths that the function takes, and uses, are varied; those that it
    does not take are the lab's, in whatever way they are written.
    """
    answered = _ask(code, seed)
    changing = _changing(code, answered)
    scores = {name: _score(answered, name) for name in NAMES}
    wrong = [name for name in NAMES if scores[name] < 1.0]
    finite = [part for part in answered if not part.failure]
    found = {} if changing or not finite else _causes(finite, wrong)
    findings = []
    for name in NAMES:
        states = sum(len(part.rows) for part in answered)
        if name not in wrong and not changing:
            message = f'right in all {states:,} states'
        else:
            message = changing or _message(answered, name, found.get(name))
        score = 0.0 if changing else scores[name]
        findings.append(
            Finding(f'model.{name}', score, message, {'shares': _shares(answered, name)})
        )
    return findings


def _ask(code: Code, seed: int) -> list[_Answered]:
    answered: list[_Answered] = []
    for situation in SITUATIONS:
        answered.append(_answer(code, situation, situation.rows(seed), answered))
    answered += _at_other_lengths(code, seed, answered)
    return answered


def _answer(
    code: Code, situation: Situation, rows: list[Row], before: Sequence[_Answered]
) -> _Answered:
    l_f, l_r = situation.lengths or (L_F, L_R)
    expected = np.array([bikeFE(*row, l_f=l_f, l_r=l_r) for row in rows])
    part = _Answered(situation, rows, l_f, l_r, expected, np.full_like(expected, np.nan))
    failures = [other.failure for other in before if other.failure]
    if len(failures) >= _ENOUGH:
        part.failure = failures[-1]
        return part
    try:
        part.got = _array(code.bike_fe(rows, l_f=l_f, l_r=l_r))
    except UserError as error:
        part.failure = str(error)
    return part


def _array(answers: Sequence[Next]) -> Floats:
    return np.array(answers, dtype=np.float64).reshape(-1, len(NAMES))


def _at_other_lengths(code: Code, seed: int, answered: Sequence[_Answered]) -> list[_Answered]:
    """Return the answers at other lengths to the axles, if the function takes any."""
    turn = next(part for part in answered if part.situation.name == 'a left turn')
    if turn.failure:
        return []
    try:
        as_given = _array(code.bike_fe(turn.rows))
        lengths = (
            _OTHER_L_F if _differs(code.bike_fe(turn.rows, l_f=_OTHER_L_F), as_given) else L_F,
            _OTHER_L_R if _differs(code.bike_fe(turn.rows, l_r=_OTHER_L_R), as_given) else L_R,
        )
    except UserError:
        lengths = (_OTHER_L_F, _OTHER_L_R)
    if lengths == (L_F, L_R):
        return []
    situation = with_lengths(*lengths)
    return [_answer(code, situation, situation.rows(seed), answered)]


def _differs(answers: Sequence[Next], others: Floats) -> bool:
    return not np.array_equal(_array(answers), others)


def _changing(code: Code, answered: Sequence[_Answered]) -> str:
    """Return what to say of a function whose answers to the same arguments differ; or nothing."""
    part = next((part for part in answered if not part.failure), None)
    if part is None:
        return ''
    try:
        again = _array(code.bike_fe(part.rows, l_f=part.l_f, l_r=part.l_r))
    except UserError as error:
        return f'asked the same once more, it fails: {error}'
    differing = np.flatnonzero(~np.all(part.got == again, axis=1))
    if not differing.size:
        return ''
    first = int(differing[0])
    return (
        'the same arguments give different answers: is there anything random in bikeFE, or does it '
        f'keep something in a global variable? {_shown(part.rows[first])} gave first '
        f'{_listed(part.got[first])}, then {_listed(again[first])}'
    )


def _score(answered: Sequence[_Answered], name: str) -> float:
    column = NAMES.index(name)
    concerned: list[float] = []
    other: list[float] = []
    for part in answered:
        share = float(np.mean(part.right(column)))
        (concerned if name in part.situation.concerns.split() else other).append(share)
    return float(np.mean(concerned) * np.mean(other))


def _shares(answered: Sequence[_Answered], name: str) -> dict[str, float]:
    column = NAMES.index(name)
    return {part.situation.name: float(np.mean(part.right(column))) for part in answered}


def _causes(answered: Sequence[_Answered], wrong: Sequence[str]) -> dict[str, str]:
    given = arguments(
        [row for part in answered for row in part.rows],
        [part.l_f for part in answered for _ in part.rows],
        [part.l_r for part in answered for _ in part.rows],
    )
    got = np.concatenate([part.got for part in answered])
    return causes(given, dict(zip(NAMES, got.T, strict=True)), wrong)


def _message(answered: Sequence[_Answered], name: str, cause: str | None) -> str:
    failed = [part for part in answered if part.failure]
    if failed:
        where = '' if len(failed) == len(answered) else f' ({failed[0].situation.name})'
        return f'{failed[0].failure}{where}'
    if cause:
        return cause
    column = NAMES.index(name)
    bad = [part.situation.name for part in answered if not part.right(column).all()]
    within = 'everywhere' if len(bad) == len(answered) else f'in: {", ".join(bad)}'
    return f'{name}_next is wrong {within}. {_largest(answered, column)}'


def _largest(answered: Sequence[_Answered], column: int) -> str:
    """Return the state with the largest error in words."""
    errors = [np.abs(part.got[:, column] - part.expected[:, column]) for part in answered]
    part, error = max(zip(answered, errors, strict=True), key=lambda item: float(item[1].max()))
    row = int(error.argmax())
    return (
        f'The largest error: {_shown(part.rows[row])} gave {part.got[row, column]:.9g}, expected '
        f'{part.expected[row, column]:.9g}'
    )


def _shown(row: Row) -> str:
    values = zip(row._fields, row, strict=True)
    return f'bikeFE({", ".join(f"{name}={value:.6g}" for name, value in values)})'


def _listed(values: Floats) -> str:
    return f'[{", ".join(f"{value:.9g}" for value in values)}]'
