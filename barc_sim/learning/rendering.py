"""The picture of an environment: a replay's view of the present state."""

from __future__ import annotations

from dataclasses import replace
from math import nan
from typing import TYPE_CHECKING, Any
from warnings import warn

import numpy as np
from matplotlib.figure import Figure

from barc_sim.figures import windows
from barc_sim.figures.colours import DASHES, INK
from barc_sim.figures.views import SIZE, RoadStretch, frames, view_of
from barc_sim.simulation.closed_loop import log_of_rows

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barc_sim.figures.views import RunView
    from barc_sim.interfaces.records import Command
    from barc_sim.learning.tasks import DrivingTask
    from barc_sim.simulation.log import Log
    from barc_sim.vehicle.plant import Plant

_DPI = 50  # 640 x 360
_SHORTEST = 100.0  # [m] of a road that is drawn at once
_NO_WINDOW = "there is no display, so no window opens: render_mode 'rgb_array' needs none"


class Picture:
    """Draws the car of one environment, with its path since the episode's first picture."""

    def __init__(self, task: DrivingTask, *, in_window: bool) -> None:
        """Draw `in_window`, or into an array; warn if there is no display."""
        self._task = task
        self._in_window = in_window
        self._title = type(task).__name__

        self._window = windows.window(self._title) if in_window else None
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
        if self._window:
            windows.close(self._window)
        self._window = None

    def draw(self, plant: Plant, command: Command) -> Any:  # noqa: ANN401 (an array)
        """Return the picture; None with a window."""
        if self._in_window and not self._window:
            return None

        log = self._log(plant, command)
        length = max(self._task.length, _SHORTEST)
        stretch = plant.distance // length
        if stretch == self._stretch:
            self._view.read(log)
        else:
            self._stretch = stretch
            self._begin_stretch(log, stretch * length, (stretch + 1.0) * length)

        frame = next(self._frames)
        if not self._window:
            return frame[..., :3].copy()
        self._show(self._window, frame)
        return None

    def _log(self, plant: Plant, command: Command) -> Log:
        """Return the log of the pictures so far, with the present state."""
        self._rows.append((plant.observe_exactly(), command, (0.0,)))
        self._times.append(plant.steps * plant.ts)
        log = log_of_rows(self._rows, plant.period_ns, self._task.speed, track=plant.track)
        return replace(log, t=np.array(self._times))

    def _show(self, window: Figure, frame: Any) -> None:  # noqa: ANN401 (an array)
        window.clear()
        window.figimage(frame, resize=True)
        windows.show(block=False)
        window.canvas.draw()
        window.canvas.flush_events()

    def _begin_stretch(self, log: Log, first: float, last: float) -> None:
        """Draw the fixed parts: the track, or the road between two positions [m]."""
        task = self._task
        figure = Figure(SIZE, _DPI)
        stretch = RoadStretch(task.road, first, last)
        self._view: RunView = view_of(log, figure, self._title, stretch)

        _, course, chart = figure.axes[:3]
        if task.track:
            chart.set(xlim=(first, last), ylim=(-task.half_width, task.half_width))
        else:
            course.set_xlim(first, last)
            chart.set(xlim=(first, last), ylim=(0.0, 2.0 * task.speed))
            chart.axhline(task.speed, color=INK, lw=1.0, ls=DASHES)

        self._frames = frames(self._view, self._latest_times())

    def _latest_times(self) -> Iterator[float]:
        """Yield the time of the latest state, whenever a picture is drawn."""
        while True:
            yield self._times[-1]
