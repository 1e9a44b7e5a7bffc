"""Video files, as they decode."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from barc_sim.figures import output

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


def test_mp4_has_every_frame_in_its_colours_and_plays_everywhere_at_its_rate(
    tmp_path: Path,
) -> None:
    path = tmp_path / 'run.mp4'
    output.write_mp4(path, images(32), size=SIZE, fps=50)
    frames, stream = decoded(path)
    assert 'h264' in stream
    assert 'yuv420p(tv, bt709' in stream
    assert '50 fps' in stream
    assert imageio_ffmpeg.count_frames_and_secs(path) == (32, pytest.approx(0.64, abs=0.01))
    assert frames.mean(axis=(1, 2)) == pytest.approx(np.array(COLOURS * 8), abs=4.0)


def test_mp4_of_one_frame_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / 'run.mp4'
    output.write_mp4(path, images(1), size=SIZE, fps=50)
    assert imageio_ffmpeg.count_frames_and_secs(path)[0] == 1


def test_gif_shows_its_images_for_their_time_and_repeats(tmp_path: Path) -> None:
    path = tmp_path / 'run.gif'
    first = images(10)
    # The palette is the first image's: let it hold all the colours.
    first[0][:, ::2, :3] = COLOURS[1]
    output.write_gif(path, iter([*first, *images(1)]), fps=25)
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
