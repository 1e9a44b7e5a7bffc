"""The car from above: where it is on the screen, and what is written."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from math import atan2, degrees, hypot
from typing import TYPE_CHECKING

import imageio_ffmpeg
import numpy as np
import pytest
from hand_drive import drive_by_hand
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from barc_sim.commands.figures import save
from barc_sim.commands.figures import view_of as chosen_view
from barc_sim.control.driver import FULL_BRAKE, DriverInput
from barc_sim.figures.output import SIZE
from barc_sim.figures.top_view import TopView, suits
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.bike_model import Vehicle

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.simulation.log import Log


@pytest.fixture(scope='module')
def log() -> Log:
    requests = [(0.05 * k, DriverInput(forward=1.0)) for k in range(40)]
    requests += [(2.0 + 0.05 * k, DriverInput(turn=1.0)) for k in range(60)]
    return drive_by_hand([*requests, (6.0, FULL_BRAKE)], 9.0)


def view_of(log: Log) -> TopView:
    view = TopView(log, Figure(figsize=SIZE, dpi=100), title='a run')
    FigureCanvasAgg(view.figure).draw()
    return view


def wheels(view: TopView) -> list[Rectangle]:
    """Return the wheels: the rear ones first, each pair from right to left."""
    return [artist for artist in view.artists if isinstance(artist, Rectangle)]


def on_screen(wheel: Rectangle, x: float = 0.0) -> tuple[float, float]:
    """Return where a point of the wheel, `x` metres before its middle, is in pixels."""
    place = wheel.get_data_transform().transform((x, 0.0))
    return float(place[0]), float(place[1])


def angle(a: tuple[float, float], b: tuple[float, float]) -> float:
    return degrees(atan2(b[1] - a[1], b[0] - a[0]))


def turn(a: float, b: float) -> float:
    """Return the angle from `a` to `b`, the short way, in degrees."""
    return (b - a + 180.0) % 360.0 - 180.0


def texts(view: TopView) -> set[str]:
    return {
        artist.get_text()
        for artist in view.artists
        if isinstance(artist, Text) and artist.get_visible()
    }


@pytest.mark.parametrize('t', [0.0, 2.5, 4.0, 9.0])
def test_the_car_points_where_it_is_heading_and_its_front_wheels_are_turned(
    log: Log, t: float
) -> None:
    view = view_of(log)
    view.update(t)
    k = int(np.searchsorted(log.t, t + 1e-9)) - 1
    rear, _, front, _ = wheels(view)
    heading = angle(on_screen(rear), on_screen(front))
    turned = angle(on_screen(front), on_screen(front, 0.3))
    assert turn(degrees(log.psi[k]), heading) == pytest.approx(0.0, abs=0.2)
    assert turn(heading + degrees(log.servo[k]), turned) == pytest.approx(0.0, abs=0.2)


def test_the_car_is_to_scale(log: Log) -> None:
    view = view_of(log)
    view.update(3.0)
    rear, _, front, _ = wheels(view)
    (x, y), (front_x, front_y), (edge_x, edge_y) = (
        on_screen(rear),
        on_screen(front),
        on_screen(rear, 1.0),
    )
    vehicle = Vehicle()
    metre = hypot(edge_x - x, edge_y - y)
    assert hypot(front_x - x, front_y - y) / metre == pytest.approx(vehicle.l_f + vehicle.l_r)


def test_the_path_leads_from_the_start_to_the_car(log: Log) -> None:
    view = view_of(log)
    view.update(4.0)
    path = view._scene._path  # noqa: SLF001
    points = path.get_transform().transform(np.column_stack(path.get_data()))
    middle = np.mean([on_screen(wheel) for wheel in wheels(view)], axis=0)
    assert points[-1] == pytest.approx(middle)
    assert len(points) == 202


def test_readings_are_those_of_the_time_shown(log: Log) -> None:
    view = view_of(log)
    view.update(4.0)
    k = int(np.searchsorted(log.t, 4.0 + 1e-9)) - 1
    assert {
        '4.00 s',
        f'{log.speed[k]:.2f} m/s',
        f'{degrees(log.psi[k]):.0f}°',
        f'{degrees(log.servo[k]):.1f}°',
    } <= texts(view)


def test_the_grid_shows_where_the_car_is(log: Log) -> None:
    view = view_of(log)
    view.update(0.0)
    assert {'0 m', '10 m'} <= texts(view)
    view.update(2.5)
    assert log.x[125] > 10.0
    assert '20 m' in texts(view)


def test_a_way_is_not_drawn_where_the_car_was_put_back(log: Log) -> None:
    both = log.map(lambda column: np.tile(column, 2))
    view = view_of(replace(both, t=np.arange(2 * len(log)) * 0.02))
    view.update(10.0)
    path = np.column_stack(view._scene._path.get_data())  # noqa: SLF001
    steps = np.hypot(*np.diff(path, axis=0).T)
    assert np.nanmax(steps) < 1.0
    assert np.isnan(path).any()


def test_drives_by_hand_are_seen_from_above_and_others_from_the_side(log: Log) -> None:
    assert suits(log)
    assert not suits(closed_loop(distance=5.0))
    assert not suits(replace(log, elevation=np.linspace(0.0, 5.0, len(log))))


def test_a_drive_whose_commands_are_unknown_is_shown(log: Log) -> None:
    unknown = np.full(len(log), np.nan)
    view = view_of(replace(log, motor=unknown, servo=unknown))
    view.update(3.0)
    assert '\N{EN DASH}' in texts(view)


# imageio_ffmpeg leaves it to the garbage collector to close its pipes.
@pytest.mark.filterwarnings('ignore::pytest.PytestUnraisableExceptionWarning')
def test_the_video_of_a_drive_by_hand_shows_it_from_above_at_real_speed(tmp_path: Path) -> None:
    log = drive_by_hand([(0.0, DriverInput(forward=1.0))], 0.6)
    assert isinstance(chosen_view(log, Figure(figsize=SIZE), ''), TopView)
    path = tmp_path / 'drive.mp4'
    save(log, path)
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(path)
    assert frames == 31
    assert seconds == pytest.approx(31 / 50, abs=0.03)
    with closing(imageio_ffmpeg.read_frames(path)) as reader:
        assert next(reader)['size'] == (1280, 720)
        first, *_, last = reader
    assert first != last
