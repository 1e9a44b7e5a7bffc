"""A mistake is named only if it gives the numbers of all calls, also where few are wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import PLAIN_MODEL, LocalCode, replaced

from barc_sim.lab.grade.grade import load_rubric
from barc_sim.lab.labs.hills import BIKE, HILLS
from barc_sim.lab.user_code.code import UserCode

if TYPE_CHECKING:
    from pathlib import Path

RETURN = '    return [x_next'
#: What is added before a line of a right model: it is wrong in some of the calls.
RARE = {
    'a limit of the steering': ('    beta =', '    d_f = max(-0.49, min(0.49, d_f))'),
    'a limit of the speed': (RETURN, '    v_next = min(v_next, 19.9)'),
    'a wrap of psi to 0': (RETURN, '    if abs(psi) > 3.1: psi_next = 0.0'),
    'an end of the road': (RETURN, '    x_next = min(x_next, 196.0)'),
}


@pytest.mark.parametrize('name', RARE)
def test_an_error_in_few_calls_is_no_mistake_of_the_catalogue(tmp_path: Path, name: str) -> None:
    line, added = RARE[name]
    text = replaced(PLAIN_MODEL, (line, f'{added}\n{line}'))
    (tmp_path / 'bike_model.py').write_text(text, encoding='utf-8')
    code = LocalCode(UserCode({'model': tmp_path / 'bike_model.py'}, is_judged=True))
    findings = HILLS.judge(code, load_rubric('lab').settings)[:4]
    wrong = [each.message for each in findings if not each.passed]
    assert wrong
    for message in wrong:
        assert 'The largest error: bikeFE(' in message
        assert not any(mistake.sentence in message for mistake in BIKE.mistakes)
