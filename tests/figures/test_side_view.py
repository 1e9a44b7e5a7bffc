"""The replay of a run on hills: its road on the map, and the car on it."""

from __future__ import annotations

from dataclasses import replace
from math import atan2, cos, degrees, pi, radians
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.text import Text

from barc_sim.figures.output import SIZE
from barc_sim.figures.side_view import SideView, Terrain
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.bike_model import WHEEL_RADIUS
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


def view_of(log: Log) -> SideView:
    view = SideView(log, Figure(figsize=SIZE, dpi=100), title='a run')
    FigureCanvasAgg(view.figure).draw()
    return view


def time_at(log: Log, distance: float) -> float:
    return float(np.interp(distance, log.distance, log.t))


def wheels(view: SideView) -> list[Circle]:
    return [
        artist
        for artist in view.artists
        if isinstance(artist, Circle) and artist.radius == WHEEL_RADIUS
    ]


def on_screen(wheel: Circle, point: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
    """Return where a point of the wheel, given from its middle in metres, is in pixels."""
    x, y = wheel.get_data_transform().transform(point)
    return float(x), float(y)


def texts(view: SideView) -> set[str]:
    return {
        artist.get_text()
        for artist in view.artists
        if isinstance(artist, Text) and artist.get_visible()
    }


@pytest.mark.parametrize(
    ('distance', 'grade'), [(10.0, 0.0), (30.0, 10.0), (70.0, -10.0), (110.0, 30.0), (150.0, -30.0)]
)
def test_the_car_is_pitched_as_the_road_is_on_the_screen(
    log: Log, distance: float, grade: float
) -> None:
    view = view_of(log)
    view.update(time_at(log, distance))
    (rear_x, rear_y), (front_x, front_y) = (on_screen(wheel) for wheel in wheels(view))
    assert degrees(atan2(front_y - rear_y, front_x - rear_x)) == pytest.approx(grade, abs=0.05)


def test_the_wheels_roll_forward_by_the_distance_driven(log: Log) -> None:
    view = view_of(log)
    quarter = 2.0 * pi * WHEEL_RADIUS / 4.0
    angles = []
    for distance in (5.0, 5.0 + quarter):
        view.update(time_at(log, distance))
        (x, y), (edge_x, edge_y) = (
            on_screen(wheels(view)[0], point) for point in [(0.0, 0.0), (WHEEL_RADIUS, 0.0)]
        )
        angles.append(atan2(edge_y - y, edge_x - x))
    assert (angles[0] - angles[1]) % (2.0 * pi) == pytest.approx(pi / 2.0, abs=0.05)


def test_readings_are_those_of_the_time_shown(log: Log) -> None:
    view = view_of(log)
    t = time_at(log, 150.0)
    view.update(t)
    k = int(np.searchsorted(log.t, t)) - 1
    command = f'{log.motor[k]:.2f} m/s²'.replace('-', '\N{MINUS SIGN}')
    assert {f'{t:.2f} s', '8.00 m/s', '\N{MINUS SIGN}30°', command} <= texts(view)


def test_a_command_holds_until_the_next_state(log: Log) -> None:
    view = view_of(log)
    view.update(0.019)
    assert '8.00 m/s²' in texts(view)
    held = replace(log, motor=np.arange(len(log), dtype=float))
    view = view_of(held)
    for k in (7, 29, 57):  # times that are no exact binary numbers
        view.update(k / 50)
        assert f'{k:.2f} m/s²' in texts(view)


def test_posts_show_the_distance(log: Log) -> None:
    view = view_of(log)
    view.update(time_at(log, 111.0))
    assert {'110 m', '120 m'} <= texts(view)
    assert not {'0 m', '180 m'} & texts(view)


def test_a_run_without_controller_has_dashes_and_no_reference(log: Log) -> None:
    unknown = np.full(len(log), np.nan)
    view = view_of(replace(log, reference=unknown, motor=unknown))
    view.update(3.0)
    assert '\N{EN DASH}' in texts(view)
    assert 'reference' not in [artist.get_label() for artist in view.artists]
    assert 'reference' in [artist.get_label() for artist in view_of(log).artists]


def test_a_single_state_is_shown() -> None:
    view = view_of(closed_loop(max_duration=0.0))
    view.update(0.0)
    assert view.duration == 0.0
    assert '0.00 s' in texts(view)


def test_30_degrees_stay_30_degrees_in_a_window_of_another_shape(log: Log) -> None:
    view = view_of(log)
    for size in [(6.0, 9.0), (16.0, 4.0)]:
        view.figure.set_size_inches(size)
        view.figure.canvas.draw()
        view.update(time_at(log, 110.0))
        (x, y), (front_x, front_y) = (on_screen(wheel) for wheel in wheels(view))
        assert degrees(atan2(front_y - y, front_x - x)) == pytest.approx(30.0, abs=0.2)
