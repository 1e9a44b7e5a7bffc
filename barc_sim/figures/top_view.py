"""The replay of a drive by hand: the car from above, its speed over time below."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import style
from matplotlib.ticker import MaxNLocator

from barc_sim.figures.ground_scene import GroundScene
from barc_sim.figures.side_view import AHEAD, draw_readings
from barc_sim.figures.style import BLUE, GREY, LOOK, VERMILLION, as_known, limits, reading

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log

    Floats = NDArray[np.float64]

#: Where the readings end, as shares of the width.
READINGS = {'Time': 0.5, 'Speed': 0.63, 'Heading': 0.74, 'Steering': 0.85, 'Command': 1.0}
#: [m] From a state to the next; the car was put back to the start where it is more.
JUMP = 5.0


class TopView:
    """The car from above at any time of a run.

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
        self._x, self._y, self._psi = log.distance, _true_y(log), log.psi - log.e_epsi
        self._jumps = np.hypot(np.diff(self._x), np.diff(self._y)) > JUMP
        self._way = np.column_stack([self._x, self._y])
        # A state after a jump begins a new line: what leads to it is left out.
        self._broken = self._way.copy()
        self._broken[:-1][self._jumps] = np.nan
        with style.context(LOOK):
            self._scene = GroundScene(figure.add_axes((0.0, 0.28, 1.0, 0.62)))
            course = figure.add_axes((0.8, 0.03, 0.19, 0.22))
            speed = figure.add_axes((0.06, 0.09, 0.7, 0.165))
            self._here = self._draw_course(course)
            self._trace, self._cursor, self._dot = self._draw_speed(speed)
            self._readings = draw_readings(
                figure.add_axes((0.06, 0.9, 0.925, 0.1)), title, READINGS
            )
        self.artists = [
            *self._scene.artists,
            *(self._here, self._trace, self._cursor, self._dot),
            *self._readings.values(),
        ]
        # Above what stands still, and in one order: matplotlib would put every line on a patch.
        for order, artist in enumerate(self.artists, start=10):
            artist.set(animated=True, zorder=order)
        self.update(0.0)

    def update(self, t: float) -> None:
        """Show the run at `t` [s]: positions between states, commands that hold until the next."""
        log = self._log
        k = int(np.searchsorted(log.t, t + 1e-9, side='right')) - 1
        at = log.t[k] if k < len(self._jumps) and self._jumps[k] else t
        x, y, psi, speed = (
            float(np.interp(at, log.t, values))
            for values in (self._x, self._y, self._psi, log.speed)
        )
        servo = float(np.nan_to_num(log.servo[k]))
        self._scene.place(x, y, psi, servo, np.vstack([self._broken[:k], self._way[k], (x, y)]))
        self._here.set_data([x], [y])
        self._trace.set_data(np.append(log.t[: k + 1], t), np.append(log.speed[: k + 1], speed))
        self._cursor.set_xdata([t, t])
        self._dot.set_data([t], [speed])
        for name, text in {
            'Time': reading(t, 2, ' s'),
            'Speed': reading(speed, 2, ' m/s'),
            'Heading': reading(float(np.degrees(psi)) % 360.0, 0, '°'),
            'Steering': reading(float(np.degrees(log.servo[k])), 1, '°'),
            'Command': reading(float(log.motor[k]), 2, ' m/s²'),
        }.items():
            self._readings[name].set_text(text)

    def _draw_course(self, axes: Axes) -> Line2D:
        """Draw the whole way, and return the dot where the car is on it."""
        axes.plot(self._broken[:, 0], self._broken[:, 1], color=AHEAD, lw=1.5)
        axes.set_axis_off()
        low, high = self._way.min(axis=0) - 2.0, self._way.max(axis=0) + 2.0
        axes.set_xlim(low[0], high[0], auto=True)
        axes.set_ylim(low[1], high[1], auto=True)
        axes.set_aspect('equal', adjustable='datalim')
        (here,) = axes.plot([], [], 'o', color=VERMILLION, mec='white', mew=1.0, ms=7)
        return here

    def _draw_speed(self, axes: Axes) -> tuple[Line2D, Line2D, Line2D]:
        """Return the line of the speed so far, the cursor and the dot."""
        t, speed = self._log.t, self._log.speed
        axes.plot(t, speed, color=AHEAD, lw=1.5)
        (trace,) = axes.plot([], [], color=BLUE, lw=2.2)
        cursor = axes.axvline(0.0, color=GREY, lw=0.8)
        (dot,) = axes.plot([], [], 'o', color=BLUE, mec='white', mew=1.2, ms=8)
        axes.set_xlim(*limits(t, share=0.01, least=1.0))
        axes.set_ylim(*limits(speed, share=0.15, least=1.0))
        axes.set(xlabel='Time [s]', ylabel='Speed [m/s]')
        axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
        axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        return trace, cursor, dot


def suits(log: Log) -> bool:
    """Return whether a run is best seen from above: without a speed controller, on the flat."""
    return bool(np.isnan(log.reference).all() and not np.nan_to_num(log.elevation).any())


def _true_y(log: Log) -> Floats:
    """Return the true position to the left [m], as `Log.distance` is the one along."""
    heading = log.psi - log.e_epsi
    along, across = log.e_s * np.sin(heading), log.e_ey * np.cos(heading)
    return np.asarray(log.y - (along + across))
