"""What loops are driven on."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from barc_sim.control.pid import speed_controller
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.tuning.batch import Course
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.sensor import NoiseLevels


def test_the_default_course_is_the_run() -> None:
    ours, run = Course().drive(speed_controller()), closed_loop()
    assert ours.x.tobytes() == run.x.tobytes()
    assert ours.motor.tobytes() == run.motor.tobytes()


def test_the_noise_is_that_of_a_run_with_the_seed() -> None:
    course = Course(noise=0.2, seed=7)
    run = closed_loop(Plant(noise=NoiseLevels(v_x=0.2), seed=7))
    assert run.e_v_x.tolist() == list(course.errors[: len(run)])


def test_a_loop_is_given_up_after_thrice_the_time_that_it_should_take() -> None:
    course = Course(speed=4.0, distance=100.0, limit=8.0)
    assert course.max_duration == 3.0 * (100.0 / 4.0 + 4.0 / 8.0)
    assert len(course.drive(speed_controller(0.0, 0.0, 0.0))) == course.steps + 1


def test_a_course_can_be_sent_to_another_process() -> None:
    course = Course(noise=0.1)
    errors = course.errors
    copy = pickle.loads(pickle.dumps(course))  # noqa: S301 (our own)
    assert copy == course
    assert copy.errors == errors


@pytest.mark.parametrize('delay', [0, 4])
def test_a_delay_makes_the_loop_worse(delay: int) -> None:
    log = Course(delay=delay).drive(speed_controller(20.0, 100.0, 0.0))
    error = float(np.sqrt(np.mean(log.speed_error[log.distance >= 10.0] ** 2)))
    assert (error > 0.1) == bool(delay)
