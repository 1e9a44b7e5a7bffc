"""The picture of an environment: a replay's view of the present state."""

from __future__ import annotations

from dataclasses import replace
from math import nan
from typing import TYPE_CHECKING, Any
from warnings import warn

import numpy as np
from matplotlib.figure import Figure

from barc_sim.figures import style
from barc_sim.figures.views import SIZE, frames, view_of
from barc_sim.simulation.closed_loop import log_of_rows

if TYPE_CHECKING:
    from barc_sim.figures.views import RunView
    from barc_sim.interfaces.records import Command
    from barc_sim.learning.tasks import Task
    from barc_sim.simulation.log import Log
    from barc_sim.vehicle.plant import Plant

_DPI = 50  # 640 x 360
_SHORTEST = 100.0  # [m] of a road that is drawn at once
_NO_WINDOW = "there is no display, so no window opens: render_mode 'rgb_array' needs none"


class Picture:
    """Draws the car of one environment, with its path since the episode's first picture."""

    def __init__(self, task: Task, *, in_window: bool) -> None:
        """Draw `in_window`, or into an array; warn if there is no display."""
        self._task, self._in_window, self._title = task, in_window, type(task).__name__
        self._window = style.window(self._title) if in_window else None
        if self._window:
            self._window.canvas.mpl_connect('close_event', lambda _: self.close())
        elif in_window:
            warn(_NO_WINDOW, stacklevel=3)
        self.begin()

    def begin(self) -> None:
        """Forget the path, which belongs to another episode."""
        self._rows: list[Any] = []
        self._times: list[float] = []
        self._stretch = nan

    def close(self) -> None:
        """Close the window for good."""
        window, self._window = self._window, None
        if window:
            style.close(window)

    def draw(self, plant: Plant, command: Command) -> Any:  # noqa: ANN401 (an array)
        """Return the picture; None with a window."""
        if self._in_window and not self._window:
            return None
        self._rows.append((plant.observe(), command, (0.0,)))
        self._times.append(plant.steps * plant.ts)
        log = log_of_rows(self._rows, plant.period_ns, self._task.speed, track=plant.track)
        log = replace(log, t=np.array(self._times))
        length = max(self._task.length, _SHORTEST)
        if (stretch := plant.distance // length) == self._stretch:
            self._view.read(log)
        else:
            self._stretch = stretch
            self._begin(log, stretch * length, (stretch + 1.0) * length)
        frame = next(self._frames)
        if not self._window:
            return frame[..., :3].copy()
        self._window.clear()
        self._window.figimage(frame, resize=True)
        style.show(block=False)
        self._window.canvas.draw()
        self._window.canvas.flush_events()
        return None

    def _begin(self, log: Log, first: float, last: float) -> None:
        """Draw the fixed parts: the track, or the road between two positions [m]."""
        task, figure = self._task, Figure(SIZE, _DPI)
        stretch, limits = (task.road, first, last), (0.0, 2.0 * task.speed)
        if task.track:
            limits = -task.half_width, task.half_width
        self._view: RunView = view_of(log, figure, self._title, stretch)
        _, course, chart = figure.axes[:3]
        chart.set(xlim=(first, last), ylim=limits)
        if not task.track:
            course.set_xlim(first, last)
            chart.axhline(task.speed, color=style.INK, lw=1.0, ls=style.DASHES)
        # A view's picture at a time: the latest, whenever one is asked for.
        self._frames = frames(self._view, iter(lambda: self._times[-1], None))
