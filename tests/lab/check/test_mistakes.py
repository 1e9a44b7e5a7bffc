"""The laws that name mistakes are right without one, and name each mistake of their tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim.lab.judge import Trial, close
from barc_sim.lab.labs import hills, lane, raceline
from barc_sim.lab.labs.hills import BIKE, EQUATIONS, PID_LAW, agree, factor_of, wandering
from barc_sim.lab.law import Mistake
from barc_sim.vehicle.bike_model import bikeFE

if TYPE_CHECKING:
    from barc_sim.lab.judge import Functions
    from barc_sim.lab.law import Law


def inputs_of(law: Law) -> dict[str, Any]:
    """Return inputs of all situations of a law."""
    every = [each.inputs(7, 40) for section in law.situations.values() for each in section]
    return {name: np.concatenate([each[name] for each in every]) for name in every[0]}


INPUTS = inputs_of(BIKE)
STATES = [dict(zip(INPUTS, row, strict=True)) for row in np.array([*INPUTS.values()]).T.tolist()]
EXPECTED = dict(zip(EQUATIONS, np.array([bikeFE(**state) for state in STATES]).T, strict=True))


@pytest.mark.parametrize('name', EQUATIONS)
def test_without_a_mistake_each_equation_is_barc_sims(name: str) -> None:
    assert close(BIKE.compute(INPUTS)[name], EXPECTED[name])


@pytest.mark.parametrize(
    ('functions', 'mistake'),
    [
        (of, each)
        for of in (hills.FUNCTIONS, lane.FUNCTIONS, raceline.FUNCTIONS)
        for each in of.law.mistakes
    ],
    ids=lambda value: value.sentence[:40] if isinstance(value, Mistake) else '',
)
@np.errstate(all='ignore')
def test_a_mistake_is_named_where_it_changes_a_result(
    functions: Functions, mistake: Mistake
) -> None:
    law, inputs = functions.law, inputs_of(functions.law)
    right, wrong_results = law.compute(inputs), law.compute(inputs, mistake.formulas)
    cases = {
        name: (inputs, np.broadcast_to(wrong_results[name], right[name].shape))
        for name in functions.criteria
    }
    wrong = [name for name, (_, got) in cases.items() if not close(got, right[name])]
    assert wrong
    causes = law.explain(cases, wrong, close)

    assert {name: each.sentence for name, each in causes.items()} == dict.fromkeys(
        wrong, mistake.sentence
    )


ROWS = np.array([wandering(7, str(k), 0.5) for k in range(2)]).transpose(2, 0, 1)
CALLS = dict(zip(('reference', 'measured', 'dt'), ROWS, strict=True))
CALLS |= {name: np.array([[0.5], [3.0]]) for name in ('kp', 'ki', 'kd')}


@pytest.mark.parametrize('mistake', PID_LAW.mistakes, ids=lambda mistake: mistake.sentence[:60])
def test_a_mistake_is_named_where_it_changes_a_term(mistake: Mistake) -> None:
    wrong_results = PID_LAW.compute(CALLS, mistake.formulas)
    got = {name: np.broadcast_to(wrong_results[name], ROWS[0].shape) for name in 'PID'}
    wrong = [
        name for name in 'PID' if not factor_of(Trial('', '', '', CALLS, {}, {name: got[name]}))
    ]
    assert wrong
    causes = PID_LAW.explain({name: (CALLS, got[name]) for name in 'PID'}, wrong, agree)
    assert {each.sentence for each in causes.values()} == {mistake.sentence}


def test_no_situation_passes_through_zero_speed() -> None:
    for before, after in zip(INPUTS['v'], EXPECTED['v_next'], strict=True):
        assert before * after > 0.0 or before == 0.0


@pytest.mark.parametrize('name', EQUATIONS)
def test_each_equation_has_situations_in_which_it_moves(name: str) -> None:
    moved = [
        np.abs(BIKE.compute(inputs)[name] - inputs[name.removesuffix('_next')])
        for inputs in (
            each.inputs(3, 40) for each in BIKE.situations['bikeFE'] if name in each.tests
        )
    ]
    assert np.min(moved) > 1e-8  # ten times the tolerance
