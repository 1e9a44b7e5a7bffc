"""The car from the side: where it is on the screen, and what is written."""

from __future__ import annotations

from dataclasses import replace
from math import atan2, degrees, hypot, pi
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.text import Text

from barc_sim.figures.side_view import SIZE, SideView
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.bike_model import WHEEL_RADIUS, Vehicle

if TYPE_CHECKING:
    from barc_sim.simulation.log import Log


@pytest.fixture(scope='module')
def log() -> Log:
    return closed_loop()


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


def test_the_car_is_to_scale(log: Log) -> None:
    view = view_of(log)
    view.update(time_at(log, 110.0))
    rear, front = wheels(view)
    (x, y), (front_x, front_y) = on_screen(rear), on_screen(front)
    edge_x, edge_y = on_screen(rear, (WHEEL_RADIUS, 0.0))
    pixels_per_metre = hypot(edge_x - x, edge_y - y) / WHEEL_RADIUS
    vehicle = Vehicle()
    assert hypot(front_x - x, front_y - y) / pixels_per_metre == pytest.approx(
        vehicle.l_f + vehicle.l_r, abs=0.01
    )


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
