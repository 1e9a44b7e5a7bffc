"""The replay of a run on hills: the car from the side on its road, its speed below."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import style
from matplotlib.ticker import MaxNLocator

from barc_sim.figures.road_scene import RoadScene
from barc_sim.figures.style import (
    BLUE,
    DASHES,
    EARTH,
    GREY,
    INK,
    LOOK,
    MUTED,
    SURFACE,
    as_known,
    limits,
    reading,
)
from barc_sim.figures.terrain import Terrain

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.text import Text
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log

SIZE = (12.8, 7.2)  #: [inch]
AHEAD = '#C4D3DD'  #: of the speed that is still to come
#: Where the readings end, as shares of the width.
READINGS = {'Time': 0.5, 'Speed': 0.63, 'Reference': 0.76, 'Grade': 0.85, 'Command': 1.0}


class SideView:
    """The car from the side at any time of a run.

    Attributes
    ----------
    figure
        What it is drawn on.
    duration
        [s] from the run's first state to its last.
    artists
        What `update` moves, in the order of drawing. Each belongs to axes.
    """

    artists: Sequence[Artist]

    def __init__(self, log: Log, figure: Figure, *, title: str = '') -> None:
        """Draw all that stands still on `figure`, which is empty, and show the first state."""
        self.figure = figure
        self.duration = float(log.t[-1])
        self._log = log = as_known(log)
        self._distance, self._speed = log.distance, log.speed
        self._terrain = Terrain(log)
        with style.context(LOOK):
            self._scene = RoadScene(figure.add_axes((0.0, 0.4, 1.0, 0.5)), self._terrain)
            course = figure.add_axes((0.06, 0.295, 0.925, 0.08))
            speed = figure.add_axes((0.06, 0.09, 0.925, 0.19))
            self._draw_course(course)
            self._trace, reference = self._draw_speed(speed)
            here = [*_draw_here(course, self._distance), *_draw_here(speed, self._distance)]
            self._cursors, self._dots = here[::2], here[1::2]
            self._readings = draw_readings(
                figure.add_axes((0.06, 0.9, 0.925, 0.1)), title, READINGS
            )
        moving = [self._trace, *reference, *here, *self._readings.values()]
        self.artists = [*self._scene.artists, *moving]
        # Above what stands still, and in one order: matplotlib would put every line on a patch.
        for order, artist in enumerate(self.artists, start=10):
            artist.set(animated=True, zorder=order)
        self.update(0.0)

    def update(self, t: float) -> None:
        """Show the run at `t` [s]: positions between states, commands that hold until the next."""
        log = self._log
        k = int(np.searchsorted(log.t, t + 1e-9, side='right')) - 1
        distance = float(np.interp(t, log.t, self._distance))
        speed = float(np.interp(t, log.t, self._speed))
        elevation = float(self._terrain.at(distance)[1])
        self._scene.place(distance)
        self._trace.set_data(
            np.append(self._distance[: k + 1], distance), np.append(self._speed[: k + 1], speed)
        )
        for cursor, dot, height in zip(self._cursors, self._dots, (elevation, speed), strict=True):
            cursor.set_xdata([distance, distance])
            dot.set_data([distance], [height])
        for name, text in {
            'Time': reading(t, 2, ' s'),
            'Speed': reading(speed, 2, ' m/s'),
            'Reference': reading(float(log.reference[k]), 2, ' m/s'),
            'Grade': reading(float(log.theta_deg[k]), 0, '°'),
            'Command': reading(float(log.motor[k]), 2, ' m/s²'),
        }.items():
            self._readings[name].set_text(text)

    def _draw_course(self, axes: Axes) -> None:
        """Draw all of the road, with the heights larger than they are."""
        x, y = self._terrain.distance, self._terrain.elevation
        low, high = float(y[1:-1].min()), float(y[1:-1].max())
        bottom = low - 2.0
        axes.fill_between(x, y, bottom, color=EARTH)
        axes.plot(x, y, color=SURFACE, lw=1.2)
        axes.set_ylim(bottom, high + max(2.0, 0.3 * (high - low)))
        axes.set_axis_off()

    def _draw_speed(self, axes: Axes) -> tuple[Line2D, list[Line2D]]:
        """Return the line of the speed so far, and the reference's if there is one."""
        reference = self._log.reference
        axes.plot(self._distance, self._speed, color=AHEAD, lw=1.5)
        (trace,) = axes.plot([], [], color=BLUE, lw=2.2, label='speed')
        line: list[Line2D] = []
        if not np.all(np.isnan(reference)):
            line = axes.plot(
                self._distance, reference, color=INK, lw=1.0, ls=DASHES, label='reference'
            )
        axes.set_ylim(*limits(np.append(self._speed, reference), share=0.15, least=1.0))
        axes.set(xlabel='Position along the road [m]', ylabel='Speed [m/s]')
        axes.legend(loc='upper right', bbox_to_anchor=(1.0, -0.16), ncols=2, borderaxespad=0.0)
        axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
        axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
        return trace, line


def _draw_here(axes: Axes, distance: NDArray[np.float64]) -> tuple[Line2D, Line2D]:
    """Return a cursor and a dot where the car is, on axes over the whole way."""
    axes.set_xlim(*limits(distance, share=0.01, least=5.0))
    cursor = axes.axvline(0.0, color=GREY, lw=0.8)
    (dot,) = axes.plot([], [], 'o', color=BLUE, mec='white', mew=1.2, ms=8)
    return cursor, dot


def draw_readings(axes: Axes, title: str, readings: Mapping[str, float]) -> dict[str, Text]:
    """Return the texts that show the values, by name, which end where `readings` says."""
    axes.set_axis_off()
    axes.text(0.0, 0.5, title, fontsize=13, fontweight='bold', va='center')
    for name, x in readings.items():
        axes.text(x, 0.68, name, color=MUTED, fontsize=9, ha='right', va='bottom')
    return {
        name: axes.text(x, 0.56, '', fontsize=15, ha='right', va='top')
        for name, x in readings.items()
    }
