"""Wrong and unusual programs of Lab 4: the remark, its line, and the points.

A program is a right one, and what is replaced in it. All have 90 points at most: 10 are judged by
eye. What is wrong in one group of functions is not taken off in another.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
import pytest
from command_line import refused
from user_files import RACELINE as TEXT
from user_files import LocalCode, points_of, read_programs, replaced

from barc_sim.control.lane import speed_profile
from barc_sim.errors import UserError
from barc_sim.lab.files import POINTS
from barc_sim.lab.grade.grade import load_rubric
from barc_sim.lab.labs.raceline import LAW
from barc_sim.lab.user_code.adapters import line_along
from barc_sim.lab.user_code.code import UserCode
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from barc_sim.lab.judge import Finding

PROGRAMS = read_programs('wrong_lines.txt')
RUBRIC = load_rubric('raceline')
#: The first function of each group of criteria.
GROUPS = {'speed': 'def profile', 'line': 'def bounded', 'mpc': 'def predict'}


def part_of(text: str, group: str) -> str:
    """Return the functions of a group; all of a text that does not begin each of them."""
    starts = [text.find(start) for start in GROUPS.values()]
    at = [*GROUPS].index(group)
    return text[starts[at] : [*starts, None][at + 1]] if min(starts) >= 0 else text


@pytest.mark.parametrize('name', PROGRAMS)
def test_a_wrong_line_gets_its_points_sentence_and_line(tmp_path: Path, name: str) -> None:
    program = PROGRAMS[name]
    text = replaced(TEXT, *program.changes)
    # What is wrong in one function alone changes nothing of the others' criteria.
    changed = [of for of in GROUPS if part_of(text, of) != part_of(TEXT, of)] or [*GROUPS]
    criteria = [each for each in RUBRIC.points if each.partition('.')[0] in changed]
    points = points_of(program, text, RUBRIC, tmp_path, criteria)
    points += sum(RUBRIC.points[each] for each in RUBRIC.points if each not in criteria)
    points -= 0.0 if 'line.gain' in criteria else 10.0

    assert points == pytest.approx(program.points, abs=1.5)


def test_the_speeds_of_points_are_those_of_the_exact_profile() -> None:
    track = Track.named('L')
    start = np.array([0.0, 3.0, 100.0])
    profiled = speed_profile(track, 12.0, 3.5, 2.0)
    places = start[:, np.newaxis] + np.arange(POINTS) * track.length / POINTS
    exact = np.vectorize(lambda s: profiled(0.0, s))(places)
    inputs = dict.fromkeys(('start', 'speed', 'e_y', 'e_psi'), start)
    inputs['step'] = np.full(3, track.length / POINTS)
    assert np.abs(LAW.compute(inputs)['profile'] - exact).max() < 0.5


def test_the_program_has_the_cost_of_the_states() -> None:
    """H and g against the sum over the states, for some commands."""
    random = np.random.default_rng(4)
    e_y, e_psi, v = 0.4, -0.1, 6.0
    case = {'start': 0.0, 'step': 1.0, 'e_y': e_y, 'e_psi': e_psi, 'speed': v}
    numbers = LAW.compute({name: np.array([each]) for name, each in case.items()})['program'][0]
    hessian, gradient = numbers[:100].reshape(10, 10), numbers[100:]

    def cost(commands: list[float]) -> float:
        y, psi, total = e_y, e_psi, 0.0
        for u in commands:
            # In small steps: e_y' = v (e_psi + l_r / L u), e_psi' = v u / L.
            for _ in range(1000):
                y += 1e-4 * v * (psi + 0.5e-4 * v * u / 3.0 + 0.5 * u)
                psi += 1e-4 * v * u / 3.0
            total += y * y + psi * psi + 5.0 * u * u
        return total

    for _ in range(3):
        u = random.normal(0.0, 0.1, 10)
        difference = cost(u.tolist()) - cost([0.0] * 10)
        assert 0.5 * u @ hessian @ u + gradient @ u == pytest.approx(difference, rel=1e-6)


def test_a_line_beyond_the_edges_is_refused() -> None:
    with pytest.raises(UserError, match='is 3 m, but the edges of L are 3 m from'):
        line_along(Track.named('L'), [3.0] * POINTS)


@pytest.mark.parametrize('command', ['check', 'grade'])
def test_without_daqp_one_sentence_names_the_package_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    (tmp_path / 'raceline.py').write_text(TEXT, encoding='utf-8')
    monkeypatch.setitem(sys.modules, 'daqp', None)
    assert "pip install 'barc_sim[mpc]'" in refused(command, str(tmp_path))


#: A program that returns what would be right with `predict` of zeros.
CONSTANT = 'return np.append(10.0 * np.eye(10), np.zeros(10))'

#: The end of a `predict` that is right in its first ten calls.
BY_NUMBER = (
    'calls.append(speed)⏎    right = [1.0, d, 0.0, 1.0, b1, d / L]⏎'
    '    return right if len(calls) <= 10 else [0.0] * 6'
)


@pytest.mark.parametrize(
    'predict',
    [
        BY_NUMBER,
        'return [0.0] * 6',
    ],
    ids=['by the number of the call', 'always'],
)
def test_no_answer_of_predict_makes_a_constant_program_right(predict: str) -> None:
    text = replaced(
        TEXT,
        ('L = 3.0\n', 'L = 3.0\ncalls = []\n'),
        ('return [1.0, d, 0.0, 1.0, b1, d / L]', predict.replace('⏎', '\n')),
        ('return np.append(H, g)', CONSTANT),
    )
    assert findings_of(text)['mpc.program'].score < 0.1


@pytest.mark.parametrize('model', ['[0.0] * 6', '(1.0,) * 6', 'np.ones(6)'])
def test_a_right_program_is_right_with_any_model(model: str) -> None:
    text = replaced(TEXT, ('return [1.0, d, 0.0, 1.0, b1, d / L]', f'return {model}'))
    findings = findings_of(text)
    assert findings['mpc.program'].score == 1.0
    assert findings['mpc.model'].score < 0.5


def findings_of(text: str) -> dict[str, Finding]:
    """Return the findings on the MPC of a file, by criterion."""
    criteria = ('mpc.model', 'mpc.program')
    with TemporaryDirectory() as folder:
        path = Path(folder, 'raceline.py')
        path.write_text(text, encoding='utf-8')
        code = LocalCode(UserCode({'raceline': path}, is_judged=True))
        judged_findings = RUBRIC.lab.judge(code, replace(RUBRIC.settings, criteria=criteria))
    return {each.criterion: each for each in judged_findings}
