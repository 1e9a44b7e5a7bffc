"""Wrong code gets less than full marks, and a sentence on its mistake.

`test_mistakes` tries every mistake of the tables, `student_code` whole submissions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import replaced

from barc_sim.lab.judge import Settings
from barc_sim.lab.labs.hills import HILLS, judge_model
from barc_sim.lab.labs.pid import judge_controller

if TYPE_CHECKING:
    from collections.abc import Callable

    from user_files import LocalCode

    from barc_sim.lab.judge import Finding

    Lab = Callable[..., LocalCode]

#: What is replaced, by what; the equations that are wrong on the lab's road, where none is the
#: criterion beyond it; a part of the first message.
MODELS = {
    'ts of x': ('x + ts', 'x + 0.02', '', 'ts is always 0.02 in x_next'),
    'no reverse': ('i_next, v_next]', 'i_next, max(v_next, 0.0)]', '', 'the car can reverse'),
}
CONTROLLERS = {
    'windup': ('if abs(output) < 8.0', 'if True', 'windup', 'the integral winds up'),
    'no bounds at all': (
        'return max(-8.0, min(8.0, output))',
        'self.n = -getattr(self, "n", 1e308); return self.n',
        'proportional integral derivative windup reset',
        'the gains that PID gets have no effect',
    ),
}


def of_model(code: LocalCode) -> list[Finding]:
    return [*judge_model(code, seed=0)]


def of_pid(code: LocalCode) -> dict[str, Finding]:
    return {finding.criterion: finding for finding in judge_controller(code, seed=0)}


def failed(findings: dict[str, Finding]) -> set[str]:
    return {name for name, finding in findings.items() if finding.score < 1.0}


@pytest.mark.parametrize('name', MODELS)
def test_the_mistake_in_a_model_is_named(lab: Lab, model: str, name: str) -> None:
    old, new, equations, words = MODELS[name]
    findings = HILLS.judge(lab(replaced(model, (old, new))), Settings(seed=0))
    wrong = [f for f in findings[:5] if f.score < 1.0]
    # A mistake in an equation is not counted again beyond the lab's road.
    of_road = [f'model.{name}' for name in equations.split()]
    beyond = {'model.general'} & {f.criterion for f in wrong}
    assert [f.criterion for f in wrong if f.criterion not in beyond] == of_road
    assert bool(beyond) != bool(of_road)
    assert all(words in finding.message for finding in wrong)


@pytest.mark.parametrize('name', CONTROLLERS)
def test_the_mistake_in_a_pid_is_named(lab: Lab, controller: str, name: str) -> None:
    old, new, criteria, words = CONTROLLERS[name]
    findings = of_pid(lab(controller=replaced(controller, (old, new))))
    names = [f'pid.{criterion}' for criterion in criteria.split()]
    if names:
        assert failed(findings) == set(names)
    assert words in findings[names[0] if names else 'pid.proportional'].message


@pytest.mark.parametrize(
    ('body', 'words'),
    [
        ('    pass', 'is its return missing?'),
        ('    return [x, y, psi]', 'four finite numbers'),
        ('    return [x, y, psi, float("nan")]', 'four finite numbers'),
        ('    return "x"', 'four finite numbers'),
        ('    return [0.0, 0.0, 0.0, 0.0]', 'is always 0'),
    ],
)
def test_an_empty_model_gets_zero(lab: Lab, model: str, body: str, words: str) -> None:
    code = lab(f'{model[: model.index("    beta")]}{body}\n')
    findings = of_model(code)
    assert [finding.score for finding in findings] == [0.0] * 5
    assert all(words in finding.message for finding in findings[:4])


@pytest.mark.parametrize('body', ['raise NotImplementedError', 'pass', 'return 0.0', 'return 3.0'])
def test_an_empty_pid_gets_zero(lab: Lab, controller: str, body: str) -> None:
    head, acc, _ = controller.partition('    def acc_calculate')
    text = f'{head}{acc}(self, speed_reference, speed_current):\n        {body}\n'
    assert [finding.score for finding in of_pid(lab(controller=text)).values()] == [0.0] * 5


def test_a_failure_in_reverse_costs_only_that(lab: Lab, model: str) -> None:
    code = lab(model.replace('    beta =', '    assert v >= 0, "no reverse"\n    beta ='))
    *others, beyond = of_model(code)
    assert all(finding.passed for finding in others)
    assert beyond.score < 1.0
    assert 'no reverse' in beyond.message


def test_random_outputs_are_named(lab: Lab, controller: str) -> None:
    text = 'import random\n' + controller.replace('return max(', 'return random.random() + max(')
    findings = of_pid(lab(controller=text))
    assert findings['pid.reset'].score == 0.0
    assert len(failed(findings)) > 3
    for name in failed(findings):
        assert 'the same speeds give different outputs' in findings[name].message


@pytest.mark.parametrize('names', [['total'], ['e_before'], ['total', 'e_before']])
def test_what_is_kept_across_runs_is_named(lab: Lab, controller: str, names: list[str]) -> None:
    kept = 'class kept:\n    total = 0.0\n    e_before = None\n\n\n' + controller
    cleared = controller
    for name, start in {'total': '0.0', 'e_before': 'None'}.items():
        if name in names:
            kept = kept.replace(f'        self.{name} = {start}\n', '        pass\n')
            kept = kept.replace(f'self.{name}', f'kept.{name}')
            head, reset, tail = cleared.partition('    def reset')
            tail = tail.replace(f'        self.{name} = {start}\n', '        pass\n', 1)
            cleared = head + reset + tail
    for text, words in {
        kept: 'one run changes the next',
        cleared: 'reset() does not clear',
    }.items():
        findings = of_pid(lab(controller=text))
        assert failed(findings) == {'pid.reset'}
        assert words in findings['pid.reset'].message
    assert findings['pid.reset'].score == 0.5


#: A PID that answers by the number of the call, and the error.
BY_CALL = """\
class PID:
    def __init__(self, kp, ki, kd):
        self.k = 0

    def acc_calculate(self, speed_reference, speed_current):
        self.k += 1
        k, e = self.k, speed_reference - speed_current
        return {}
"""


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
    findings = HILLS.judge(lab(controller=BY_CALL.format(answer)))
    assert all(0.0 <= finding.score <= 1.0 for finding in findings)
    assert [finding.score for finding in findings[5:8]] == [0.0] * 3
