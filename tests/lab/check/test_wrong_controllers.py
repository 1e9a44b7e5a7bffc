"""A wrong PID gets less than full marks, and a sentence on its mistake."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import replaced

from barc_sim.lab.check.controller import judge_controller

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.lab.check.code import LocalCode
    from barc_sim.lab.check.findings import Finding

    Lab = Callable[..., LocalCode]

#: What is replaced, by what; the criteria that are not met then; a part of the first one's message.
#: More are in `student_code`.
WRONG = {
    'no proportional': ('self.kp * e + ', '', 'proportional', 'P is always 0'),
    'own kp': ('self.kp * e', '2.0 * e', 'proportional integral derivative', 'kp has no effect'),
    'kp squared': ('self.kp * e', 'self.kp**2 * e', 'proportional', 'kp is in P twice'),
    'abs': ('self.kp * e', 'self.kp * abs(e)', 'proportional windup', 'do not use abs'),
    'another dt': ('e * dt', 'e * 0.05', 'dt', 'I uses dt = 0.05 s'),
    'P times dt': ('self.kp * e', 'self.kp * e * dt', 'dt', 'P is multiplied by dt'),
    'twice P': ('self.kp * e', '2 * self.kp * e', 'dt', 'P is multiplied by 2: it is kp * e'),
    'no sum': ('self.area + e', 'e', 'integral windup', 'I has no memory'),
    'no bounds at all': (
        'return max(-8.0, min(8.0, out))',
        'self.n = -getattr(self, "n", 1e308); return self.n',
        'proportional integral derivative windup reset',
        'the gains that PID gets have no effect',
    ),
    'windup': ('if abs(out) < 8.0', 'if True', 'windup', 'the integral winds up'),
    'D backwards': ('e - self.before', 'self.before - e', 'derivative', 'D has the wrong sign'),
    'D times dt': ('change / dt', 'change * dt', 'dt', 'D is multiplied by dt'),
    'kp in all': (
        'self.ki * area + self.kd * change / dt',
        'self.kp * (self.ki * area + self.kd * change / dt)',
        'integral derivative',
        'kp multiplies the ki term, too',
    ),
}


def judge(code: LocalCode) -> dict[str, Finding]:
    return {finding.criterion: finding for finding in judge_controller(code, seed=0)}


def failed(findings: dict[str, Finding]) -> set[str]:
    return {name for name, finding in findings.items() if finding.score < 1.0}


@pytest.mark.parametrize('name', WRONG)
def test_the_cause_is_named(lab: Lab, controller: str, name: str) -> None:
    old, new, criteria, words = WRONG[name]
    findings = judge(lab(controller=replaced(controller, (old, new))))
    names = [f'pid.{criterion}' for criterion in criteria.split()]
    others = {'pid.first_call'} | ({'pid.dt'} - {*names})
    assert failed(findings) - others == set(names)
    assert words in findings[names[0]].message


def test_random_answers_are_named(lab: Lab, controller: str) -> None:
    text = 'import random\n' + controller.replace('return max(', 'return random.random() + max(')
    findings = judge(lab(controller=text))
    assert findings['pid.reset'].score == 0.0
    assert len(failed(findings)) > 3
    for name in failed(findings):
        assert 'the same speeds give different outputs' in findings[name].message


KEPT = """\
class kept:
    area = 0.0
    before = None
"""


def test_state_kept_across_runs_is_named(lab: Lab, controller: str) -> None:
    text = controller
    for name in ('area', 'before'):
        text = text.replace(f'        self.{name} = 0.0\n', '').replace(
            f'        self.{name} = None\n', ''
        )
        text = text.replace(f'self.{name}', f'kept.{name}')
    text = text.replace('    def reset(self):\n', '')
    findings = judge(lab(controller=f'{KEPT}\n\n{text}'))
    assert findings['pid.reset'].score == 0.0
    message = findings['pid.reset'].message
    assert 'one run changes the next (the integral and the last error)' in message
    assert 'global or class variable' in message
    assert failed(findings) == {'pid.reset'}


def test_a_clock_is_told_from_state_kept_across_runs(lab: Lab, controller: str) -> None:
    text = controller.replace('dt = 0.02', 'dt = next(clock)')
    text = f'from itertools import count\n\nclock = (1e-5 * k for k in count(1))\n\n\n{text}'
    findings = judge(lab(controller=text))
    assert findings['pid.reset'].score == 0.0
    assert 'It is called every 0.02 s' in findings['pid.reset'].message


@pytest.mark.parametrize(
    ('lines', 'words'),
    [
        (['area'], 'reset() does not clear the integral'),
        (['before'], 'reset() does not clear the last error'),
        (['area', 'before'], 'reset() does not clear the integral and the last error'),
    ],
)
def test_a_reset_that_forgets_too_little_is_named(
    lab: Lab, controller: str, lines: list[str], words: str
) -> None:
    head, reset, tail = controller.partition('    def reset(self):\n')
    body, acc, rest = tail.partition('    def acc_calculate')
    for name in lines:
        body = ''.join(line for line in body.splitlines(keepends=True) if name not in line)
    findings = judge(lab(controller=f'{head}{reset}        "Start anew."\n{body}\n{acc}{rest}'))
    assert failed(findings) == {'pid.reset'}
    assert findings['pid.reset'].message == words


@pytest.mark.parametrize('body', ['raise NotImplementedError', 'pass', 'return 0.0', 'return 3.0'])
def test_an_empty_template_gets_zero(lab: Lab, controller: str, body: str) -> None:
    head, acc, _ = controller.partition('    def acc_calculate')
    text = f'{head}{acc}(self, speed_reference, speed_current):\n        {body}\n'
    findings = judge(lab(controller=text))
    assert [finding.score for finding in findings.values()] == [0.0] * 7
