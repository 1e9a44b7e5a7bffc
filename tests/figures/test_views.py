"""The car from the side and from above, where it is and what is written; and videos of it."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from math import atan2, degrees, hypot, pi
from typing import TYPE_CHECKING

import imageio_ffmpeg
import numpy as np
import pytest
from hand_drive import drive_by_hand
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.text import Text
from PIL import Image

from barc_sim.control.driver import FULL_BRAKE, DriverInput
from barc_sim.figures.views import (
    AHEAD,
    SIZE,
    SideView,
    TopView,
    frame_times,
    frames,
    view_of,
    write_gif,
    write_mp4,
)
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.bike_model import WHEEL_RADIUS, Vehicle

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.patches import Patch
    from numpy.typing import NDArray

    from barc_sim.figures.views import RunView
    from barc_sim.simulation.log import Log


@pytest.fixture(scope='module')
def hills() -> Log:
    return closed_loop()


@pytest.fixture(scope='module')
def by_hand() -> Log:
    requests = [(0.05 * k, DriverInput(forward=1.0)) for k in range(40)]
    requests += [(2.0 + 0.05 * k, DriverInput(turn=1.0)) for k in range(60)]
    return drive_by_hand([*requests, (6.0, FULL_BRAKE)], 9.0)


def view_of_log(log: Log) -> RunView:
    view = view_of(log, Figure(figsize=SIZE, dpi=50), 'a run')
    FigureCanvasAgg(view.figure).draw()
    return view


def wheels(view: RunView) -> list[Patch]:
    """Return the wheels: the rear ones first."""
    return [
        artist
        for artist in view.artists
        if isinstance(artist, Rectangle)
        or (isinstance(artist, Circle) and artist.radius == WHEEL_RADIUS)
    ]


def on_screen(wheel: Patch, x: float = 0.0) -> tuple[float, float]:
    """Return where a point of the wheel, `x` metres before its middle, is in pixels."""
    place = wheel.get_data_transform().transform((x, 0.0))
    return float(place[0]), float(place[1])


def angle(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Return the direction from `a` to `b` on the screen in degrees."""
    return degrees(atan2(b[1] - a[1], b[0] - a[0]))


def turn(a: float, b: float) -> float:
    """Return the angle from `a` to `b`, the short way, in degrees."""
    return (b - a + 180.0) % 360.0 - 180.0


def texts(view: RunView) -> set[str]:
    return {
        artist.get_text().removeprefix('|\n')
        for artist in view.artists
        if isinstance(artist, Text) and artist.get_visible()
    }


def time_at(log: Log, distance: float) -> float:
    return float(np.interp(distance, log.distance, log.t))


def test_the_car_is_pitched_as_the_road_and_rolls_in_a_window_of_any_shape(hills: Log) -> None:
    view = view_of_log(hills)
    for size in (SIZE, (6.0, 9.0), (16.0, 4.0)):
        view.figure.set_size_inches(size)
        view.figure.canvas.draw()
        for distance, grade in ((10.0, 0.0), (70.0, -10.0), (110.0, 30.0)):
            view.update(time_at(hills, distance))
            rear, front = wheels(view)
            assert angle(on_screen(rear), on_screen(front)) == pytest.approx(grade, abs=0.2)
    turned = []
    for distance in (5.0, 5.0 + 2.0 * pi * WHEEL_RADIUS / 4.0):
        view.update(time_at(hills, distance))
        turned.append(angle(on_screen(wheels(view)[0]), on_screen(wheels(view)[0], 0.3)))

    assert turn(turned[1], turned[0]) == pytest.approx(90.0, abs=3.0)


@pytest.mark.parametrize('t', [0.0, 2.5, 4.0, 9.0])
def test_the_car_points_where_it_is_heading_to_scale_and_its_front_wheels_are_turned(
    by_hand: Log, t: float
) -> None:
    view = view_of_log(by_hand)
    view.update(t)
    k = int(np.searchsorted(by_hand.t, t + 1e-9)) - 1
    rear, _, front, _ = wheels(view)
    heading = angle(on_screen(rear), on_screen(front))
    assert turn(degrees(by_hand.psi[k]), heading) == pytest.approx(0.0, abs=0.2)

    turned = angle(on_screen(front), on_screen(front, 0.3))
    assert turn(heading + degrees(by_hand.servo[k]), turned) == pytest.approx(0.0, abs=0.2)

    metre = hypot(*np.subtract(on_screen(rear, 1.0), on_screen(rear)))
    base = hypot(*np.subtract(on_screen(front), on_screen(rear)))
    assert base / metre == pytest.approx(Vehicle().l_f + Vehicle().l_r)


