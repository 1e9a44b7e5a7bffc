"""The replay of a drive by hand: the car from above, its speed over time below."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from barc_sim.figures.drive_figure import JUMP
from barc_sim.figures.ground_scene import GroundScene
from barc_sim.figures.run_view import AHEAD, RunView, draw_cursor, format_speed
from barc_sim.figures.style import BLUE, VERMILLION, limits, reading

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    from barc_sim.simulation.log import Log


class TopView(RunView):
    """The car from above at any time of a run."""

    READINGS: ClassVar = {
        'Time': 0.5,
        'Speed': 0.63,
        'Heading': 0.74,
        'Steering': 0.85,
        'Command': 1.0,
    }

    def _draw(self, figure: Figure) -> Sequence[Artist]:
        log = self._log
        self._x, self._y, self._psi = log.distance, log.across, log.psi - log.e_epsi
        self._jumps = np.hypot(np.diff(self._x), np.diff(self._y)) > JUMP
        self._path = np.column_stack([self._x, self._y])
        # A jump is not drawn: the state after it begins a new line.
        self._broken = self._path.copy()
        self._broken[:-1][self._jumps] = np.nan
        self._scene = GroundScene(figure.add_axes((0.0, 0.28, 1.0, 0.62)))
        course = figure.add_axes((0.8, 0.03, 0.19, 0.22))
        speed = figure.add_axes((0.06, 0.09, 0.7, 0.165))
        self._here = self._draw_course(course)
        self._trace = self._draw_speed(speed)
        self._cursor, self._dot = draw_cursor(speed)
        return [*self._scene.artists, self._here, self._trace, self._cursor, self._dot]

    def update(self, t: float) -> None:
        """Show the run at `t` [s]: positions between states, commands of the state before."""
        log, k = self._log, self._state_at(t)
        at = log.t[k] if k < len(self._jumps) and self._jumps[k] else t
        x, y, psi, speed = (
            float(np.interp(at, log.t, values))
            for values in (self._x, self._y, self._psi, log.speed)
        )
        servo = float(np.nan_to_num(log.servo[k]))
        self._scene.place(x, y, psi, servo, np.vstack([self._broken[:k], self._path[k], (x, y)]))
        self._here.set_data([x], [y])
        self._trace.set_data(np.append(log.t[: k + 1], t), np.append(log.speed[: k + 1], speed))
        self._cursor.set_xdata([t, t])
        self._dot.set_data([t], [speed])
        self._show(
            {
                'Time': reading(t, 2, ' s'),
                'Speed': reading(speed, 2, ' m/s'),
                'Heading': reading(float(np.degrees(psi)) % 360.0, 0, '°'),
                'Steering': reading(float(np.degrees(log.servo[k])), 1, '°'),
                'Command': reading(float(log.motor[k]), 2, ' m/s²'),
            }
        )

    def _draw_course(self, axes: Axes) -> Line2D:
        """Draw the whole path; return the dot at the car's place on it."""
        axes.plot(self._broken[:, 0], self._broken[:, 1], color=AHEAD, lw=1.5)
        axes.set_axis_off()
        low, high = self._path.min(axis=0) - 2.0, self._path.max(axis=0) + 2.0
        axes.set_xlim(low[0], high[0], auto=True)
        axes.set_ylim(low[1], high[1], auto=True)
        axes.set_aspect('equal', adjustable='datalim')
        (here,) = axes.plot([], [], 'o', color=VERMILLION, mec='white', mew=1.0, ms=7)
        return here

    def _draw_speed(self, axes: Axes) -> Line2D:
        """Return the line of the speed so far."""
        t, speed = self._log.t, self._log.speed
        axes.plot(t, speed, color=AHEAD, lw=1.5)
        (trace,) = axes.plot([], [], color=BLUE, lw=2.2)
        axes.set_xlim(*limits(t, share=0.01, least=1.0))
        format_speed(axes, speed, 'Time [s]', ticks=5)
        return trace


def suits(log: Log) -> bool:
    """Return whether a run is best seen from above: on the flat, without a speed controller.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> suits(simulate())
    False
    """
    return bool(np.isnan(log.reference).all() and not np.nan_to_num(log.elevation).any())
