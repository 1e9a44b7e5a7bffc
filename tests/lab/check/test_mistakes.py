"""The laws that name mistakes are right without one, and name each mistake of their tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim.lab.labs.hills import BIKE, EQUATIONS, ROAD
from barc_sim.lab.labs.pid import PID_LAW, judge_controller
from barc_sim.lab.laws import Mistake, close
from barc_sim.vehicle.bike_model import bikeFE

if TYPE_CHECKING:
    from collections.abc import Sequence

DRAWN = [each.inputs(7, 40) for section in BIKE.situations.values() for each in section]
INPUTS = {name: np.concatenate([each[name] for each in DRAWN]) for name in DRAWN[0]}
STATES = [dict(zip(INPUTS, row, strict=True)) for row in np.array([*INPUTS.values()]).T.tolist()]
EXPECTED = dict(zip(EQUATIONS, np.array([bikeFE(**state) for state in STATES]).T, strict=True))


@pytest.mark.parametrize('name', EQUATIONS)
def test_without_a_mistake_each_equation_is_barc_sims(name: str) -> None:
    assert close(BIKE.compute(INPUTS)[name], EXPECTED[name])


def sentences(got: dict[str, Any], wrong: Sequence[str]) -> dict[str, str]:
    known = INPUTS | {f'got_{name}': values for name, values in got.items()}
    with np.errstate(all='ignore'):
        causes = BIKE.explain({name: (known, values) for name, values in got.items()}, wrong, close)
    return {name: cause.sentence for name, cause in causes.items()}


#: Without those that are named by what was returned: the table of wrong programs has them.
NAMED = [each for each in BIKE.mistakes if 'got_' not in ''.join(each.formulas.values())]


@pytest.mark.parametrize('mistake', NAMED, ids=lambda mistake: mistake.sentence[:40])
def test_a_mistake_is_named_where_it_changes_an_equation(mistake: Mistake) -> None:
    with np.errstate(all='ignore'):
        made = BIKE.compute(INPUTS, mistake.formulas)
        got = {name: np.broadcast_to(made[name], len(STATES)) for name in EQUATIONS}
    wrong = [name for name in EQUATIONS if not close(got[name], EXPECTED[name])]
    assert wrong
    assert sentences(got, wrong) == dict.fromkeys(wrong, mistake.sentence)


#: Of the windows of 2 to 59 calls, three.
TERM_MISTAKES = [
    (term, each)
    for each in PID_LAW.mistakes
    for term in (
        each.formulas.keys() & {*'PID'}
        or {'area': 'I', 'change': 'D'}.get(next(iter(each.formulas)), 'PID')
    )
    if not any(f' {width} ' in each.sentence for width in {*range(3, 59)} - {20})
]


class Pid:
    """A PID whose outputs are those of a law."""

    number = 0

    def __init__(self, law: Any, formulas: dict[str, str], gains: dict[str, float]) -> None:  # noqa: ANN401
        """Compute with wrong `formulas`."""
        self._law, self._formulas, self._gains = law, formulas, gains

    def acc_sequence(self, rows: Sequence[tuple[float, float, float]]) -> list[float]:
        """Return the outputs for all rows."""
        if not rows:
            return []
        reference, measured, dt = np.array(rows).T[:, np.newaxis]
        gains = {name: np.array([[value]]) for name, value in self._gains.items()}
        limits = {'low': np.array([[-0.03]]), 'high': np.array([[0.04]])}
        inputs = {'reference': reference, 'measured': measured, 'dt': dt, **gains, **limits}
        made = self._law.compute(inputs, self._formulas)
        outputs: list[float] = (made['P'] + made['I'] + made['D'])[0].tolist()
        return outputs

    def acc_calculate(self, *row: float) -> float:
        """Return the output for one row."""
        return self.acc_sequence([row])[0]  # type: ignore[list-item]

    def reset(self) -> bool:
        """Return that there is no reset."""
        return False


@pytest.mark.parametrize(
    ('term', 'mistake'),
    TERM_MISTAKES,
    ids=lambda value: value.sentence[:60] if isinstance(value, Mistake) else value,
)
def test_a_mistake_in_a_term_is_named(term: str, mistake: Mistake) -> None:
    class Code:
        def line_of(self, *_: object) -> str:
            return ''

        def new_pid(self, kp: float, ki: float, kd: float, **_: object) -> Pid:
            return Pid(PID_LAW, mistake.formulas, {'kp': kp, 'ki': ki, 'kd': kd})

    findings: Any = judge_controller(Code(), 0, ())  # type: ignore[arg-type]
    finding = next(each for each in findings if each.criterion[4].upper() == term)
    assert finding.score < 1.0
    assert finding.message == mistake.sentence


def test_of_two_mistakes_both_are_named_and_of_three_none() -> None:
    found = []
    for names in (('drag', 'gravity'), ('drag', 'gravity', 'v_old')):
        made = BIKE.compute(INPUTS, dict.fromkeys(names, '0'))
        got = {name: made[name] for name in EQUATIONS}
        found.append(sentences(got, ['v_next']).get('v_next', ''))
    both, none = found
    assert both.startswith('two mistakes: air drag is missing')
    assert '; and gravity is missing' in both
    assert none == ''


def test_no_situation_passes_through_zero_speed() -> None:
    for before, after in zip(INPUTS['v'], EXPECTED['v_next'], strict=True):
        assert before * after > 0.0 or before == 0.0


@pytest.mark.parametrize('name', EQUATIONS)
def test_each_equation_has_situations_in_which_it_moves(name: str) -> None:
    moved = [
        np.abs(BIKE.compute(inputs)[name] - inputs[name.removesuffix('_next')])
        for inputs in (each.inputs(3, 40) for each in ROAD if name in each.tests)
    ]
    assert np.min(moved) > 1e-8  # ten times the tolerance
