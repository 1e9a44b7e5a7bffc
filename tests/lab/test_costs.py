"""What the pages say that a mistake costs is what a program with this mistake loses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import LANE, PLAIN_CONTROLLER, PLAIN_MODEL, LocalCode, replaced

from barc_sim.lab.files import FILES
from barc_sim.lab.grade.grade import load_rubric
from barc_sim.lab.labs import hills, lane
from barc_sim.lab.user_code.code import UserCode

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.lab.judge import Lab


def lost(folder: Path, part: str, text: str, lab: Lab, result_criteria: list[str]) -> list[float]:
    """Return the share that a program loses of each of these criteria."""
    path = folder / FILES[part]
    path.write_text(text, encoding='utf-8')
    settings = load_rubric(lab.handout.rubric).settings
    findings = lab.judge(LocalCode(UserCode({part: path}, is_judged=True)), settings)
    return [1.0 - each.score for each in findings if each.criterion in result_criteria]


@pytest.mark.parametrize(
    ('sentence', 'old', 'new'),
    [
        ('gravity speeds the car up uphill', '-m * g', 'm * g'),
        ('drag is half', 'a0 * v', '0.5 * a0 * v'),
        ('beta is missing in x and y', 'psi + beta', 'psi'),
    ],
)
def test_a_mistake_of_the_model(tmp_path: Path, sentence: str, old: str, new: str) -> None:
    rubric = load_rubric('lab')
    mistake = next(each for each in hills.BIKE.mistakes if each.sentence.startswith(sentence))
    trials = hills.FUNCTIONS.trials_with(mistake, rubric.settings.seed)
    weights = {name: rubric.points[key] for name, key in hills.FUNCTIONS.criteria.items()}
    costs = [1.0 - each.score for each in hills.FUNCTIONS.scores(trials, weights).values()]

    text = replaced(PLAIN_MODEL, (old, new))
    criteria = [*hills.FUNCTIONS.criteria.values()]
    assert lost(tmp_path, 'model', text, hills.HILLS, criteria) == pytest.approx(costs)
    assert any(costs)


def test_a_mistake_of_a_term(tmp_path: Path) -> None:
    seed = load_rubric('lab').settings.seed
    mistake = next(
        each for each in hills.PID_LAW.mistakes if each.sentence.startswith('P has the wrong sign')
    )
    trials = [term.trial_with(mistake, seed) for term in hills.TERMS]
    scores = hills.TERM_JUDGE.scores(trials, {term.name: 8.0 for term in hills.TERMS})
    costs = [1.0 - each.score for each in scores.values()]

    text = replaced(PLAIN_CONTROLLER, ('P = self.kp', 'P = -self.kp'))
    criteria = [term.criterion for term in hills.TERMS]
    assert lost(tmp_path, 'controller', text, hills.HILLS, criteria) == pytest.approx(costs)
    assert costs == pytest.approx([0.6, 0.0, 0.0])


def test_a_mistake_of_lane_keeping(tmp_path: Path) -> None:
    rubric = load_rubric('lane')
    mistake = next(
        each for each in lane.LAW.mistakes if each.sentence.startswith('steady returns e_psi first')
    )
    trials = lane.FUNCTIONS.trials_with(mistake, rubric.settings.seed)
    weights = {name: rubric.points[key] for name, key in lane.FUNCTIONS.criteria.items()}
    costs = [1.0 - each.score for each in lane.FUNCTIONS.scores(trials, weights).values()]

    head = 'def steady(curvature):'
    swapped = f'{head}\n    return right(curvature)[::-1]\n\n\ndef right(curvature):'
    text = replaced(LANE, (head, swapped))
    criteria = [*lane.FUNCTIONS.criteria.values()]
    assert lost(tmp_path, 'lane', text, lane.LANE, criteria) == pytest.approx(costs)
    assert any(costs)
