"""Video files, as they decode."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from barc_sim.figures import video

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

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


def test_mp4_has_every_frame_and_plays_at_its_rate(tmp_path: Path) -> None:
    path = tmp_path / 'run.mp4'
    video.write_mp4(path, images(30), size=SIZE, fps=50)
    frames, stream = decoded(path)
    assert len(frames) == 30
    assert '50 fps' in stream
    assert imageio_ffmpeg.count_frames_and_secs(path) == (30, pytest.approx(0.6, abs=0.01))


def test_mp4_is_what_plays_everywhere(tmp_path: Path) -> None:
    path = tmp_path / 'run.mp4'
    video.write_mp4(path, images(4), size=SIZE, fps=50)
    _, stream = decoded(path)
    assert 'h264' in stream
    assert 'yuv420p(tv, bt709' in stream


def test_mp4_keeps_the_colours(tmp_path: Path) -> None:
    path = tmp_path / 'run.mp4'
    video.write_mp4(path, images(4), size=SIZE, fps=50)
    means = decoded(path)[0].mean(axis=(1, 2))
    assert means == pytest.approx(np.array(COLOURS), abs=4.0)


def test_mp4_of_one_frame_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / 'run.mp4'
    video.write_mp4(path, images(1), size=SIZE, fps=50)
    assert imageio_ffmpeg.count_frames_and_secs(path)[0] == 1


def test_gif_lasts_as_long_as_its_frames_and_repeats(tmp_path: Path) -> None:
    path = tmp_path / 'run.gif'
    video.write_gif(path, iter([*images(10), *images(1)]), fps=25)
    with Image.open(path) as gif:
        assert gif.size == SIZE
        assert gif.info['loop'] == 0
        durations = []
        for i in range(gif.n_frames):
            gif.seek(i)
            durations.append(gif.info['duration'])
    assert sum(durations) == 11 * 40


def test_gif_shows_the_images(tmp_path: Path) -> None:
    path = tmp_path / 'run.gif'
    first = images(4)
    # The palette is the first image's: let it hold all the colours.
    first[0][:, ::2, :3] = COLOURS[1]
    video.write_gif(path, iter(first), fps=25)
    with Image.open(path) as gif:
        gif.seek(1)
        assert gif.convert('RGB').getpixel((30, 30)) == COLOURS[1]
