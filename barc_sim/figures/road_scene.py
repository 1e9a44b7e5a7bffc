"""The car from the side on its road, to scale; the camera follows it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, PathPatch, Polygon
from matplotlib.path import Path
from matplotlib.transforms import Affine2D

from barc_sim.figures.style import BLUE, EARTH, INK, MUTED, SURFACE, VERMILLION, reading
from barc_sim.vehicle.bike_model import WHEEL_RADIUS

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.transforms import Transform
    from numpy.typing import NDArray

    Point = NDArray[np.float64]
    from barc_sim.figures.terrain import Terrain


#: [m] from the centre of mass to the rear axle and to the front axle.
AXLES = (-1.5, 1.5)
SPOKES = 5

# In metres from the middle between the axles, x forward, y up, clockwise from the rear bumper.
# Each curve is a control point and its end point.
REAR_BUMPER = (-2.12, -0.1)
OUTLINE = [
    ((-2.28, -0.1), (-2.26, 0.12)),
    ((-2.26, 0.5), (-2.12, 0.56)),
    ((-1.95, 0.62), (-1.62, 0.64)),
    ((-1.05, 1.06), (-0.55, 1.08)),
    ((0.15, 1.12), (0.55, 0.92)),
    ((0.85, 0.76), (1.08, 0.56)),
    ((1.75, 0.5), (2.08, 0.32)),
    ((2.28, 0.2), (2.28, 0.02)),
    ((2.28, -0.1), (2.12, -0.1)),
]
WINDOWS = [
    [(-1.38, 0.62), (-0.92, 0.9), (-0.55, 0.97), (-0.3, 0.98), (-0.3, 0.62)],
    [(-0.2, 0.62), (-0.2, 0.98), (0.15, 0.96), (0.48, 0.85), (0.84, 0.62)],
]
HEADLIGHT = [(2.02, 0.3), (2.17, 0.24), (2.24, 0.14), (2.06, 0.18)]
TAIL_LIGHT = [(-2.24, 0.24), (-2.22, 0.44), (-2.1, 0.46), (-2.12, 0.24)]
WHEEL_ARCH = 0.44  #: [m] radius
GLASS, LAMP, RIM = '#DCEBF4', '#F0E442', '#D5D5D5'


class SideCar:
    """Artists of a car, placed by its two wheels.

    Attributes
    ----------
    artists
        All artists, in the order of drawing.
    """

    def __init__(self, axes: Axes) -> None:
        """Add the car to `axes`, which have equal scales in metres."""
        self._body = Affine2D()
        self._wheels = [Affine2D() for _ in AXLES]
        body = self._body + axes.transData
        self.artists: list[Artist] = [
            *(_wheel_well(x, body) for x in AXLES),
            PathPatch(_outline(), facecolor=BLUE, edgecolor=INK, lw=1.0, transform=body),
            *(Polygon(points, facecolor=GLASS, transform=body) for points in WINDOWS),
            Polygon(HEADLIGHT, facecolor=LAMP, transform=body),
            Polygon(TAIL_LIGHT, facecolor=VERMILLION, transform=body),
        ]
        for wheel in self._wheels:
            place = wheel + axes.transData
            self.artists += [
                Circle((0.0, 0.0), WHEEL_RADIUS, facecolor=INK, transform=place),
                Circle((0.0, 0.0), 0.68 * WHEEL_RADIUS, facecolor=RIM, transform=place),
                _spokes(place),
                Circle((0.0, 0.0), 0.13 * WHEEL_RADIUS, facecolor=INK, transform=place),
            ]
        for artist in self.artists:
            axes.add_artist(artist)

    def place(self, rear: Point, front: Point, rolled: float) -> None:
        """Put the wheels' centres at `rear` and `front`, turned by `rolled` metres forward."""
        middle, along = (rear + front) / 2.0, front - rear
        self._body.clear().rotate(np.arctan2(along[1], along[0])).translate(*middle)
        for wheel, centre in zip(self._wheels, (rear, front), strict=True):
            wheel.clear().rotate(-rolled / WHEEL_RADIUS).translate(*centre)


def _outline() -> Path:
    points = [REAR_BUMPER]
    codes = [Path.MOVETO]
    for curve in OUTLINE:
        points += curve
        codes += [Path.CURVE3, Path.CURVE3]
    # Along the bottom back to the rear, over the front wheel first.
    arch = Path.arc(-13.0, 193.0)
    for x in reversed(AXLES):
        points += [(x + WHEEL_ARCH * u, WHEEL_ARCH * v) for u, v in np.asarray(arch.vertices)]
        codes += [Path.LINETO, *np.asarray(arch.codes)[1:]]
    return Path([*points, REAR_BUMPER], [*codes, Path.CLOSEPOLY])


def _wheel_well(x: float, transform: Transform) -> Circle:
    return Circle((x, 0.1), 0.9 * WHEEL_ARCH, facecolor='#3A3A3A', transform=transform)


def _spokes(transform: Transform) -> Line2D:
    angles = 2.0 * np.pi * np.arange(SPOKES) / SPOKES
    length = 0.62 * WHEEL_RADIUS
    # From the hub out and back, so that it is one line.
    x, y = (np.outer(f(angles), [0.0, length, 0.0]).ravel() for f in (np.cos, np.sin))
    return Line2D(x, y, color=INK, lw=2.0, transform=transform)


VIEW_WIDTH = 30.0  #: [m] of the map, visible at once
POST_SPACING = 10.0  #: [m] along the road
POSTS = 12  #: more than are visible
LABEL_WIDTH = 2.0  #: [m] of the map, at most
DEPTH = 100.0  #: [m] of earth below the road, beyond the visible part
AIR = '#F4F8FB'


class RoadScene:
    """Fills axes with the road around the car.

    Attributes
    ----------
    artists
        The artists that `place` moves, in the order of drawing.
    """

    def __init__(self, axes: Axes, terrain: Terrain) -> None:
        """Draw the road of `terrain` and the car on `axes`; `place` then moves them."""
        self._axes, self._terrain = axes, terrain
        self._wheel_path = terrain.wheel_path(WHEEL_RADIUS)
        # Equal scales, so that 30° look like 30°; a window of another shape shows more.
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
            # A text costs more than all other artists of a frame.
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
