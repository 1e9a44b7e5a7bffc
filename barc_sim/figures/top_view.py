"""The replay of a drive by hand: the car from above, its speed over time below."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import FancyBboxPatch, Polygon, Rectangle
from matplotlib.transforms import Affine2D

from barc_sim.figures.output import AHEAD, RunView, draw_cursor, format_speed
from barc_sim.figures.run_figures import JUMP
from barc_sim.figures.side_view import AXLES, GLASS, LAMP
from barc_sim.figures.style import BLUE, INK, MUTED, VERMILLION, limits, reading
from barc_sim.vehicle.bike_model import HALF_TRACK, WHEEL_WIDTH

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Transform
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log

    Floats = NDArray[np.float64]

# In metres from the centre of mass, x forward, y to the left.
REAR, FRONT, HALF_WIDTH = -2.2, 2.2, 0.88
ROUNDING = 0.35
WINDOWS = [
    [(0.95, 0.72), (0.3, 0.6), (0.3, -0.6), (0.95, -0.72)],
    [(-1.55, 0.62), (-1.1, 0.56), (-1.1, -0.56), (-1.55, -0.62)],
    [(0.75, 0.78), (0.2, 0.68), (-1.05, 0.64), (-1.35, 0.74)],
    [(0.75, -0.78), (0.2, -0.68), (-1.05, -0.64), (-1.35, -0.74)],
]
LIGHTS = [
    ([(2.05, 0.75), (2.19, 0.6), (2.19, 0.4), (2.08, 0.5)], LAMP),
    ([(-2.19, 0.7), (-2.12, 0.7), (-2.12, 0.35), (-2.19, 0.35)], VERMILLION),
]
WHEEL = (0.7, WHEEL_WIDTH)  #: [m] length and width
SIDES = (-1, 1)

VIEW_WIDTH = 44.0  #: [m] visible at once
FINE, COARSE = 2.0, 10.0  #: [m] between lines
REACH = 80.0  #: [m] of grid around the car, beyond the visible part
LABELS = 5  #: on each side, more than are visible
GROUND, FINE_COLOR, COARSE_COLOR = '#F7F7F4', '#EAEAE5', '#CFCFC8'


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
        axes.set_xlim(*limits(t, share=0.01, minimum=1.0))
        format_speed(axes, speed, 'Time [s]', ticks=5)
        return trace


def suits(log: Log) -> bool:
    """Return whether a run is best seen from above: on the flat, without a speed controller."""
    return bool(np.isnan(log.reference).all() and not np.nan_to_num(log.elevation).any())


class GroundScene:
    """Fills axes with the ground around the car; `place` moves its `artists`, drawn in order."""

    def __init__(self, axes: Axes) -> None:
        """Draw grid, path and car on `axes`."""
        self._axes = axes
        axes.set_xlim(-VIEW_WIDTH / 2.0, VIEW_WIDTH / 2.0, auto=True)
        axes.set_ylim(-10.0, 10.0, auto=True)
        axes.set_aspect('equal', adjustable='datalim')
        axes.set(facecolor=GROUND, xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
        self._grid, self._world = Affine2D(), Affine2D()
        self._path = Line2D([], [], color=BLUE, lw=2.0, transform=self._world + axes.transData)
        lines = [
            _grid(spacing, color, self._grid + axes.transData)
            for spacing, color in ((FINE, FINE_COLOR), (COARSE, COARSE_COLOR))
        ]
        for line in (*lines, self._path):
            axes.add_line(line)
        self._labels = [
            axes.text(0.0, 0.0, '', color=MUTED, fontsize=8, ha='left', va='bottom', clip_on=True)
            for _ in range(2 * LABELS + 1)
        ]
        self._body, self._front = Affine2D(), [Affine2D() for _ in SIDES]
        body = self._body + axes.transData
        car = _car(body, [wheel + body for wheel in self._front])
        for artist in car:
            axes.add_artist(artist)
        self.artists: list[Artist] = [*lines, *self._labels, self._path, *car]

    def place(self, x: float, y: float, psi: float, servo: float, path: Floats) -> None:
        """Put the car at `x`, `y` [m], and the camera above it.

        `path` has its earlier positions, shape `(n, 2)`; NaN breaks the line.
        """
        self._world.clear().translate(-x, -y)
        self._grid.clear().translate(-(x % COARSE), -(y % COARSE))
        self._path.set_data(path[:, 0], path[:, 1])
        self._body.clear().rotate(psi)
        for side, wheel in zip(SIDES, self._front, strict=True):
            wheel.clear().rotate(servo).translate(AXLES[1], side * HALF_TRACK)
        left, right = self._axes.get_xlim()
        bottom = self._axes.get_ylim()[0]
        first = np.floor(x / COARSE) - LABELS
        for k, label in enumerate(self._labels):
            at = (first + k) * COARSE
            label.set_visible(bool(left < at - x < right - 2.0))
            label.set_position((at - x + 0.3, bottom + 0.3))
            label.set_text(reading(float(at), 0, ' m'))


def _grid(spacing: float, color: str, transform: Transform) -> Line2D:
    """Return a grid with lines at the multiples of `spacing`, as one broken line."""
    ticks = np.arange(-REACH, REACH + spacing / 2.0, spacing)
    ends = np.tile([-REACH, REACH, np.nan], len(ticks))
    at = np.repeat(ticks, 3)
    return Line2D(
        np.concatenate([at, ends]), np.concatenate([ends, at]), color=color, lw=0.8,
        transform=transform,
    )  # fmt: skip


def _car(body: Transform, front: list[Transform]) -> list[Artist]:
    """Return the artists of the car, in the order of drawing: wheels, then what covers them."""
    mirrored = [([(x, -y) for x, y in points], color) for points, color in LIGHTS]
    return [
        *(_wheel(Affine2D().translate(AXLES[0], side * HALF_TRACK) + body) for side in SIDES),
        *map(_wheel, front),
        FancyBboxPatch(
            (REAR + ROUNDING, -HALF_WIDTH + ROUNDING),
            FRONT - REAR - 2.0 * ROUNDING,
            2.0 * (HALF_WIDTH - ROUNDING),
            boxstyle=f'round,pad={ROUNDING}',
            facecolor=BLUE,
            edgecolor=INK,
            lw=1.0,
            transform=body,
        ),
        *(Polygon(points, facecolor=GLASS, transform=body) for points in WINDOWS),
        *(Polygon(points, facecolor=color, transform=body) for points, color in LIGHTS + mirrored),
    ]


def _wheel(transform: Transform) -> Rectangle:
    length, width = WHEEL
    return Rectangle(
        (-length / 2.0, -width / 2.0), length, width, facecolor=INK, transform=transform
    )
