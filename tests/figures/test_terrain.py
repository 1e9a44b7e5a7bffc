"""The road on the map."""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians
from typing import TYPE_CHECKING

import numpy as np
import pytest

from barc_sim.figures.side_view import Terrain
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from barc_sim.simulation.log import Log


@pytest.fixture(scope='module')
def log() -> Log:
    return closed_loop()


def test_twenty_metres_at_ten_degrees_are_19_696_on_the_map(log: Log) -> None:
    x, _ = Terrain(log).at(np.array([22.0, 38.0]))
    assert np.diff(x) == pytest.approx(16.0 * cos(radians(10.0)), abs=1e-9)
    # From kink to kink it is right to where between two states a kink lies.
    x, _ = Terrain(log).at(np.array([20.0, 40.0]))
    assert np.diff(x) == pytest.approx(19.696, abs=2e-3)


def test_elevation_is_that_of_the_road(log: Log) -> None:
    s = np.linspace(0.0, 180.0, 500)
    road = Road.lab()
    expected = [road.elevation(distance) for distance in s]
    assert Terrain(log).at(s)[1] == pytest.approx(expected, abs=0.03)


def test_driving_back_over_the_same_road_changes_nothing(log: Log) -> None:
    there_and_back = log.map(lambda column: np.concatenate([column, column[::-1]]))
    once, twice = Terrain(log), Terrain(there_and_back)
    assert np.array_equal(once.distance, twice.distance)
    assert np.array_equal(once.horizontal, twice.horizontal)


def test_beyond_what_was_driven_the_last_grade_goes_on() -> None:
    uphill = closed_loop(distance=30.0)
    (near, far), (low, high) = Terrain(uphill).at(uphill.distance[-1] + np.array([0.0, 10.0]))
    assert far - near == pytest.approx(10.0 * cos(radians(10.0)))
    assert (high - low) / (far - near) == pytest.approx(np.tan(radians(10.0)))


def test_a_run_that_did_not_record_its_road_was_on_the_flat(log: Log) -> None:
    unknown = np.full(len(log), np.nan)
    terrain = Terrain(replace(log, theta_deg=unknown, elevation=unknown))
    assert not np.any(terrain.elevation)
    assert terrain.at(100.0)[0] == pytest.approx(100.0)


def test_states_without_a_grade_leave_no_hole_in_the_road(log: Log) -> None:
    theta_deg, elevation = log.theta_deg.copy(), log.elevation.copy()
    theta_deg[700:] = elevation[700:] = np.nan  # on the steep hill
    terrain = Terrain(replace(log, theta_deg=theta_deg, elevation=elevation))
    x, y = terrain.at(log.distance[699] + np.array([0.0, 5.0]))
    assert np.diff(y) / np.diff(x) == pytest.approx(np.tan(np.radians(log.theta_deg[699])))


def test_a_single_state_is_a_road() -> None:
    terrain = Terrain(closed_loop(max_duration=0.0))
    assert terrain.at(5.0) == (pytest.approx(5.0), 0.0)


def test_a_wheel_touches_the_road_and_nowhere_sinks_in(log: Log) -> None:
    terrain, radius = Terrain(log), 0.36
    centre_x, centre_y = terrain.wheel_path(radius)
    near = slice(4000, len(centre_x) - 4000, 37)
    road_x = np.linspace(-1.0, 1.0, 401) + centre_x[near, np.newaxis]
    road_y = np.interp(road_x, terrain.horizontal, terrain.elevation)
    gap = np.hypot(road_x - centre_x[near, np.newaxis], road_y - centre_y[near, np.newaxis]).min(
        axis=1
    )
    assert gap == pytest.approx(radius, abs=2e-3)
