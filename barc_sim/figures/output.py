"""Windows, the common parts of the animated views of a run, and their videos."""

from __future__ import annotations

import subprocess
from abc import ABC, abstractmethod
from contextlib import closing, suppress
from itertools import chain
from shutil import which
from tempfile import TemporaryFile
from time import monotonic
from typing import IO, TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
from matplotlib import style
from matplotlib.animation import FuncAnimation
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.ticker import MaxNLocator

from barc_sim.errors import UserError
from barc_sim.figures.style import BLUE, GREY, MUTED, STYLE, limits, use_measurement

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.text import Text
    from numpy.typing import NDArray
    from PIL import Image

    from barc_sim.simulation.log import Log

    Images = Iterable[NDArray[np.uint8]]

SIZE = (12.8, 7.2)  #: [inch]
AHEAD = '#C4D3DD'  #: of the part of the run after the shown time
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


def window(size: tuple[float, float], title: str) -> Figure | None:
    """Return an empty figure of `size` [inch] in a window; None if no window can be opened.

    `show` shows it.
    """
    from matplotlib import pyplot as plt  # noqa: PLC0415 (chooses a backend: not for saving)

    try:
        figure = plt.figure(title, figsize=size)
    except ImportError:  # the backend that the user has chosen cannot run here
        return None
    if figure.canvas.required_interactive_framework is None:
        plt.close(figure)
        return None
    return figure


def show() -> None:
    """Show the windows until the user has closed them."""
    from matplotlib import pyplot as plt  # noqa: PLC0415

    plt.show()


class RunView(ABC):
    """A view of a run at any of its times; `update` moves its `artists`, drawn in order."""

    #: The names of the readings, and where each ends as a share of the width.
    READINGS: ClassVar[Mapping[str, float]]
    artists: Sequence[Artist]

    def __init__(self, log: Log, figure: Figure, *, title: str = '') -> None:
        """Draw the fixed parts on `figure`, which is empty, and show the first state."""
        self.figure = figure
        self.duration = float(log.t[-1])  #: [s] from the run's first state to its last
        self._log = use_measurement(log)
        with style.context(STYLE):
            moving = self._draw(figure)
            self._readings = self._draw_readings(figure.add_axes((0.06, 0.9, 0.925, 0.1)), title)
        self.artists = [*moving, *self._readings.values()]
        # Above the fixed parts, and in this order: Matplotlib would draw every line over a patch.
        for order, artist in enumerate(self.artists, start=10):
            artist.set(animated=True, zorder=order)
        self.update(0.0)

    @abstractmethod
    def _draw(self, figure: Figure) -> Sequence[Artist]:
        """Draw all but the readings; return the artists that `update` moves."""

    @abstractmethod
    def update(self, t: float) -> None:
        """Show the run at `t` [s]: positions between states, commands of the state before."""

    def _state_at(self, t: float) -> int:
        """Return the number of the last state up to `t` [s]."""
        return int(np.searchsorted(self._log.t, t + 1e-9, side='right')) - 1

    def _show(self, readings: Mapping[str, str]) -> None:
        for name, text in readings.items():
            self._readings[name].set_text(text)

    def _draw_readings(self, axes: Axes, title: str) -> dict[str, Text]:
        axes.set_axis_off()
        axes.text(0.0, 0.5, title, fontsize=13, fontweight='bold', va='center')
        for name, x in self.READINGS.items():
            axes.text(x, 0.68, name, color=MUTED, fontsize=9, ha='right', va='bottom')
        return {
            name: axes.text(x, 0.56, '', fontsize=15, ha='right', va='top')
            for name, x in self.READINGS.items()
        }


def draw_cursor(axes: Axes) -> tuple[Line2D, Line2D]:
    """Return a vertical line and a dot that mark the shown state."""
    cursor = axes.axvline(0.0, color=GREY, lw=0.8)
    (dot,) = axes.plot([], [], 'o', color=BLUE, mec='white', mew=1.2, ms=8)
    return cursor, dot


def format_speed(axes: Axes, speeds: np.ndarray, label: str, *, ticks: int) -> None:
    """Set limits, names and ticks of a chart of `speeds` over `label`."""
    axes.set_ylim(*limits(speeds, share=0.15, minimum=1.0))
    axes.set(xlabel=label, ylabel='Speed [m/s]')
    axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(ticks, steps=[1, 2, 5, 10]))


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


def animate(view: RunView, *, interval: float = 0.02) -> FuncAnimation:
    """Return the animation that repeats in the view's window.

    It runs in real time: a slow machine skips frames. `interval` [s] is the time between two.
    Matplotlib plays it as long as the caller keeps a reference.
    """

    def clock() -> Generator[float, None, None]:
        start = monotonic()
        while (t := monotonic() - start) < view.duration:
            yield t
        yield view.duration

    def draw(t: float) -> Sequence[Artist]:
        view.update(t)
        return view.artists

    return FuncAnimation(
        view.figure,
        draw,
        frames=clock,
        init_func=lambda: view.artists,
        interval=1e3 * interval,
        repeat_delay=2000,
        blit=True,
        cache_frame_data=False,
    )


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
