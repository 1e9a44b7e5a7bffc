"""Loops one by one and in batches: those of `closed_loop`, to the last bit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import strategies as st

from barc_sim.control.speed import speed_controller
from barc_sim.simulation.metrics import RUN_UP
from barc_sim.tuning import batch
from barc_sim.tuning.batch import Course, Sums
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log


HILLS = Road((0.0, 4.0, 9.0, 20.0, 30.0), (0.0, 35.0, -50.0, 12.0, -3.0))
VALLEY = Road((0.0, 12.0, 13.0, 25.0), (-30.0, -30.0, 54.0, 0.0))
COURSES = {
    'lab': Course(),
    'noise and delay': Course(distance=60.0, noise=0.3, seed=5, delay=0.06),
    'slow, so that the noise moves it backwards': Course(
        road=Road.flat(), distance=12.0, speed_reference=0.5, noise=2.0
    ),
    'hills': Course(road=HILLS, distance=45.0, delay=0.02),
    'rolling back in a valley': Course(road=VALLEY, distance=30.0, speed_reference=2.0, delay=0.18),
    'too steep for all': Course(road=Road((0.0, 5.0), (0.0, 85.0)), distance=40.0),
}
GAINS = np.vstack(
    [np.random.default_rng(0).random((40, 3)) * [60.0, 900.0, 1.0], [[0.0] * 3, [1.0, 0.1, 0.0]]]
)


def of_log(course: Course, log: Log) -> Sums:
    """Return the sums of a loop from its log, in the order of the states."""
    arrived = log.x[-1] >= course.distance or log.distance[-1] >= course.distance
    speed = log.v_x - log.e_v_x
    after = np.abs(log.reference - speed)[log.distance >= RUN_UP]
    first = np.logical_and.accumulate(log.theta_deg == log.theta_deg[0])
    return Sums(
        steps=len(log) - 1 if arrived else -1,
        squares=sum((after**2).tolist()),
        count=len(after),
        maximum=after.max(initial=0.0),
        peak=speed[first].max(),
        effort=sum((log.motor**2).tolist()),
    )


def assert_same(ours: Sums, theirs: Sums, *, noise: float) -> None:
    """Assert the same steps, and the same sums of those that arrive, to the last bit.

    With noise a log has the true speed to rounding only.
    """
    np.testing.assert_array_equal(ours.steps, theirs.steps)
    arrived = np.asarray(theirs.steps) >= 0
    tolerance = 1e-12 if noise else 0.0
    for name, left, right in zip(Sums._fields, ours, theirs, strict=True):
        known = np.where(arrived, left, 0), np.where(arrived, right, 0)
        np.testing.assert_allclose(*known, rtol=tolerance, atol=tolerance, err_msg=name)


def one_by_one(course: Course, gains: NDArray[np.float64]) -> Sums:
    logs = [
        course.drive(speed_controller(*each, limit=course.acceleration_limit))
        for each in gains.tolist()
    ]
    rows = [of_log(course, log) for log in logs]
    return Sums(*(np.array(column) for column in zip(*rows, strict=True)))


@pytest.mark.parametrize('name', COURSES)
@pytest.mark.parametrize('block', [1, 7, batch.BLOCK])
def test_a_batch_is_its_closed_loops_to_the_last_bit(name: str, block: int) -> None:
    course, gains = COURSES[name], GAINS[:: 1 if block == batch.BLOCK else 10]
    found = batch.run_batch(course, gains, block)
    assert_same(found, one_by_one(course, gains), noise=course.noise)


grades = st.floats(-50.0, 50.0)


def test_some_loops_of_the_courses_arrive_and_some_do_not() -> None:
    arrived = {name: batch.run_batch(course, GAINS).steps >= 0 for name, course in COURSES.items()}
    assert arrived['lab'].any()
    assert not arrived['lab'].all()
    assert not arrived['too steep for all'].any()
    assert arrived['slow, so that the noise moves it backwards'].any()
    assert arrived['rolling back in a valley'].any()


def test_a_loop_is_given_up_after_thrice_the_time_that_it_should_take() -> None:
    course = Course(speed_reference=4.0, distance=100.0, acceleration_limit=8.0)
    assert course.max_duration == 3.0 * (100.0 / 4.0 + 4.0 / 8.0)
    assert len(course.drive(speed_controller(0.0, 0.0, 0.0))) == course.steps + 1
