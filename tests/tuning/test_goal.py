"""A user's controller in the search."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from barc_sim.errors import UserError
from barc_sim.lab.user_code.adapters import UserControllerFile
from barc_sim.tuning import workers
from barc_sim.tuning.batch import Course
from barc_sim.tuning.goal import Cost, Goal

if TYPE_CHECKING:
    from pathlib import Path

#: The PID of the run, once more, which prints at every step.
CONTROLLER = """
from barc_sim.control.pid import PID as Reference

class PID:
    def __init__(self, kp, ki, kd):
        self.pid = Reference(kp, ki, kd, output_min=-8.0, output_max=8.0)

    def acc_calculate(self, speed_reference, speed_current, dt):
        print('step', dt)
        return self.pid.acc_calculate(speed_reference, speed_current, dt)
"""
GAINS = np.array([[30.0, 200.0, 0.1], [10.0, 20.0, 0.0], [0.01, 0.0, 0.0]])


@pytest.fixture
def controller(tmp_path: Path) -> Path:
    path = tmp_path / 'controller.py'
    path.write_text(CONTROLLER)
    return path


def goal_of(path: Path, course: Course | None = None) -> Goal:
    return Goal((course or Course(),), Cost.parse('rms'), UserControllerFile(path))


@pytest.mark.parametrize('course', [Course(), Course(noise=0.1, seed=3, delay=2)])
def test_the_runs_own_pid_in_a_file_scores_as_it_does_in_batches(
    controller: Path, course: Course, capsys: pytest.CaptureFixture[str]
) -> None:
    ours = goal_of(controller, course).scores(course, GAINS)
    theirs = Goal((course,), Cost.parse('rms')).scores(course, GAINS)
    np.testing.assert_allclose(np.array(ours), np.array(theirs), rtol=1e-11)
    assert np.isinf(ours.rms).tolist() == [False, False, True]
    assert capsys.readouterr().out == ''


def test_an_output_beyond_the_limit_is_limited(tmp_path: Path) -> None:
    path = tmp_path / 'controller.py'
    path.write_text(
        'class PID:\n'
        '    def __init__(self, kp, ki, kd): self.kp = kp\n'
        '    def acc_calculate(self, r, v): return self.kp * (r - v)\n'
    )
    course = Course(limit=3.0)
    log = goal_of(path, course).log(course, np.array([100.0, 0.0, 0.0]))
    assert np.abs(log.motor).max() == 3.0
    assert log.saturated[0]
    assert not log.saturated.all()


def test_an_edited_file_counts_at_once(controller: Path) -> None:
    goal = goal_of(controller)
    before = goal(GAINS)
    controller.write_text(CONTROLLER.replace('return ', 'return 0.5 * '), encoding='utf-8')
    assert goal(GAINS)[0] > before[0]


def test_processes_share_the_work_and_give_it_back_in_order(controller: Path) -> None:
    goal = goal_of(controller, Course(distance=30.0))
    gains = np.random.default_rng(0).random((20, 3)) * [40.0, 300.0, 0.5]
    with workers.processes(goal) as cost:
        assert cost(gains).tolist() == goal(gains).tolist()


def test_what_a_controller_does_wrong_in_a_process_is_an_error(controller: Path) -> None:
    controller.write_text(CONTROLLER.replace("print('step', dt)", '1 / 0'), encoding='utf-8')
    goal = goal_of(controller)
    with (
        workers.processes(goal) as cost,
        pytest.raises(UserError, match=r'controller.py, line 9.*ZeroDivisionError'),
    ):
        cost(GAINS)


def test_a_controller_that_ends_its_process_is_an_error(controller: Path) -> None:
    controller.write_text(
        CONTROLLER.replace("print('step', dt)", 'import os; os._exit(0)'), encoding='utf-8'
    )
    goal = goal_of(controller)
    with workers.processes(goal) as cost, pytest.raises(UserError, match='has died'):
        cost(GAINS)
