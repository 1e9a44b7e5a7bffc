"""Videos, and windows where there is no display."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import imageio_ffmpeg
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from barc_sim.figures import video
from barc_sim.figures.views import SideView
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


@pytest.mark.parametrize('backend', [None, 'tkagg'])
def test_without_a_display_there_is_no_window(backend: str | None) -> None:
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in {'DISPLAY', 'WAYLAND_DISPLAY', 'MPLBACKEND'}
    }
    script = 'from barc_sim.figures import style; print(style.window((4, 3), str()))'
    result = subprocess.run(
        [sys.executable, '-c', script],
        env=environment | ({'MPLBACKEND': backend} if backend else {}),
        capture_output=True,
        text=True,
        check=True,
    )
    assert (result.stdout.strip(), result.stderr) == ('None', '')


@pytest.fixture
def view() -> SideView:
    return SideView(closed_loop(distance=30.0), Figure(figsize=(6.4, 3.6), dpi=50))


@pytest.mark.parametrize('fps', [25, 50])
def test_a_film_shows_first_and_last_state_and_lasts_as_long_as_the_run(fps: int) -> None:
    times = video.frame_times(23.02, fps)
    assert times[0] == 0.0
    assert times[-1] == 23.02
    assert len(times) / fps == pytest.approx(23.02 + 1 / fps, abs=1 / fps)
    assert np.diff(times)[:-1] == pytest.approx(1 / fps)


def test_a_frame_is_what_drawing_everything_anew_gives(view: SideView) -> None:
    quick = [image.copy() for image in video.frames(view, [0.0, 3.3, 1.0])]
    for artist in view.artists:
        artist.set_animated(False)
    canvas = FigureCanvasAgg(view.figure)
    for image, t in zip(quick, [0.0, 3.3, 1.0], strict=True):
        view.update(t)
        canvas.draw()
        assert np.array_equal(image, np.asarray(canvas.buffer_rgba()))
    assert not np.array_equal(quick[0], quick[1])


SIZE = (64, 48)
COLOURS = [(0, 114, 178), (213, 94, 0), (244, 248, 251), (34, 34, 34)]


def images(count: int) -> list[NDArray[np.uint8]]:
    """Return plain images, each of another colour than the one before."""
    width, height = SIZE
    return [
        np.full((height, width, 4), (*COLOURS[i % len(COLOURS)], 255), dtype=np.uint8)
        for i in range(count)
    ]


def decoded(path: Path) -> tuple[NDArray[np.uint8], str]:
    """Return a video's images, of shape `(n, height, width, 3)`, and what ffmpeg says of it."""
    result = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), '-i', path, '-f', 'rawvideo', '-pix_fmt', 'rgb24', '-'],
        capture_output=True,
        check=True,
    )
    width, height = SIZE
    frames = np.frombuffer(result.stdout, np.uint8).reshape(-1, height, width, 3)
    stream = next(line for line in result.stderr.decode().splitlines() if 'Video: ' in line)
    return frames, stream


def test_mp4_has_every_frame_in_its_colours_and_plays_everywhere_at_its_rate(
    tmp_path: Path,
) -> None:
    path = tmp_path / 'run.mp4'
    video.write_mp4(path, images(32), size=SIZE, fps=50)
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
    video.write_gif(path, iter([*first, *images(1)]), fps=25)
    with Image.open(path) as gif:
        assert gif.size == SIZE
        assert gif.info['loop'] == 0
        durations = []
        for i in range(gif.n_frames):
            gif.seek(i)
            durations.append(gif.info['duration'])
        gif.seek(1)
        assert gif.convert('RGB').getpixel((30, 30)) == COLOURS[1]
    assert sum(durations) == 11 * 40
