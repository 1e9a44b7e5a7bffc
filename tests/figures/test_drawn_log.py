"""What is drawn of a log: limits of axes, readings, and where the truth or the road is unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barc_sim.figures.drawn_log import driven_road, limits, reading, with_zero_for_unknown_errors
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.plant import NoiseLevels, Plant
from barc_sim.vehicle.road import Road


@pytest.mark.parametrize(
    ('values', 'expected'),
    [
        ([0.0, 100.0], (-10.0, 110.0)),
        ([-100.0, 0.0], (-110.0, 10.0)),
        ([50.0, 100.0], (-10.0, 110.0)),  # zero is always in sight
        ([-30.0, 30.0], (-36.0, 36.0)),
        ([0.0, 0.0], (-5.0, 5.0)),
        ([np.nan, np.nan], (-5.0, 5.0)),
        ([np.nan, 100.0], (-10.0, 110.0)),
    ],
)
def test_limits_leave_room_around_the_values_and_zero(
    values: list[float], expected: tuple[float, float]
) -> None:
    assert limits(np.array(values), share=0.1, minimum=5.0) == pytest.approx(expected)


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        (8.004, '8.00 m/s'),
        (-8.0, '\N{MINUS SIGN}8.00 m/s'),
        (-0.001, '0.00 m/s'),
        (-0.0, '0.00 m/s'),
        (float('nan'), '\N{EN DASH}'),
    ],
)
def test_a_reading_is_rounded_with_its_unit(value: float, text: str) -> None:
    assert reading(value, 2, ' m/s') == text


def test_the_measurement_stands_for_a_truth_that_is_unknown() -> None:
    log = closed_loop(Plant(noise=NoiseLevels(s=0.1, v_x=0.1)), distance=1.0)
    e_s, e_v_x = log.e_s.copy(), log.e_v_x.copy()
    e_s[-1] = e_v_x[-1] = np.nan
    completed = with_zero_for_unknown_errors(replace(log, e_s=e_s, e_v_x=e_v_x))
    assert (completed.distance[-1], completed.speed[-1]) == (log.x[-1], log.v_x[-1])
    assert np.array_equal(completed.distance[:-1], log.distance[:-1])
    assert np.array_equal(completed.speed[:-1], log.speed[:-1])


def test_the_road_of_a_run_has_the_grades_that_it_drove_on() -> None:
    log, lab, s = closed_loop(), Road.lab(), np.linspace(0.0, 180.0, 500)
    there_and_back = log.map(lambda column: np.concatenate([column, column[::-1]]))

    for run in (log, there_and_back):
        road = driven_road(run)
        assert road
        assert road.grades_deg == lab.grades_deg
        np.testing.assert_allclose(road.starts, lab.starts, atol=0.1)
        np.testing.assert_allclose(road.elevation(s), lab.elevation(s), atol=0.03)
        np.testing.assert_allclose(road.horizontal(s), lab.horizontal(s), atol=0.03)


def test_a_run_without_grades_has_no_road_and_the_last_grade_continues() -> None:
    log = closed_loop()
    assert driven_road(replace(log, theta_deg=np.full(len(log), np.nan))) is None
    theta_deg = log.theta_deg.copy()
    theta_deg[700:] = np.nan  # on the steep hill
    road = driven_road(replace(log, theta_deg=theta_deg))
    assert road
    assert road.grade_deg(1000.0) == 30.0
