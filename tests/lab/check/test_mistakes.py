"""The equations in parts are the reference's, and each mistake in them is named."""

from __future__ import annotations

import numpy as np
import pytest

from barc_sim.lab.check.equations import NAMES, Mistake, Quantities, arguments
from barc_sim.lab.check.mistakes import MISTAKES
from barc_sim.lab.check.model import causes
from barc_sim.lab.check.results import close
from barc_sim.lab.check.situations import GENERAL, REVERSE, SITUATIONS, with_lengths
from barc_sim.vehicle.bike_model import bikeFE

LENGTHS = {
    situation: situation.lengths or (1.5, 1.5)
    for situation in (*SITUATIONS, *REVERSE, *GENERAL, with_lengths(1.2, 1.9))
}
ROWS = [(row, *LENGTHS[situation]) for situation in LENGTHS for row in situation.rows(7, 40)]
GIVEN = arguments(
    [row for row, _, _ in ROWS], [l_f for _, l_f, _ in ROWS], [l_r for _, _, l_r in ROWS]
)
EXPECTED = np.array([bikeFE(*row, l_f=l_f, l_r=l_r) for row, l_f, l_r in ROWS]).T


@pytest.mark.parametrize('name', NAMES)
def test_without_a_mistake_each_equation_is_the_references(name: str) -> None:
    assert close(Quantities(GIVEN, {})[f'{name}_next'], EXPECTED[NAMES.index(name)]).all()


@pytest.mark.parametrize('mistake', MISTAKES, ids=lambda mistake: mistake.hint[:40])
def test_every_mistake_is_named_where_it_changes_an_equation(mistake: Mistake) -> None:
    with np.errstate(all='ignore'):
        made = Quantities(GIVEN, mistake.changes)
        got = {name: np.broadcast_to(made[f'{name}_next'], len(ROWS)) for name in NAMES}
    wrong = [
        name
        for name, expected in zip(NAMES, EXPECTED, strict=True)
        if not close(got[name], expected).all()
    ]
    assert wrong
    assert causes(GIVEN, got, wrong) == dict.fromkeys(wrong, mistake.hint)


def test_no_situation_passes_through_zero_speed() -> None:
    for (row, _, _), v in zip(ROWS, EXPECTED[NAMES.index('v')], strict=True):
        assert row.v * v > 0.0 or row.v == 0.0


@pytest.mark.parametrize('name', NAMES)
def test_each_equation_has_situations_in_which_it_moves(name: str) -> None:
    rows = [
        row
        for situation in SITUATIONS
        if name in situation.concerns.split()
        for row in situation.rows(3, 40)
    ]
    moved = [abs(bikeFE(*row)[NAMES.index(name)] - getattr(row, name)) for row in rows]
    assert min(moved) > 1e-8  # ten times the tolerance
