"""The car from above on flat ground, to scale, with its path; the camera follows it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import FancyBboxPatch, Polygon, Rectangle
from matplotlib.transforms import Affine2D

from barc_sim.figures.road_scene import AXLES, GLASS, LAMP
from barc_sim.figures.style import BLUE, INK, MUTED, VERMILLION, reading
from barc_sim.vehicle.bike_model import HALF_TRACK, WHEEL_WIDTH

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.transforms import Transform
    from numpy.typing import NDArray

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


class TopCar:
    """Artists of a car in the middle of its axes, placed by heading and steering.

    Attributes
    ----------
    artists
        All artists, in the order of drawing.
    """

    def __init__(self, axes: Axes) -> None:
        """Add the car to `axes`, which have equal scales in metres."""
        self._body = Affine2D()
        self._front = [Affine2D() for _ in (-1, 1)]
        body = self._body + axes.transData
        rear, front = AXLES
        mirrored = [([(x, -y) for x, y in points], color) for points, color in LIGHTS]
        self.artists: list[Artist] = [
            *(_wheel(Affine2D().translate(rear, side * HALF_TRACK) + body) for side in (-1, 1)),
            *(_wheel(wheel + body) for wheel in self._front),
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
            *(
                Polygon(points, facecolor=color, transform=body)
                for points, color in [*LIGHTS, *mirrored]
            ),
        ]
        self._axle = front
        for artist in self.artists:
            axes.add_artist(artist)

    def place(self, psi: float, servo: float) -> None:
        """Turn the car to heading `psi` [rad], and its front wheels by `servo` [rad]."""
        self._body.clear().rotate(psi)
        for side, wheel in zip((-1, 1), self._front, strict=True):
            wheel.clear().rotate(servo).translate(self._axle, side * HALF_TRACK)


def _wheel(transform: Transform) -> Rectangle:
    length, width = WHEEL
    return Rectangle(
        (-length / 2.0, -width / 2.0), length, width, facecolor=INK, transform=transform
    )


VIEW_WIDTH = 44.0  #: [m] visible at once
FINE, COARSE = 2.0, 10.0  #: [m] between lines
REACH = 80.0  #: [m] of grid around the car, beyond the visible part
LABELS = 5  #: on each side, more than are visible
GROUND, FINE_COLOR, COARSE_COLOR = '#F7F7F4', '#EAEAE5', '#CFCFC8'


class GroundScene:
    """Fills axes with the ground around the car.

    Attributes
    ----------
    artists
        The artists that `place` moves, in the order of drawing.
    """

    def __init__(self, axes: Axes) -> None:
        """Draw grid, path and car on `axes`; `place` then moves them."""
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
        self._car = TopCar(axes)
        self.artists: list[Artist] = [*lines, *self._labels, self._path, *self._car.artists]

    def place(self, x: float, y: float, psi: float, servo: float, path: Floats) -> None:
        """Put the car at `x`, `y` [m], and the camera above it.

        `path` has its earlier positions, shape `(n, 2)`; NaN breaks the line.
        """
        self._world.clear().translate(-x, -y)
        self._grid.clear().translate(-(x % COARSE), -(y % COARSE))
        self._path.set_data(path[:, 0], path[:, 1])
        self._car.place(psi, servo)
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
