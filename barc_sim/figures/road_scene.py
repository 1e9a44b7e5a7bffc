"""The car from the side on its road, with a post every ten metres; the camera goes along."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.transforms import Affine2D

from barc_sim.figures.side_car import AXLES, WHEEL_RADIUS, SideCar
from barc_sim.figures.style import EARTH, MUTED, SURFACE, reading

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.transforms import Transform

    from barc_sim.figures.terrain import Terrain

VIEW_WIDTH = 30.0  #: [m] of the map that are seen at once
POST_SPACING = 10.0  #: [m] along the road
POSTS = 12  #: more than are ever in view
LABEL_WIDTH = 2.0  #: [m] of the map, at most
DEPTH = 100.0  #: [m] of earth below the road: more than is ever seen
AIR = '#F4F8FB'


class RoadScene:
    """Fills axes with the road around the car.

    Attributes
    ----------
    artists
        What `place` moves, in the order of drawing.
    """

    def __init__(self, axes: Axes, terrain: Terrain) -> None:
        """Draw the road of `terrain` and the car on `axes`; `place` then says where."""
        self._axes, self._terrain = axes, terrain
        self._wheel_path = terrain.wheel_path(WHEEL_RADIUS)
        # One scale for both, so that 30° are 30°: in a window of another shape more is seen.
        axes.set_xlim(-VIEW_WIDTH / 2.0, VIEW_WIDTH / 2.0, auto=True)
        axes.set_ylim(-3.5, 5.0, auto=True)
        axes.set_aspect('equal', adjustable='datalim')
        axes.set(facecolor=AIR, xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
        self._camera = Affine2D()
        ground = self._camera + axes.transData
        self._labels = [
            axes.text(0, 0, '', transform=ground, ha='center', va='top', color=MUTED, clip_on=True)
            for _ in range(POSTS)
        ]
        self._car = SideCar(axes)
        self.artists: list[Artist] = [
            axes.add_patch(_earth(terrain, ground)),
            axes.add_line(_posts(terrain, ground)),
            axes.add_line(
                Line2D(
                    terrain.horizontal, terrain.elevation, color=SURFACE, lw=2.5, transform=ground
                )
            ),
            *self._labels,
            *self._car.artists,
        ]

    def place(self, distance: float) -> None:
        """Put the car at `distance` [m] along the road, and the camera on the car."""
        horizontal, _ = self._terrain.at(np.add(distance, AXLES))
        wheels = np.column_stack([horizontal, np.interp(horizontal, *self._wheel_path)])
        camera = wheels.mean(axis=0)
        self._camera.clear().translate(*-camera)
        rear, front = wheels - camera
        self._car.place(rear, front, rolled=distance)
        edge = self._axes.get_xlim()[1] + LABEL_WIDTH / 2.0
        first = np.ceil(distance / POST_SPACING - POSTS / 2) * POST_SPACING
        for i, label in enumerate(self._labels):
            post = first + i * POST_SPACING
            x, y = (float(place) for place in self._terrain.at(post))
            # A text costs more than all else in a frame.
            label.set_visible(abs(x - camera[0]) < edge)
            label.set_position((x, y - 0.7))
            label.set_text(reading(post, 0, ' m'))


def _earth(terrain: Terrain, ground: Transform) -> Polygon:
    x, y = terrain.horizontal, terrain.elevation
    bottom = y.min() - DEPTH
    outline = np.column_stack([[x[0], *x, x[-1]], [bottom, *y, bottom]])
    return Polygon(outline, facecolor=EARTH, transform=ground)


def _posts(terrain: Terrain, ground: Transform) -> Line2D:
    """Return marks below the road at the multiples of `POST_SPACING`, as one broken line."""
    first = np.ceil(terrain.distance[0] / POST_SPACING) * POST_SPACING
    x, y = terrain.at(np.arange(first, terrain.distance[-1], POST_SPACING))
    heights = np.column_stack([y, y - 0.5, np.full_like(y, np.nan)]).ravel()
    return Line2D(np.repeat(x, 3), heights, color=SURFACE, lw=1.2, transform=ground)
