"""The common parts of the animated views of a run: readings, speed chart, moving artists."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from matplotlib import style
from matplotlib.ticker import MaxNLocator

from barc_sim.figures.style import BLUE, GREY, MUTED, STYLE, limits, use_measurement

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.text import Text

    from barc_sim.simulation.log import Log

SIZE = (12.8, 7.2)  #: [inch]
AHEAD = '#C4D3DD'  #: of the part of the run after the shown time


class RunView(ABC):
    """A view of a run at any of its times.

    Attributes
    ----------
    figure
        The figure it is drawn on.
    duration
        [s] from the run's first state to its last.
    artists
        The artists that `update` moves, in the order of drawing.
    """

    #: The names of the readings, and where each ends as a share of the width.
    READINGS: ClassVar[Mapping[str, float]]
    artists: Sequence[Artist]

    def __init__(self, log: Log, figure: Figure, *, title: str = '') -> None:
        """Draw the fixed parts on `figure`, which is empty, and show the first state."""
        self.figure = figure
        self.duration = float(log.t[-1])
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
    axes.set_ylim(*limits(speeds, share=0.15, least=1.0))
    axes.set(xlabel=label, ylabel='Speed [m/s]')
    axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(ticks, steps=[1, 2, 5, 10]))
