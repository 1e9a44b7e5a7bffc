"""The replay of a run on hills: the car from the side on its road, its speed below."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, PathPatch, Polygon
from matplotlib.path import Path
from matplotlib.transforms import Affine2D

from barc_sim.figures.output import AHEAD, RunView, draw_cursor, format_speed
from barc_sim.figures.style import (
    BLUE,
    DASHES,
    EARTH,
    INK,
    MUTED,
    SURFACE,
    VERMILLION,
    limits,
    reading,
    speed_limits,
)
from barc_sim.vehicle.bike_model import WHEEL_RADIUS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Transform
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log

    Floats = NDArray[np.float64]

#: [m] The road continues by this on both sides of the driven part, at the same grade.
MARGIN = 60.0
#: [m] between the points at which the height of a wheel is computed.
RESOLUTION = 0.02
_MOST_POINTS = 2_000_000  # beyond 40 km the points are further apart
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
GLASS, LAMP, RIM, WELL = '#DCEBF4', '#F0E442', '#D5D5D5', '#3A3A3A'

VIEW_WIDTH = 30.0  #: [m] of the map, visible at once
POST_SPACING = 10.0  #: [m] along the road
_MAX_POSTS = 100_000  # that are drawn
POSTS = 12  #: more than are visible
LABEL_WIDTH = 2.0  #: [m] of the map, at most
DEPTH = 100.0  #: [m] of earth below the road, beyond the visible part
AIR = '#F4F8FB'


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
            axes.set_xlim(*limits(self._distance, share=0.01, minimum=5.0))
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
        format_speed(axes, self._speed, 'Position along the road [m]', ticks=6)
        axes.set_ylim(*speed_limits(self._log))
        axes.legend(loc='upper right', bbox_to_anchor=(1.0, -0.16), ncols=2, borderaxespad=0.0)
        return trace, line


class Terrain:
    """Converts a distance along the road's surface to a place on the map.

    The horizontal distance is the integral of cos(theta) over the distance along the surface: 20 m
    at 10° are 19.696 m on the map. It is zero where the distance is zero. `distance`, `horizontal`
    and `elevation` [m] are the points of the road's surface, in rising order; the road is straight
    between them.
    """

    def __init__(self, log: Log) -> None:
        """Take the road from a run of at least one state; without a recorded road it is flat."""
        known = np.isfinite(log.theta_deg) & np.isfinite(log.elevation)
        rows = np.flatnonzero(known if known.any() else ~known)
        driven, first = np.unique(log.distance[rows], return_index=True)
        theta = np.radians(np.nan_to_num(log.theta_deg[rows][first]))
        theta = np.pad(theta, 1, mode='edge')
        elevation = np.nan_to_num(log.elevation[rows][first])
        before = elevation[0] - MARGIN * np.sin(theta[0])
        behind = elevation[-1] + MARGIN * np.sin(theta[-1])
        self.distance = np.concatenate([[driven[0] - MARGIN], driven, [driven[-1] + MARGIN]])
        self.elevation = np.concatenate([[before], elevation, [behind]])
        # A change of grade is somewhere between two states: each half has one of the grades.
        cosine = np.cos(theta)
        steps = np.diff(self.distance) * (cosine[:-1] + cosine[1:]) / 2.0
        horizontal = np.concatenate([[0.0], np.cumsum(steps)])
        self.horizontal = horizontal - np.interp(0.0, self.distance, horizontal)

    def at(self, distance: float | Floats) -> tuple[Floats, Floats]:
        """Return horizontal distance and elevation [m] of the road's surface at `distance`."""
        s = np.asarray(distance)
        return (
            np.interp(s, self.distance, self.horizontal),
            np.interp(s, self.distance, self.elevation),
        )

    def wheel_path(self, radius: float) -> tuple[Floats, Floats]:
        """Return the path of the centre of a wheel of `radius` [m] that rolls over the road.

        It is the lowest places, horizontal and elevation [m], at which the wheel does not sink in.
        """
        resolution = max(RESOLUTION, float(np.ptp(self.horizontal)) / _MOST_POINTS)
        horizontal = np.arange(self.horizontal[0], self.horizontal[-1], resolution)
        offsets = np.arange(-radius, radius, RESOLUTION)
        elevation = np.full(horizontal.shape, -np.inf)
        for offset, above in zip(offsets, np.sqrt(radius**2 - offsets**2), strict=True):
            surface = np.interp(horizontal + offset, self.horizontal, self.elevation)
            np.maximum(elevation, surface + above, out=elevation)
        return horizontal, elevation


