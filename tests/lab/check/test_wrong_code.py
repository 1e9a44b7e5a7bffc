"""Wrong code gets less than full marks, and a sentence on its mistake.

`test_mistakes` tries every mistake of the tables, `student_code` whole submissions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import replaced, user_text

from barc_sim.lab.labs.hills import FUNCTIONS, HILLS, judge_terms

if TYPE_CHECKING:
    from collections.abc import Callable

    from user_files import LocalCode

    from barc_sim.lab.judge import Finding

    Lab = Callable[..., LocalCode]


def of_model(code: LocalCode) -> list[Finding]:
    return FUNCTIONS.judge(code, seed=0)[0]


def of_pid(code: LocalCode) -> dict[str, Finding]:
    return {finding.criterion: finding for finding in judge_terms(code, seed=0).findings}


def failed(findings: dict[str, Finding]) -> set[str]:
    return {name for name, finding in findings.items() if finding.score < 1.0}


@pytest.mark.parametrize(
    ('body', 'words'),
    [
        ('    pass', 'is its return missing?'),
        ('    return [0.0, 0.0, 0.0, 0.0]', 'is always 0'),
    ],
)
def test_an_empty_model_gets_zero(lab: Lab, model: str, body: str, words: str) -> None:
    code = lab(f'{model[: model.index("    beta")]}{body}\n')
    findings = of_model(code)
    assert [finding.score for finding in findings] == [0.0] * 4
    assert all(words in finding.message for finding in findings)


@pytest.mark.parametrize('body', ['raise NotImplementedError', 'pass', 'return 0.0', 'return 3.0'])
def test_an_empty_pid_gets_zero(lab: Lab, controller: str, body: str) -> None:
    head, acc, _ = controller.partition('    def acc_calculate')
    text = f'{head}{acc}(self, speed_reference, speed_current):\n        {body}\n'
    assert [finding.score for finding in of_pid(lab(controller=text)).values()] == [0.0] * 3


def test_random_outputs_are_named(lab: Lab, controller: str) -> None:
    text = 'import random\n' + controller.replace('return max(', 'return random.random() + max(')
    findings = of_pid(lab(controller=text))
    assert len(failed(findings)) == 3
    for name in failed(findings):
        assert 'the same speeds give different outputs' in findings[name].message


#: A PID that answers by the number of the call, and the error.
BY_CALL = user_text('pid_by_call.py')


@pytest.mark.parametrize(
    'state',
    [
        '[1.7e308, -1.7e308, 1.7e308, -1.7e308]',
        '[1e-320] * 4',
        '[x + 0.02 * v, y, psi, v - 1e200]',
        '[x + 1e5 * v, y, psi, 1e3 * v + 1.0]',
    ],
)
def test_no_state_scores_by_chance_or_warns(lab: Lab, model: str, state: str) -> None:
    text = replaced(model, ('[x_next, y_next, psi_next, v_next]', state))
    assert all(0.0 <= finding.score < 0.4 for finding in HILLS.judge(lab(text)))


@pytest.mark.parametrize(
    'answer',
    ['1.7e308', '1.7e308 * (-1) ** k', '1e-320', '1e200 * e', '1.7e308 if k == 1 else 0.0'],
)
def test_no_acceleration_scores_by_chance_or_warns(lab: Lab, answer: str) -> None:
    findings = HILLS.judge(lab(controller=BY_CALL.replace('ANSWER', answer)))
    assert all(0.0 <= finding.score <= 1.0 for finding in findings)
    assert [finding.score for finding in findings[4:7]] == [0.0] * 3
