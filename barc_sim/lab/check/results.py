"""The results of a user's `bikeFE` in each situation, beside the expected ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.check.equations import NAMES
from barc_sim.lab.check.situations import GENERAL, SITUATIONS, Situation, with_lengths
from barc_sim.vehicle.bike_model import L_F, L_R, bikeFE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.lab.check.code import JudgedCode, Next, Row
    from barc_sim.lab.check.equations import Floats

#: After so many failures the code is not called again: each call can use its whole time budget.
_MAX_FAILURES = 4
_OTHER_L_F, _OTHER_L_R = 1.2, 1.9  #: [m]


#: Relative to max(|expected|, 1): far above rounding errors, far below any mistake.
TOLERANCE = 1e-9


def close(got: Floats, expected: Floats) -> Floats:
    """Return where `got` equals `expected`, to rounding; False where it is not finite."""
    with np.errstate(invalid='ignore', over='ignore'):
        near = np.abs(got - expected) <= TOLERANCE * np.maximum(1.0, np.abs(expected))
    return np.asarray(near & np.isfinite(got), dtype=np.bool_)


@dataclass(eq=False)
class Results:
    """The states of one situation, with the expected and the actual results."""

    situation: Situation
    rows: list[Row]
    l_f: float
    l_r: float
    expected: Floats  #: shape `(n, 4)`
    got: Floats  #: shape `(n, 4)`, NaN if the code failed
    failure: str = ''

    def right(self, column: int) -> Floats:
        """Return the states in which the equation of `column` is right, shape `(n,)`."""
        return close(self.got[:, column], self.expected[:, column])


def run_situations(
    code: JudgedCode, seed: int, situations: Sequence[Situation] = SITUATIONS
) -> list[Results]:
    """Call `bikeFE` in all of the `situations`."""
    results: list[Results] = []
    for situation in situations:
        results.append(_run(code, situation, situation.rows(seed), results))
    return results


def run_general(code: JudgedCode, seed: int) -> list[Results]:
    """Call `bikeFE` with another car; other axle distances are tried only if it uses them."""
    results = run_situations(code, seed, GENERAL)
    turn = next(situation for situation in SITUATIONS if situation.name == 'a left turn')
    return results + _at_other_lengths(code, seed, _run(code, turn, turn.rows(seed), results))


def _run(
    code: JudgedCode, situation: Situation, rows: list[Row], before: Sequence[Results]
) -> Results:
    l_f, l_r = situation.lengths or (L_F, L_R)
    expected = np.array([bikeFE(*row, l_f=l_f, l_r=l_r) for row in rows])
    part = Results(situation, rows, l_f, l_r, expected, np.full_like(expected, np.nan))
    failures = [other.failure for other in before if other.failure]
    if len(failures) >= _MAX_FAILURES:
        part.failure = failures[-1]
        return part
    try:
        part.got = _array(code.bike_fe(rows, l_f=l_f, l_r=l_r))
    except UserError as error:
        part.failure = str(error)
    return part


def _array(rows: Sequence[Next]) -> Floats:
    return np.array(rows, dtype=np.float64).reshape(-1, len(NAMES))


def _at_other_lengths(code: JudgedCode, seed: int, turn: Results) -> list[Results]:
    """Return the results at other axle distances, if the function takes any."""
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
    return [_run(code, situation, situation.rows(seed), [])]


def _differs(rows: Sequence[Next], others: Floats) -> bool:
    return not np.array_equal(_array(rows), others)


def find_randomness(code: JudgedCode, results: Sequence[Results]) -> str:
    """Return a message if the same arguments give different results, else an empty string."""
    part = next((part for part in results if not part.failure), None)
    if part is None:
        return ''
    try:
        again = _array(code.bike_fe(part.rows, l_f=part.l_f, l_r=part.l_r))
    except UserError as error:
        return f'a second call with the same arguments fails: {error}'
    differing = np.flatnonzero(~np.all(part.got == again, axis=1))
    if not differing.size:
        return ''
    first = int(differing[0])
    return (
        'the same arguments give different results: does bikeFE use random numbers or change a '
        f'global variable? {call_text(part.rows[first])} first gave '
        f'{_listed(part.got[first])}, then {_listed(again[first])}'
    )


def call_text(row: Row) -> str:
    """Return the call with these arguments, as text."""
    values = zip(row._fields, row, strict=True)
    return f'bikeFE({", ".join(f"{name}={value:.6g}" for name, value in values)})'


def _listed(values: Floats) -> str:
    return f'[{", ".join(f"{value:.9g}" for value in values)}]'
