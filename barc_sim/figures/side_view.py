"""The replay of a run on hills: the car from the side on its road, its speed below."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from barc_sim.figures.road_scene import RoadScene
from barc_sim.figures.run_view import AHEAD, SIZE, RunView, draw_cursor, format_speed
from barc_sim.figures.style import BLUE, DASHES, EARTH, INK, SURFACE, limits, reading
from barc_sim.figures.terrain import Terrain

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

__all__ = ['SIZE', 'SideView']


class SideView(RunView):
    """The car from the side at any time of a run."""

    READINGS: ClassVar = {
        'Time': 0.5,
        'Speed': 0.63,
        'Reference': 0.76,
        'Grade': 0.85,
        'Command': 1.0,
    }

    def _draw(self, figure: Figure) -> Sequence[Artist]:
        self._distance, self._speed = self._log.distance, self._log.speed
        self._terrain = Terrain(self._log)
        self._scene = RoadScene(figure.add_axes((0.0, 0.4, 1.0, 0.5)), self._terrain)
        course = figure.add_axes((0.06, 0.295, 0.925, 0.08))
        speed = figure.add_axes((0.06, 0.09, 0.925, 0.19))
        self._draw_course(course)
        self._trace, reference = self._draw_speed(speed)
        for axes in (course, speed):
            axes.set_xlim(*limits(self._distance, share=0.01, least=5.0))
        here = [*draw_cursor(course), *draw_cursor(speed)]
        self._cursors, self._dots = here[::2], here[1::2]
        return [*self._scene.artists, self._trace, *reference, *here]

    def update(self, t: float) -> None:
        """Show the run at `t` [s]: positions between states, commands of the state before."""
        log, k = self._log, self._state_at(t)
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
        self._show(
            {
                'Time': reading(t, 2, ' s'),
                'Speed': reading(speed, 2, ' m/s'),
                'Reference': reading(float(log.reference[k]), 2, ' m/s'),
                'Grade': reading(float(log.theta_deg[k]), 0, '°'),
                'Command': reading(float(log.motor[k]), 2, ' m/s²'),
            }
        )

    def _draw_course(self, axes: Axes) -> None:
        """Draw the whole road, its heights enlarged."""
        x, y = self._terrain.distance, self._terrain.elevation
        low, high = float(y[1:-1].min()), float(y[1:-1].max())
        bottom = low - 2.0
        axes.fill_between(x, y, bottom, color=EARTH)
        axes.plot(x, y, color=SURFACE, lw=1.2)
        axes.set_ylim(bottom, high + max(2.0, 0.3 * (high - low)))
        axes.set_axis_off()

    def _draw_speed(self, axes: Axes) -> tuple[Line2D, list[Line2D]]:
        """Return the line of the speed so far, and of the reference if there is one."""
        reference = self._log.reference
        axes.plot(self._distance, self._speed, color=AHEAD, lw=1.5)
        (trace,) = axes.plot([], [], color=BLUE, lw=2.2, label='speed')
        line: list[Line2D] = []
        if not np.all(np.isnan(reference)):
            line = axes.plot(
                self._distance, reference, color=INK, lw=1.0, ls=DASHES, label='reference'
            )
        speeds = np.append(self._speed, reference)
        format_speed(axes, speeds, 'Position along the road [m]', ticks=6)
        axes.legend(loc='upper right', bbox_to_anchor=(1.0, -0.16), ncols=2, borderaxespad=0.0)
        return trace, line
