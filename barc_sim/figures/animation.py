"""Animates a view of a run: frame by frame for a file, or in real time in a window."""

from __future__ import annotations

from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.backends.backend_agg import FigureCanvasAgg

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Iterator, Sequence

    from matplotlib.artist import Artist
    from numpy.typing import NDArray

    from barc_sim.figures.run_view import RunView


def frame_times(duration: float, fps: float) -> NDArray[np.float64]:
    """Return the times [s] of the frames of a film of `duration` [s], with both ends.

    Examples
    --------
    >>> print(frame_times(0.2, fps=10.0))
    [0.  0.1 0.2]
    """
    count = int(np.ceil(duration * fps - 1e-6)) + 1
    return np.minimum(np.arange(count) / fps, duration)


def frames(view: RunView, times: Iterable[float]) -> Iterator[NDArray[np.uint8]]:
    """Draw the view at each of `times`; its fixed parts are drawn once.

    Yields
    ------
    image
        RGBA of shape `(height, width, 4)`; the next one overwrites it.
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
