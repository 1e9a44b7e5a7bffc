"""Messages have the names that students know, not those of the laws."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from user_files import LANE, LocalCode, replaced

from barc_sim.lab.grade.grade import load_rubric
from barc_sim.lab.labs.lane import LANE as LAB
from barc_sim.lab.user_code.code import UserCode

if TYPE_CHECKING:
    from pathlib import Path

LAST_LINES = {
    'steady': ('def steady(curvature):', 'e_psi of steady', 'delta of steady'),
    'straight_errors': (
        'def straight_errors(x, y, psi, x_0, y_0, psi_0):',
        'e_psi of straight_errors',
        'e_y of straight_errors',
    ),
    'arc_errors': (
        'def arc_errors(x, y, psi, x_c, y_c, radius):',
        'e_psi of arc_errors',
        'e_y of arc_errors',
    ),
}


@pytest.mark.parametrize('returned', ['0.3, 0.4', 'sum(locals().values()) ** 2, 0.4'])
@pytest.mark.parametrize('name', LAST_LINES)
def test_a_wrong_result_has_the_name_of_its_function(
    tmp_path: Path, name: str, returned: str
) -> None:
    head, *expected = LAST_LINES[name]
    text = replaced(LANE, (head, f'{head}\n    return [{returned}]'))
    (tmp_path / 'lane.py').write_text(text, encoding='utf-8')
    code = LocalCode(UserCode({'lane': tmp_path / 'lane.py'}, is_judged=True))
    criteria = [each for each in LAB.labels if each.startswith(('errors.', 'steady.'))]
    findings = LAB.judge(code, replace(load_rubric('lane').settings, criteria=criteria))
    messages = ' '.join(each.message for each in findings if not each.passed)
    assert all(each in messages for each in expected)
    assert name.partition('_')[0] + '_e_psi' not in messages