class RoadScene:
    """Fills axes with the road around the car; `place` moves its `artists`, drawn in order."""

    def __init__(self, axes: Axes, terrain: Terrain) -> None:
        """Draw the road of `terrain` and the car on `axes`."""
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
        self._body, self._wheels = Affine2D(), [Affine2D() for _ in AXLES]
        car = _car(self._body + axes.transData, [each + axes.transData for each in self._wheels])
        for artist in car:
            axes.add_artist(artist)
        self.artists: list[Artist] = [
            axes.add_patch(_earth(terrain, ground)),
            axes.add_line(_posts(terrain, ground)),
            axes.add_line(
                Line2D(
                    terrain.horizontal, terrain.elevation, color=SURFACE, lw=2.5, transform=ground
                )
            ),
            *self._labels,
            *car,
        ]

    def place(self, distance: float) -> None:
        """Put the car at `distance` [m] along the road, and the camera on the car."""
        horizontal, _ = self._terrain.at(np.add(distance, AXLES))
        wheels = np.column_stack([horizontal, np.interp(horizontal, *self._wheel_path)])
        camera = wheels.mean(axis=0)
        self._camera.clear().translate(*-camera)
        along = wheels[1] - wheels[0]
        self._body.clear().rotate(np.arctan2(along[1], along[0]))
        for wheel, centre in zip(self._wheels, wheels - camera, strict=True):
            wheel.clear().rotate(-distance / WHEEL_RADIUS).translate(*centre)
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
    """Return a mark below the road at each of the first multiples of `POST_SPACING`, as a line."""
    first = np.ceil(terrain.distance[0] / POST_SPACING) * POST_SPACING
    last = min(terrain.distance[-1], first + _MAX_POSTS * POST_SPACING)
    x, y = terrain.at(np.arange(first, last, POST_SPACING))
    heights = np.column_stack([y, y - 0.5, np.full_like(y, np.nan)]).ravel()
    return Line2D(np.repeat(x, 3), heights, color=SURFACE, lw=1.2, transform=ground)


def _car(body: Transform, wheels: list[Transform]) -> list[Artist]:
    """Return the artists of the car, in the order of drawing."""
    artists: list[Artist] = [
        *(Circle((x, 0.1), 0.9 * WHEEL_ARCH, facecolor=WELL, transform=body) for x in AXLES),
        PathPatch(_outline(), facecolor=BLUE, edgecolor=INK, lw=1.0, transform=body),
        *(Polygon(points, facecolor=GLASS, transform=body) for points in WINDOWS),
        Polygon(HEADLIGHT, facecolor=LAMP, transform=body),
        Polygon(TAIL_LIGHT, facecolor=VERMILLION, transform=body),
    ]
    for wheel in wheels:
        artists += [
            Circle((0.0, 0.0), WHEEL_RADIUS, facecolor=INK, transform=wheel),
            Circle((0.0, 0.0), 0.68 * WHEEL_RADIUS, facecolor=RIM, transform=wheel),
            _spokes(wheel),
            Circle((0.0, 0.0), 0.13 * WHEEL_RADIUS, facecolor=INK, transform=wheel),
        ]
    return artists


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


def _spokes(transform: Transform) -> Line2D:
    angles = 2.0 * np.pi * np.arange(SPOKES) / SPOKES
    length = 0.62 * WHEEL_RADIUS
    # From the hub out and back, so that it is one line.
    x, y = (np.outer(f(angles), [0.0, length, 0.0]).ravel() for f in (np.cos, np.sin))
    return Line2D(x, y, color=INK, lw=2.0, transform=transform)
