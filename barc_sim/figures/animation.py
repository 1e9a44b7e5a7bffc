"""A view of a run in motion: frame by frame for a file, or by the clock in a window."""

from __future__ import annotations

from time import monotonic
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.backends.backend_agg import FigureCanvasAgg

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Iterator, Sequence

    from matplotlib.artist import Artist
    from matplotlib.figure import Figure
    from numpy.typing import NDArray


class View(Protocol):
    """Shows a run at any of its times; `SideView` is one."""

    figure: Figure
    duration: float  #: [s]
    artists: Sequence[Artist]  #: what `update` moves, in the order of drawing

    def update(self, t: float) -> None:
        """Show the run at `t` [s]."""


def frame_times(duration: float, fps: float) -> NDArray[np.float64]:
    """Return the times [s] of a film of `duration` [s]: one per frame, first and last included."""
    count = int(np.ceil(duration * fps - 1e-6)) + 1
    return np.minimum(np.arange(count) / fps, duration)


def frames(view: View, times: Iterable[float]) -> Iterator[NDArray[np.uint8]]:
    """Draw the view at each of `times`; what stands still is drawn once.

    Yields
    ------
    image
        RGBA of shape `(height, width, 4)`, overwritten by the next one.
    """
    canvas: Any = FigureCanvasAgg(view.figure)  # matplotlib does not say its types
    canvas.draw()
    still = canvas.copy_from_bbox(view.figure.bbox)
    image = np.asarray(canvas.buffer_rgba())
    for t in times:
        view.update(t)
        canvas.restore_region(still)
        for artist in view.artists:
            view.figure.draw_artist(artist)
        yield image


def animate(view: View, *, interval: float = 0.02) -> FuncAnimation:
    """Return the animation that plays in the view's window, again and again.

    It goes by the clock: a machine that is too slow for a frame per `interval` [s] leaves some
    out. matplotlib plays it for as long as the caller keeps it.
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
