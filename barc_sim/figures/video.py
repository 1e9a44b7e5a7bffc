"""Videos of a run: the frames of a view, as .mp4 or .gif."""

from __future__ import annotations

import subprocess
import sys
from contextlib import closing, suppress
from itertools import chain
from shutil import which
from tempfile import TemporaryFile
from typing import IO, TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from barc_sim.errors import UserError
from barc_sim.figures.views import SIZE, view_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray
    from PIL import Image

    from barc_sim.figures.views import RunView
    from barc_sim.simulation.log import Log

    Images = Iterable[NDArray[np.uint8]]

MP4_DPI, MP4_FPS = 100, 50  # 1280 x 720, every state
GIF_DPI, GIF_FPS = 75, 25  # 960 x 540: a GIF is large, and its unit of time is 10 ms
# The index comes first, so that a browser plays the file while it loads. The colours are HDTV's,
# as the file states: players would guess. The encoder takes half as long as with the preset
# `veryfast`, and less than the drawing, which goes on beside it; the file is 1.7 times as large.
ENCODING = {
    '-codec:v': 'libx264',
    '-pix_fmt': 'yuv420p',
    '-crf': '20',
    '-preset': 'superfast',
    '-tune': 'zerolatency',
    '-vf': 'scale=out_color_matrix=bt709:out_range=tv',
    '-colorspace': 'bt709',
    '-movflags': '+faststart',
}


def save(log: Log, path: Path, *, title: str = '') -> None:
    """Write the run at real speed to `path`, which ends in .mp4 or .gif.

    A progress bar appears if stderr is a terminal.
    """
    from rich.console import Console  # noqa: PLC0415 (slow: not for figures)
    from rich.progress import track  # noqa: PLC0415

    gif = path.suffix.lower() == '.gif'
    dpi, fps = (GIF_DPI, GIF_FPS) if gif else (MP4_DPI, MP4_FPS)
    view = view_of(log, Figure(figsize=SIZE, dpi=dpi), title)
    times = track(
        frame_times(view.duration, fps),
        'Saving',
        console=Console(stderr=True),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    images = frames(view, times)
    if gif:
        write_gif(path, images, fps=fps)
    else:
        width, height = view.figure.canvas.get_width_height()
        write_mp4(path, images, size=(width, height), fps=fps)


def frame_times(duration: float, fps: float) -> NDArray[np.float64]:
    """Return the times [s] of the frames of a film of `duration` [s], with both ends."""
    count = int(np.ceil(duration * fps - 1e-6)) + 1
    return np.minimum(np.arange(count) / fps, duration)


def frames(view: RunView, times: Iterable[float]) -> Iterator[NDArray[np.uint8]]:
    """Yield the view at each of `times`, its fixed parts drawn once.

    It is RGBA of shape `(height, width, 4)`; the next one overwrites it.
    """
    canvas: Any = FigureCanvasAgg(view.figure)  # matplotlib has no types for it
    canvas.draw()
    still = canvas.copy_from_bbox(view.figure.bbox)
    image = np.asarray(canvas.buffer_rgba())
    for t in times:
        view.update(t)
        canvas.restore_region(still)
        for artist in view.artists:
            view.figure.draw_artist(artist)
        yield image


def write_mp4(path: Path, images: Images, *, size: tuple[int, int], fps: int) -> None:
    """Write RGBA images of shape `(height, width, 4)` as H.264 in 4:2:0, which all players support.

    `size` is `(width, height)`, both even.
    """
    program = ffmpeg()
    if program is None:
        raise UserError(
            'a .mp4 is written by ffmpeg, and none is on the PATH: install it, or run '
            'python -m pip install imageio-ffmpeg, or save as .gif'
        )
    pixels = {'-f': 'rawvideo', '-pix_fmt': 'rgba', '-s': '{}x{}'.format(*size), '-r': str(fps)}
    options = [*chain(*pixels.items()), '-i', '-', *chain(*ENCODING.items())]
    with TemporaryFile() as errors:
        encoder = subprocess.Popen(  # noqa: S603 (ffmpeg)
            [program, '-loglevel', 'error', '-y', *options, '-f', 'mp4', str(path)],
            stdin=subprocess.PIPE,
            stderr=errors,
        )
        # One that ends early leaves the reason in `errors`.
        with encoder, suppress(BrokenPipeError), closing(cast('IO[bytes]', encoder.stdin)) as pipe:
            for image in images:
                pipe.write(image.tobytes())
        if encoder.returncode:
            errors.seek(0)
            *_, reason = ['', *errors.read().decode(errors='replace').splitlines()]
            raise OSError(f'{program}: {reason}')


def ffmpeg() -> str | None:
    """Return the path of ffmpeg: of the PATH, else of imageio-ffmpeg; None without either."""
    program = which('ffmpeg')
    if program is None:
        with suppress(ImportError, RuntimeError):
            from imageio_ffmpeg import get_ffmpeg_exe  # noqa: PLC0415 (an extra, and slow)

            program = get_ffmpeg_exe()
    return program


def write_gif(path: Path, images: Images, *, fps: int) -> None:
    """Write RGBA images of shape `(height, width, 4)`, at least one, as a GIF that repeats.

    A GIF's unit of time is 10 ms, so `fps` should divide 100.
    """
    stills = _one_palette(images)
    next(stills).save(
        path, save_all=True, append_images=stills, duration=1000 // fps, loop=0, optimize=False
    )


def _one_palette(images: Images) -> Iterator[Image.Image]:
    """Give every image the first one's colours: no flicker, and a small file."""
    from PIL import Image  # noqa: PLC0415

    palette = None
    for image in images:
        colours = Image.fromarray(image).convert('RGB')
        palette = palette or colours.quantize(256, dither=Image.Dither.NONE)
        yield colours.quantize(palette=palette, dither=Image.Dither.NONE)