def test_readings_are_those_of_the_time_shown(hills: Log, by_hand: Log) -> None:
    side, above = view_of_log(hills), view_of_log(by_hand)
    t = time_at(hills, 150.0)
    side.update(t)
    k = int(np.searchsorted(hills.t, t)) - 1
    command = f'{hills.motor[k]:.2f} m/s²'.replace('-', '\N{MINUS SIGN}')
    expected = {f'{t:.2f} s', '8.00 m/s', '\N{MINUS SIGN}30°', command, '150 m', '160 m'}
    assert expected <= texts(side)
    assert not {'0 m', '100 m'} & texts(side)

    above.update(4.0)
    k = int(np.searchsorted(by_hand.t, 4.0 + 1e-9)) - 1
    assert {
        '4.00 s',
        f'{by_hand.speed[k]:.2f} m/s',
        f'{degrees(by_hand.psi[k]):.0f}°',
        f'{degrees(by_hand.servo[k]):.1f}°',
    } <= texts(above)
    assert 'squares of 10 m' in {text.get_text() for text in above.figure.axes[0].texts}


def test_a_command_holds_until_the_next_state(hills: Log) -> None:
    view = view_of_log(replace(hills, motor=np.arange(len(hills), dtype=float)))
    for t, command in ((0.019, 0), (7 / 50, 7), (29 / 50, 29), (57 / 50, 57)):
        view.update(t)
        assert f'{command}.00 m/s²' in texts(view)


def test_the_path_leads_to_the_car_and_not_over_a_reset(by_hand: Log) -> None:
    view = view_of_log(by_hand)
    view.update(4.0)
    trail = view._trail  # type: ignore[attr-defined]  # noqa: SLF001
    points = trail.get_transform().transform(np.column_stack(trail.get_data()))
    middle = np.mean([on_screen(wheel) for wheel in wheels(view)], axis=0)
    assert points[-1] == pytest.approx(middle)
    assert len(points) == 202

    with_reset = by_hand.map(lambda column: np.tile(column, 2))
    view = view_of_log(replace(with_reset, t=np.arange(2 * len(by_hand)) * 0.02))
    view.update(10.0)
    path = np.column_stack(view._trail.get_data())  # type: ignore[attr-defined]  # noqa: SLF001
    assert np.nanmax(np.hypot(*np.diff(path, axis=0).T)) < 1.0
    assert np.isnan(path).any()


def test_a_heading_just_below_a_whole_turn_is_0_degrees(by_hand: Log) -> None:
    view = view_of_log(replace(by_hand, psi=np.full(len(by_hand), 2.0 * pi - 0.003)))
    view.update(1.0)
    assert '0°' in texts(view)
    assert '360°' not in texts(view)


def test_the_chart_draws_the_present_lap_alone(hills: Log) -> None:
    twice = hills.map(lambda column: np.tile(column, 2))
    view = view_of_log(replace(twice, t=0.02 * np.arange(len(twice))))
    view.update(float(hills.t[-1]) + 2.0)
    assert len(view._trace.get_xdata()) < 102  # noqa: SLF001
    assert 'lap 2' in texts(view)
    pale = [line for line in view.figure.axes[2].lines if line.get_color() == AHEAD]
    assert [len(line.get_xdata()) for line in pale if len(line.get_xdata())] == [len(hills)] * 2


def test_drives_by_hand_are_seen_from_above_and_others_from_the_side(by_hand: Log) -> None:
    assert isinstance(view_of_log(by_hand), TopView)
    assert isinstance(view_of_log(closed_loop(distance=5.0)), SideView)
    uphill = replace(by_hand, elevation=np.linspace(0.0, 5.0, len(by_hand)))
    assert isinstance(view_of_log(uphill), SideView)


