"""Right classes `Lane` whose constructors take more than numbers: they lose nothing."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from user_files import LANE, LocalCode, replaced

from barc_sim.lab.grade.grade import load_rubric
from barc_sim.lab.labs.lane import LANE as LAB
from barc_sim.lab.user_code.adapters import UserLane
from barc_sim.lab.user_code.code import UserCode

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.lab.judge import Finding

CONSTRUCTOR = """\
    def __init__(self):
        self.k_y = 0.22
        self.k_psi = 0.95
"""
WITH_GAINS = """\
    def __init__(self, {}):
        self.k_y = k_y
        self.k_psi = k_psi
"""
#: What the constructor takes, and the gains that a run can change.
CONSTRUCTORS = {
    'none': ('k=None, k_y=0.2, k_psi=0.8', ['k_y', 'k_psi']),
    'a tuple': ('k_y=0.2, k_psi=0.8, limits=(-0.5, 0.5)', ['k_y', 'k_psi']),
    'a string': ('mode="state feedback", k_y=0.2, k_psi=0.8', ['k_y', 'k_psi']),
    'a truth': ('k_y=0.2, k_psi=0.8, feedforward=True', ['k_y', 'k_psi']),
    'a dictionary': ('k_y=0.2, k_psi=0.8, options={}', ['k_y', 'k_psi']),
    'any arguments': ('k_y=0.2, k_psi=0.8, *more, **options', ['k_y', 'k_psi']),
}
DATACLASS = """\
from dataclasses import dataclass, field
from typing import ClassVar


@dataclass
class Lane:
    limit: ClassVar[float] = 0.5
    name = 'mine'
    k_y: float = 0.2
    k_psi: float = 0.8
    past: list = field(default_factory=list)
    before: float = None
"""


def judged(folder: Path, text: str) -> list[Finding]:
    """Return the findings on the class of a `lane.py`, without its laps."""
    (folder / 'lane.py').write_text(text, encoding='utf-8')
    code = LocalCode(UserCode({'lane': folder / 'lane.py'}, is_judged=True))
    settings = replace(load_rubric('lane').settings, criteria=('lane.signs', 'lane.return'))
    return LAB.judge(code, settings)


@pytest.mark.parametrize('name', CONSTRUCTORS)
def test_a_default_that_is_no_number_costs_nothing(tmp_path: Path, name: str) -> None:
    takes, gains = CONSTRUCTORS[name]
    findings = judged(tmp_path, replaced(LANE, (CONSTRUCTOR, WITH_GAINS.format(takes))))
    assert {each.score: each.message for each in findings if not each.passed} == {}
    assert [*UserLane(UserCode({'lane': tmp_path / 'lane.py'})).gains] == gains


def test_a_dataclass_with_other_fields_and_class_variables_costs_nothing(tmp_path: Path) -> None:
    before, _, rest = LANE.partition('class Lane:\n')
    method = rest[rest.index('    def steer_calculate') :]
    findings = judged(tmp_path, f'{before}{DATACLASS}\n{method}')
    assert {each.score: each.message for each in findings if not each.passed} == {}


def test_an_argument_without_a_default_is_named(tmp_path: Path) -> None:
    findings = judged(tmp_path, replaced(LANE, (CONSTRUCTOR, WITH_GAINS.format('k_y, k_psi=0.8'))))
    assert (
        'Lane takes (k_y, k_psi), and a run passes none: expected a default' in findings[0].message
    )
