"""The flat ground around the car, from above: a grid that scrolls, the car, and its path so far."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.transforms import Affine2D

from barc_sim.figures.style import MUTED, VERMILLION, reading
from barc_sim.figures.top_car import TopCar

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.transforms import Transform
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

VIEW_WIDTH = 44.0  #: [m] that are seen at once
FINE, COARSE = 2.0, 10.0  #: [m] between lines
REACH = 80.0  #: [m] of grid around the car: more than is ever seen
LABELS = 5  #: a side, more than are ever in view
GROUND, FINE_COLOR, COARSE_COLOR = '#F7F7F4', '#EAEAE5', '#CFCFC8'


class GroundScene:
    """Fills axes with the ground around the car.

    Attributes
    ----------
    artists
        What `place` moves, in the order of drawing.
    """

    def __init__(self, axes: Axes) -> None:
        """Draw grid, path and car on `axes`; `place` then says where."""
        self._axes = axes
        axes.set_xlim(-VIEW_WIDTH / 2.0, VIEW_WIDTH / 2.0, auto=True)
        axes.set_ylim(-10.0, 10.0, auto=True)
        axes.set_aspect('equal', adjustable='datalim')
        axes.set(facecolor=GROUND, xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
        self._grid, self._world = Affine2D(), Affine2D()
        self._path = Line2D(
            [], [], color=VERMILLION, lw=2.0, transform=self._world + axes.transData
        )
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

        `path` is where it has been, of shape `(n, 2)`; NaN breaks it.
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
    """Return lines both ways through multiples of `spacing`, as one broken line."""
    ticks = np.arange(-REACH, REACH + spacing / 2.0, spacing)
    ends = np.tile([-REACH, REACH, np.nan], len(ticks))
    at = np.repeat(ticks, 3)
    return Line2D(
        np.concatenate([at, ends]), np.concatenate([ends, at]), color=color, lw=0.8,
        transform=transform,
    )  # fmt: skip