def test_unknown_readings_are_a_dash_and_a_single_state_is_drawn(hills: Log, by_hand: Log) -> None:
    unknown = np.full(len(hills), np.nan)
    for log in (replace(hills, motor=unknown), by_hand.map(lambda column: column[:1])):
        view = view_of_log(log)
        view.update(0.0)
        assert '0.00 s' in texts(view)
    view = view_of_log(replace(hills, reference=unknown, motor=unknown))

    assert '\N{EN DASH}' in texts(view)
    assert 'reference' not in [artist.get_label() for artist in view.artists]
    assert 'reference' in [artist.get_label() for artist in view_of_log(hills).artists]


@pytest.fixture
def view() -> SideView:
    return SideView(closed_loop(distance=30.0), Figure(figsize=(6.4, 3.6), dpi=50))


@pytest.mark.parametrize('fps', [25, 50])
def test_a_film_shows_first_and_last_state_and_lasts_as_long_as_the_run(fps: int) -> None:
    times = frame_times(23.02, fps)
    assert times[0] == 0.0
    assert times[-1] == 23.02
    assert len(times) / fps == pytest.approx(23.02 + 1 / fps, abs=1 / fps)
    assert np.diff(times)[:-1] == pytest.approx(1 / fps)


def test_a_frame_equals_a_full_redraw(view: SideView) -> None:
    quick = [image.copy() for image in frames(view, [0.0, 3.3, 1.0])]
    for artist in view.artists:
        artist.set_animated(False)
    canvas = FigureCanvasAgg(view.figure)
    for image, t in zip(quick, [0.0, 3.3, 1.0], strict=True):
        view.update(t)
        canvas.draw()
        assert np.array_equal(image, np.asarray(canvas.buffer_rgba()))

    assert not np.array_equal(quick[0], quick[1])


VIDEO_SIZE = (64, 48)
COLOURS = [(0, 114, 178), (213, 94, 0), (244, 248, 251), (34, 34, 34)]


def images(count: int) -> list[NDArray[np.uint8]]:
    """Return plain images, each of another colour than the one before."""
    width, height = VIDEO_SIZE
    return [
        np.full((height, width, 4), (*COLOURS[i % len(COLOURS)], 255), dtype=np.uint8)
        for i in range(count)
    ]


def decoded(path: Path) -> tuple[NDArray[np.uint8], str]:
    """Return a video's images, of shape `(n, height, width, 3)`, and ffmpeg's messages."""
    result = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), '-i', path, '-f', 'rawvideo', '-pix_fmt', 'rgb24', '-'],
        capture_output=True,
        check=True,
    )
    width, height = VIDEO_SIZE
    frames = np.frombuffer(result.stdout, np.uint8).reshape(-1, height, width, 3)
    stream = next(line for line in result.stderr.decode().splitlines() if 'Video: ' in line)
    return frames, stream


def test_mp4_has_every_frame_in_its_colours_and_plays_everywhere_at_its_rate(
    tmp_path: Path,
) -> None:
    path = tmp_path / 'run.mp4'
    write_mp4(path, images(32), size=VIDEO_SIZE, fps=50)
    frames, stream = decoded(path)
    assert 'h264' in stream
    assert 'yuv420p(tv, bt709' in stream
    assert '50 fps' in stream
    assert imageio_ffmpeg.count_frames_and_secs(path) == (32, pytest.approx(0.64, abs=0.01))
    assert frames.mean(axis=(1, 2)) == pytest.approx(np.array(COLOURS * 8), abs=4.0)


def test_gif_shows_its_images_for_their_time_and_repeats(tmp_path: Path) -> None:
    path = tmp_path / 'run.gif'
    first = images(10)
    # The palette is the first image's: let it hold all the colours.
    first[0][:, ::2, :3] = COLOURS[1]
    write_gif(path, iter([*first, *images(1)]), fps=25)
    with Image.open(path) as gif:
        assert gif.size == VIDEO_SIZE
        assert gif.info['loop'] == 0
        durations = []
        for i in range(gif.n_frames):
            gif.seek(i)
            durations.append(gif.info['duration'])
        gif.seek(1)
        assert gif.convert('RGB').getpixel((30, 30)) == COLOURS[1]

    assert sum(durations) == 11 * 40
