"""What a search minimises: scores, costs and goals; and `sweep`."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim.control.lqr import LQR
from barc_sim.errors import UserError
from barc_sim.lab.user_code.adapters import controller_of
from barc_sim.simulation.closed_loop import simulate
from barc_sim.simulation.metrics import summary
from barc_sim.tuning import batch
from barc_sim.tuning.batch import Course
from barc_sim.tuning.goal import Cost, Goal, Scores, scores, sweep

if TYPE_CHECKING:
    from pathlib import Path


GAINS = np.array([[30.0, 200.0, 0.1], [10.0, 20.0, 0.0], [0.01, 0.0, 0.0]])


def test_a_car_that_never_arrives_costs_infinitely_much() -> None:
    course = Course()
    ours = scores(course, batch.run_batch(course, GAINS))
    for score in ours:
        assert np.isinf(score).tolist() == [False, False, True]
    assert np.isinf(Cost('rms', 2.0).of(ours)).tolist() == [False, False, True]


SCORES = Scores(*(np.array([value, 10.0 * value]) for value in (1.0, 2.0, 3.0, 4.0)))


def test_a_cost_is_a_score_and_a_share_of_the_effort() -> None:
    for score, expected in zip(Scores._fields, SCORES, strict=True):
        assert Cost(score).of(SCORES).tolist() == expected.tolist()
    assert Cost('max', 0.5).of(SCORES) == pytest.approx([4.0, 40.0])
    assert Cost('rms').label == 'RMS speed error [m/s]'
    assert Cost('max', 0.5).label == 'Cost: max + 0.5 effort'


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


@pytest.fixture
def controller(tmp_path: Path) -> Path:
    path = tmp_path / 'controller.py'
    path.write_text(CONTROLLER)
    return path


def goal_of(path: Path, course: Course | None = None) -> Goal:
    return Goal((course or Course(),), Cost(), partial(controller_of, path))


@pytest.mark.parametrize('course', [Course(), Course(noise=0.1, seed=3, delay=0.04)])
def test_the_runs_own_pid_in_a_file_scores_as_it_does_in_batches(
    controller: Path, course: Course, capsys: pytest.CaptureFixture[str]
) -> None:
    ours = goal_of(controller, course).scores(course, GAINS)
    theirs = Goal((course,), Cost()).scores(course, GAINS)
    np.testing.assert_allclose(np.array(ours), np.array(theirs), rtol=1e-11)
    assert np.isinf(ours.rms).tolist() == [False, False, True]
    assert capsys.readouterr().out == ''


@pytest.mark.parametrize(
    'options',
    [
        {},
        {'noise': 0.05, 'seed': 2, 'delay': 0.04, 'ts': 1 / 333},
        {'delay': 0.03, 'integrator': 'rk4'},
    ],
)
def test_a_sweep_scores_the_runs_of_simulate(options: dict[str, Any]) -> None:
    found = sweep([10.0, 30.0], ki=100.0, distance=60.0, **options)
    for each in found:
        log = simulate(each.kp, each.ki, each.kd, distance=60.0, **options)
        expected = summary(log)
        assert each.rms_error == pytest.approx(expected.rms_error_after_run_up)
        assert each.max_error == pytest.approx(expected.max_error_after_run_up)
        assert each.overshoot == pytest.approx(expected.overshoot)
        assert each.effort == pytest.approx(np.sqrt(np.mean(log.motor**2)))


def test_gains_are_broadcast_and_the_best_is_found_by_name() -> None:
    kp, ki = np.linspace(0.0, 60.0, 20), np.linspace(0.0, 400.0, 10)
    found = sweep(kp[:, np.newaxis], ki, 0.0, distance=40.0)
    assert found.shape == (20, 10)
    assert np.isinf(found.rms_error[0, 0])
    best = found.flat[found.rms_error.argmin()]
    assert (best.kp, best.ki) == (60.0, 400.0)
    assert best.rms_error == found.rms_error.min()


def test_a_sweep_of_another_controller_is_a_table_of_its_gains() -> None:
    frame = sweep(controller=LQR(), speed_weight=[100.0, 400.0], distance=30.0).to_frame()
    assert [*frame] == [*LQR.gains, 'rms_error', 'max_error', 'overshoot', 'effort']
    assert frame.speed_weight.tolist() == [100.0, 400.0]
    expected = summary(simulate(controller=LQR(speed_weight=100.0), distance=30.0))
    assert frame.rms_error[0] == expected.rms_error_after_run_up


@pytest.mark.parametrize(
    ('gains', 'complaint'),
    [
        ({'kp': [1.0, np.nan]}, 'kp: nan is not a number from'),
        ({'kp': 1.0, 'controller': LQR()}, 'kp: the controller has no such gain, but speed_weight'),
        ({'controller': LQR(), 'observer_gain': [0.5, 2.0]}, 'observer_gain: 2 is not a number'),
    ],
)
def test_gains_that_are_none_are_refused(gains: dict[str, Any], complaint: str) -> None:
    with pytest.raises(UserError, match=complaint):
        sweep(**gains)
