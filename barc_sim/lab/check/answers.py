"""What a user's `bikeFE` answers in the situations in which it is judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.check.diagnosis import close
from barc_sim.lab.check.equations import NAMES
from barc_sim.lab.check.situations import SITUATIONS, Situation, with_lengths
from barc_sim.vehicle.bike_model import L_F, L_R, bikeFE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.lab.check.code import Code, Next, Row
    from barc_sim.lab.check.equations import Floats

#: Where the code fails so often, it is asked no more: each time may take its whole time budget.
_ENOUGH = 4
_OTHER_L_F, _OTHER_L_R = 1.2, 1.9  #: [m]


@dataclass(eq=False)
class Answered:
    """A situation's states, what was expected of them and what came."""

    situation: Situation
    rows: list[Row]
    l_f: float
    l_r: float
    expected: Floats  #: shape `(n, 4)`
    got: Floats  #: shape `(n, 4)`, NaN where the code failed
    failure: str = ''

    def right(self, column: int) -> Floats:
        """Return in which states the equation of that column is right, shape `(n,)`."""
        return close(self.got[:, column], self.expected[:, column])


def ask(code: Code, seed: int) -> list[Answered]:
    """Return what the code makes of all situations; of lengths to the axles only if it uses any."""
    answered: list[Answered] = []
    for situation in SITUATIONS:
        answered.append(_answer(code, situation, situation.rows(seed), answered))
    answered += _at_other_lengths(code, seed, answered)
    return answered


def _answer(
    code: Code, situation: Situation, rows: list[Row], before: Sequence[Answered]
) -> Answered:
    l_f, l_r = situation.lengths or (L_F, L_R)
    expected = np.array([bikeFE(*row, l_f=l_f, l_r=l_r) for row in rows])
    part = Answered(situation, rows, l_f, l_r, expected, np.full_like(expected, np.nan))
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


def _at_other_lengths(code: Code, seed: int, answered: Sequence[Answered]) -> list[Answered]:
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


def changing(code: Code, answered: Sequence[Answered]) -> str:
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
        f'keep something in a global variable? {shown(part.rows[first])} gave first '
        f'{_listed(part.got[first])}, then {_listed(again[first])}'
    )


def shown(row: Row) -> str:
    """Return the call with these arguments."""
    values = zip(row._fields, row, strict=True)
    return f'bikeFE({", ".join(f"{name}={value:.6g}" for name, value in values)})'


def _listed(values: Floats) -> str:
    return f'[{", ".join(f"{value:.9g}" for value in values)}]'
