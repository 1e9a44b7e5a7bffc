"""What a loop costs."""

from __future__ import annotations

import numpy as np
import pytest

from barc_sim.control.pid import speed_controller
from barc_sim.errors import UserError
from barc_sim.simulation.metrics import summary
from barc_sim.tuning import batch
from barc_sim.tuning.batch import Course
from barc_sim.tuning.goal import Cost, Scores, scores

GAINS = np.array([[30.0, 200.0, 0.1], [10.0, 20.0, 0.0], [0.01, 0.0, 0.0]])


def test_scores_are_the_metrics_of_the_run() -> None:
    course = Course()
    ours = scores(course, batch.run_batch(course, GAINS))
    for i, gains in enumerate(GAINS[:2].tolist()):
        log = course.drive(speed_controller(*gains))
        told = summary(log)
        assert ours.rms[i] == told.rms_error_after_run_up
        assert ours.max[i] == told.max_error_after_run_up
        assert ours.overshoot[i] == told.overshoot
        assert ours.effort[i] == pytest.approx(np.sqrt(np.mean(log.motor**2)), rel=1e-12)


def test_a_car_that_never_arrives_costs_infinitely_much() -> None:
    course = Course()
    ours = scores(course, batch.run_batch(course, GAINS))
    for score in ours:
        assert np.isinf(score).tolist() == [False, False, True]
    assert np.isinf(Cost.parse('rms + 2*max').of(ours)).tolist() == [False, False, True]


SCORES = Scores(*(np.array([value, 10.0 * value]) for value in (1.0, 2.0, 3.0, 4.0)))


@pytest.mark.parametrize(
    ('text', 'cost'),
    [
        ('rms', 1.0),
        ('max', 2.0),
        ('overshoot', 3.0),
        ('effort', 4.0),
        ('rms+0.01*effort', 1.04),
        (' 2 * rms + max ', 4.0),
        ('1e+1*rms+1e-1*max', 10.2),
        ('rms+rms', 2.0),
    ],
)
def test_a_cost_is_a_weighted_sum(text: str, cost: float) -> None:
    parsed = Cost.parse(text)
    assert parsed.of(SCORES) == pytest.approx([cost, 10.0 * cost])
    assert str(parsed) == text


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [
        ('', "term '' of cost ''"),
        ('speed', "term 'speed' of cost 'speed' must be one of rms, max, overshoot or effort"),
        ('rms+', "term '' of cost"),
        ('rms-max', "term 'rms-max'"),
        ('rms*2', "term 'rms*2'"),
        ('2*3*rms', "term '2*3*rms'"),
        ('x*rms', "weight 'x' in cost 'x*rms' must be a positive number"),
        ('-1*rms', "weight '-1'"),
        ('0*rms', "weight '0'"),
        ('nan*rms', "weight 'nan'"),
        ('inf*rms', "weight 'inf'"),
    ],
)
def test_a_cost_that_is_none_is_refused(text: str, complaint: str) -> None:
    with pytest.raises(UserError) as error:
        Cost.parse(text)
    assert complaint in str(error.value)


def test_an_axis_names_a_plain_score_with_its_unit_and_else_the_sum() -> None:
    assert Cost.parse('rms').label == 'RMS speed error [m/s]'
    assert Cost.parse('2*rms').label == 'Cost: 2*rms'
    assert Cost.parse('rms+max').label == 'Cost: rms+max'
