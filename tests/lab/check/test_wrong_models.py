"""A wrong bikeFE gets less than full marks, and a sentence on its mistake."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import replaced

from barc_sim.lab.check.model import (
    judge_equations,
    judge_general,
    judge_reverse,
    judge_trajectory,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.lab.check.code import LocalCode

    Lab = Callable[..., LocalCode]

#: What is replaced, by what; the equations that are wrong then; words of the message.
WRONG = {
    'sign of beta': ('= atan', '= -atan', 'x y psi', 'wrong way for a left turn'),
    'no beta in x and y': ('(psi + beta)', '(psi)', 'x y', 'beta is missing in x and y'),
    'no friction': ('+ friction', '', 'v', 'rolling friction is missing'),
    'not moved': ('[x_next', '[x', 'x', 'x does not change'),
    'order': ('psi_next, v_next]', 'v_next, psi_next]', 'psi v', 'the order is [x_next, y_next'),
    'l_f for l_r in psi': ('/ l_r * sin', '/ l_f * sin', 'general', 'in place of l_r in v'),
    'its own ts': ('x + ts', 'x + 0.02', 'general', 'ts is always 0.02 in x_next'),
    'drag forwards': (
        'v**2 * sign(v)',
        'v**2',
        'reverse',
        'drag pushes the car on when it reverses',
    ),
    'no reverse': (
        'i_next, v_next]',
        'i_next, max(v_next, 0.0)]',
        'reverse',
        'the car can reverse',
    ),
}


@pytest.mark.parametrize('name', WRONG)
def test_the_cause_is_named(lab: Lab, model: str, name: str) -> None:
    old, new, equations, words = WRONG[name]
    code = lab(replaced(model, (old, new)))
    findings = judge_equations(code, seed=0)
    # Each mistake in an equation shows beyond the lab's road, too.
    if equations in {'general', 'reverse'}:
        assert all(finding.passed for finding in findings)
        judge = {'general': judge_general, 'reverse': judge_reverse}[equations]
        findings = [judge(code, seed=0)]
    wrong = {finding.criterion for finding in findings if finding.score < 1.0}
    assert wrong == {f'model.{equation}' for equation in equations.split()}
    for finding in findings:
        assert finding.criterion not in wrong or words in finding.message


def test_euler_with_the_new_speed_is_named(lab: Lab, model: str) -> None:
    lines = model.splitlines(keepends=True)
    speed = next(line for line in lines if 'v_next =' in line)
    lines.remove(speed)
    lines.insert(lines.index(next(line for line in lines if 'x_next =' in line)), speed)
    text = ''.join(lines).replace('ts * v ', 'ts * v_next ')
    findings = judge_equations(lab(text), seed=0)
    assert [finding.passed for finding in findings] == [False, False, False, True]
    assert all('the new v is used' in finding.message for finding in findings[:3])


def test_two_mistakes_at_once_are_both_named(lab: Lab, model: str) -> None:
    text = model.replace('drag + friction', 'friction').replace('(theta)', '(radians(theta))')
    *_, speed = judge_equations(lab(text), seed=0)
    assert speed.message.startswith('two mistakes: ')
    assert 'air drag is missing' in speed.message
    assert 'theta arrives in radians' in speed.message


def test_what_nothing_explains_is_shown_with_its_largest_error(lab: Lab, model: str) -> None:
    *_, speed = judge_equations(lab(model.replace('sin(theta)', 'sin(theta)**3')), seed=0)
    assert speed.message.startswith('v_next is wrong in: uphill, downhill, ')
    assert 'The largest error: bikeFE(x=' in speed.message
    assert 'expected' in speed.message


@pytest.mark.parametrize(
    ('head', 'extra'),
    [('import random', '1e-3 * random.random()'), ('calls = []', 'calls.append(0) or len(calls)')],
    ids=['random', 'global'],
)
def test_answers_that_change_are_named(lab: Lab, model: str, head: str, extra: str) -> None:
    text = f'{head}\n{model}'.replace('[x_next', f'[x_next + ({extra})')
    findings = judge_equations(lab(text), seed=0)
    assert all(finding.score == 0.0 for finding in findings)
    assert 'the same arguments give different results' in findings[0].message


@pytest.mark.parametrize(
    ('body', 'words'),
    [
        ('    raise NotImplementedError', 'TODO'),
        ('    pass', 'is its return missing?'),
        ('    return [x, y, psi]', 'four finite numbers'),
        ('    return [x, y, psi, float("nan")]', 'four finite numbers'),
        ('    return "x"', 'four finite numbers'),
        ('    return [x, y, psi, v]', 'does not change: is '),
        ('    return [0.0, 0.0, 0.0, 0.0]', 'is always 0'),
    ],
)
def test_an_empty_template_gets_zero(lab: Lab, model: str, body: str, words: str) -> None:
    head = model[: model.index('    beta')]
    code = lab(f'{head}{body}\n')
    findings = [*judge_equations(code, seed=0), judge_trajectory(code)]
    assert [finding.score for finding in findings] == [0.0] * 5
    assert all(words in finding.message for finding in findings[:4])


def test_a_failure_in_reverse_costs_only_that(lab: Lab, model: str) -> None:
    text = model.replace('    beta =', '    assert v >= 0, "no reverse"\n    beta =')
    code = lab(text)
    assert all(finding.passed for finding in judge_equations(code, seed=0))
    finding = judge_reverse(code, seed=0)
    assert finding.score == 0.0
    assert 'no reverse' in finding.message


def test_the_model_leaves_the_references_trajectory(lab: Lab, model: str) -> None:
    finding = judge_trajectory(lab(model.replace('+ gravity', '')))
    assert 0.0 < finding.score < 0.5
    assert 'leaves the reference after' in finding.message
    assert 'm/s away' in finding.message


def test_a_model_that_runs_away_is_followed_no_further(lab: Lab, model: str) -> None:
    finding = judge_trajectory(lab(model.replace('ts * (a', '1e6 * v + ts * (a')))
    assert finding.score < 0.1
    assert 'and then grows without limit' in finding.message
