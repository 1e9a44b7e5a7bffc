"""Draws a run at any of its times, from the side or from above, and saves videos of it."""

from __future__ import annotations

import subprocess
import sys
from abc import ABC, abstractmethod
from contextlib import suppress
from itertools import chain
from math import isnan
from shutil import which
from typing import IO, TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

import numpy as np
from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyBboxPatch, PathPatch, Polygon, Rectangle
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D

from barc_sim.errors import UserError
from barc_sim.figures.colours import (
    BLUE,
    DASHES,
    EARTH,
    GREY,
    INK,
    MUTED,
    STYLE,
    SURFACE,
    VERMILLION,
)
from barc_sim.figures.drawn_log import (
    driven_road,
    limits,
    reading,
    speed_limits,
    with_zero_for_unknown_errors,
)
from barc_sim.figures.run_figures import is_by_hand
from barc_sim.figures.track_figure import draw_course
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import laps_of, settings_of, settings_text, track_laps_of
from barc_sim.vehicle.bike_model import HALF_TRACK, WHEEL_RADIUS, WHEEL_WIDTH
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    import pathlib
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.text import Text
    from matplotlib.transforms import Transform
    from numpy.typing import NDArray
    from PIL import Image

    from barc_sim.simulation.log import Log

    Floats = NDArray[np.float64]
    Images = Iterable[NDArray[np.uint8]]
    Box = tuple[float, float, float, float]  # left, bottom, width and height, as shares

SIZE = (12.8, 7.2)  #: [inch]
AHEAD = '#C4D3DD'  #: colour of the part of the run after the shown time
#: [m] from the centre of mass to the rear axle and to the front axle.
AXLES = (-1.5, 1.5)
BEYOND = 60.0  #: [m] of road drawn before and after a run
POST = 10.0  #: [m] between two labels of the position; from above, the side of a square
LABELS = 12  #: labels, more than are visible at once
_READING_WIDTH = 0.135  #: maximum, as a share
_READINGS_WIDTH = 0.81  #: of all together, maximum, as a share
# Colours of parts of the car.
GLASS = '#DCEBF4'
LAMP = '#F0E442'
RIM = '#D5D5D5'
WELL = '#3A3A3A'


class RoadStretch(NamedTuple):
    """The part of a road that a view draws."""

    road: Road
    start: float  #: [m]
    end: float  #: [m]


class RunView(ABC):
    """A view of a run at one time, with a scene, the whole course and a chart.

    `update` moves its `artists`, which are drawn in order. At first it shows the first state.

    Parameters
    ----------
    log
        The run.
    figure
        The empty figure to draw on.
    title
        The heading.
    stretch
        The part of a road to draw; by default the part that the run has driven.
    """

    #: The boxes of scene, course and chart.
    PLACES: ClassVar[tuple[Box, Box, Box]]
    VIEW_WIDTH: ClassVar[float]  #: [m] visible at once in the scene
    artists: Sequence[Artist]
    #: By state: horizontal values of the chart, with their label, and x and y on the course.
    along: Floats
    along_name: str
    course: tuple[Floats, Floats]
    #: The values of the chart, with their label and limits.
    charted: Floats
    charted_name = 'Speed [m/s]'
    chart_limits: tuple[float, float]

    def __init__(
        self, log: Log, figure: Figure, *, title: str = '', stretch: RoadStretch | None = None
    ) -> None:
        self.figure = figure
        figure.set_facecolor('white')  # with any matplotlibrc
        self._fixed_stretch = stretch
        self.read(log)

        with style.context(STYLE):
            scene, course, chart = [figure.add_axes(place) for place in self.PLACES]
            moving = self._draw_scene(scene)
            # Equal scales, so that 30° look like 30°; a window of another shape shows more.
            scene.set_xlim(-self.VIEW_WIDTH / 2.0, self.VIEW_WIDTH / 2.0, auto=True)
            scene.set_ylim(-3.5, 5.0, auto=True)
            scene.set_aspect('equal', adjustable='datalim')
            scene.set(xticks=[], yticks=[])
            scene.spines[:].set_visible(False)

            self._draw_course(course)
            (self._place_on_course,) = course.plot([], [], 'o', color=VERMILLION, mec='white', ms=8)
            moving.append(self._place_on_course)
            moving += self._draw_chart(chart)
            self._readings = self._draw_readings(figure.add_axes((0.06, 0.9, 0.925, 0.1)), title)

        self.artists = [*moving, *self._readings.values()]
        # Above the fixed parts and in this order; by default Matplotlib draws lines over patches.
        for order, artist in enumerate(self.artists, start=10):
            artist.set(animated=True, zorder=order)
        self.update(0.0)

    def read(self, log: Log) -> None:
        """Show this run from now on, with the same fixed parts."""
        self.duration = float(log.t[-1])  #: [s] from the run's first state to its last
        self._log = with_zero_for_unknown_errors(log)
        self.charted = self._log.speed
        # A return to the start begins a lap: nothing is drawn between the two states.
        _, numbers = laps_of(self._log)
        self._starts = np.flatnonzero(np.diff(numbers, prepend=-1))
        self._settings = settings_of(self._log)

    def _note(self, k: int, number: int) -> str:
        """Return what is written beside the chart: the lap, if there are several, and the gains."""
        values = {name: float(of_states[k]) for name, of_states in self._settings.items()}
        settings = {name: value for name, value in values.items() if not isnan(value)}
        gains = settings_text([settings])
        lap = f'lap {number + 1}' if len(self._starts) > 1 else ''
        return ': '.join(text for text in (lap, gains) if text)

    @abstractmethod
    def _draw_scene(self, axes: Axes) -> list[Artist]:
        """Draw the surroundings and the car; return the artists that `_place` moves."""

    @abstractmethod
    def _place(self, k: int, t: float, x: float, y: float) -> Mapping[str, str]:
        """Move the car to its place at `t` [s], after state `k`; return the view's own readings."""

    def update(self, t: float) -> None:
        """Show the run at `t` [s]: interpolated positions, and commands of the last state."""
        for name, text in self._show(t).items():
            self._readings[name].set_text(text)

    def _show(self, t: float) -> dict[str, str]:
        """Move the artists to their places at `t` [s]; return the readings."""
        log = self._log
        k = int(np.searchsorted(log.t, t + 1e-9, side='right')) - 1
        if k + 1 in self._starts:  # there is nothing between the last state of a lap and the next
            t = float(log.t[k])

        def at_time(values: Floats) -> float:
            return float(np.interp(t, log.t, values))

        along = at_time(self.along)
        charted = at_time(self.charted)
        course_x, course_y = self.course
        x = at_time(course_x)
        y = at_time(course_y)
        self._place_on_course.set_data([x], [y])

        number = int(np.searchsorted(self._starts, k, side='right')) - 1
        lap = slice(self._starts[number], k + 1)
        self._trace.set_data(
            np.append(self.along[lap], along), np.append(self.charted[lap], charted)
        )
        self._note_text.set_text(self._note(k, number))
        self._cursor.set_xdata([along, along])
        self._dot.set_data([along], [charted])
        return {
            'Time': reading(t, 2, ' s'),
            'Speed': reading(at_time(log.speed), 2, ' m/s'),
            **self._place(k, t, x, y),
            'Command': reading(float(log.motor[k]), 2, ' m/s²'),
        }

    @abstractmethod
    def _draw_course(self, axes: Axes) -> None:
        """Draw the whole course."""

    def _draw_chart(self, axes: Axes) -> list[Artist]:
        """Draw the chart; return its moving lines: values so far, reference, and cursor."""
        log = self._log
        along_of_laps = np.split(self.along, self._starts)
        charted_of_laps = np.split(self.charted, self._starts)
        for along, charted in zip(along_of_laps, charted_of_laps, strict=True):
            axes.plot(along, charted, color=AHEAD, lw=1.5)

        (self._trace,) = axes.plot([], [], color=BLUE, lw=2.2, label='speed')
        lines: list[Artist] = [self._trace]
        if self.charted_name == RunView.charted_name and not np.isnan(log.reference).all():
            lines += axes.plot(
                self.along, log.reference, color=INK, lw=1.0, ls=DASHES, label='reference'
            )
            axes.legend(loc='upper right', bbox_to_anchor=(1.0, -0.16), ncols=2, borderaxespad=0.0)

        self._cursor = axes.axvline(0.0, color=GREY, lw=0.8)
        (self._dot,) = axes.plot([], [], 'o', color=BLUE, mec='white', mew=1.2, ms=8)
        axes.set(xlabel=self.along_name, ylabel=self.charted_name, ylim=self.chart_limits)
        axes.set_xlim(*limits(self.along, share=0.01, minimum=1.0))
        axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
        axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        self._note_text = axes.text(
            0.0, -0.2, '', transform=axes.transAxes, va='top', color=MUTED, fontsize=9
        )
        return [*lines, self._cursor, self._dot, self._note_text]

    def _draw_readings(self, axes: Axes, title: str) -> dict[str, Text]:
        axes.set_axis_off()
        axes.text(0.0, 0.5, title, fontsize=13, fontweight='bold', va='center')
        names = list(self._show(0.0))
        width = min(_READING_WIDTH, _READINGS_WIDTH / len(names))
        readings = {}
        for index, name in enumerate(names):
            x = 1.0 - width * (len(names) - 1 - index)
            axes.text(x, 0.68, name, color=MUTED, fontsize=9, ha='right', va='bottom')
            readings[name] = axes.text(x, 0.56, '', fontsize=15, ha='right', va='top')
        return readings


class SideView(RunView):
    """The car from the side on its road."""

    PLACES: ClassVar = (
        (0.0, 0.4, 1.0, 0.5),
        (0.06, 0.295, 0.925, 0.08),
        (0.06, 0.09, 0.925, 0.19),
    )
    VIEW_WIDTH = 30.0

    along_name = 'Position along the road [m]'

    def read(self, log: Log) -> None:
        """Show this run from now on, with the same fixed parts."""
        super().read(log)
        self.along = self._log.distance
        self._stretch = self._fixed_stretch or RoadStretch(
            road=driven_road(self._log) or Road.flat(),
            start=float(self.along.min()),
            end=float(self.along.max()),
        )
        self._road = self._stretch.road
        self.course = (self.along, np.asarray(self._road.elevation(self.along)))

    def _draw_scene(self, axes: Axes) -> list[Artist]:
        self.chart_limits = speed_limits(self._log)
        axes.set(facecolor='#F4F8FB')
        self._camera = Affine2D()
        self._body = Affine2D()
        self._wheel = Affine2D()

        ground = self._camera + axes.transData
        x, y = self._on_map(self._kinks(BEYOND))
        bottom = y.min() - 100.0
        earth = np.column_stack([[x[0], *x, x[-1]], [bottom, *y, bottom]])
        self._labels = [
            axes.text(0, 0, '', transform=ground, ha='center', va='top', color=MUTED, clip_on=True)
            for _ in range(LABELS)
        ]
        car = _car_from_the_side(self._body + axes.transData, self._wheel)
        for artist in car:
            axes.add_artist(artist)
        return [
            axes.add_patch(Polygon(earth, facecolor=EARTH, transform=ground)),
            axes.add_line(Line2D(x, y, color=SURFACE, lw=2.5, transform=ground)),
            *self._labels,
            *car,
        ]

    def _kinks(self, beyond: float) -> Floats:
        """Return the positions [m] where the grade changes, with the ends of the drawn road."""
        first = self._stretch.start - beyond
        last = self._stretch.end + beyond
        inside = [s for s in self._road.starts if first < s < last]
        return np.array([first, *inside, last])

    def _on_map(self, s: Floats) -> tuple[Floats, Floats]:
        """Return horizontal distance and elevation [m] at positions along the road [m]."""
        return np.asarray(self._road.horizontal(s)), np.asarray(self._road.elevation(s))

    def _draw_course(self, axes: Axes) -> None:
        """Draw the whole road, with exaggerated heights."""
        x = self._kinks(0.0)
        y = np.asarray(self._road.elevation(x))
        axes.plot(x, y, color=SURFACE, lw=1.2)
        axes.set_axis_off()
        axes.fill_between(x, y, y.min() - 2.0, color=EARTH)
        axes.set_ylim(y.min() - 2.0, y.max() + max(2.0, 0.3 * float(np.ptp(y))))
        axes.set_xlim(*limits(x, share=0.01, minimum=1.0))

    def _place(self, k: int, _t: float, x: float, _y: float) -> Mapping[str, str]:
        rear, front = np.column_stack(self._on_map(np.add(x, AXLES)))
        along = (front - rear) / np.hypot(*(front - rear))
        up = np.array([-along[1], along[0]])
        camera = (rear + front) / 2.0 + WHEEL_RADIUS * up

        self._camera.clear().translate(*-camera)
        self._body.clear().rotate(np.arctan2(along[1], along[0]))
        self._wheel.clear().rotate(-x / WHEEL_RADIUS)

        first_post = np.ceil(x / POST - LABELS / 2) * POST
        for index, label in enumerate(self._labels):
            post = first_post + index * POST
            horizontal, elevation = self._on_map(post)
            # Hidden if outside: a text takes longer to draw than all other artists of a frame.
            label.set_visible(abs(float(horizontal) - camera[0]) < self.VIEW_WIDTH / 2.0)
            label.set_position((float(horizontal), float(elevation)))
            label.set_text(f'|\n{reading(post, 0, " m")}')

        log = self._log
        return {
            'Reference': reading(float(log.reference[k]), 2, ' m/s'),
            'Grade': reading(float(log.theta_deg[k]), 0, '°'),
        }


def _car_from_the_side(body: Transform, wheel: Affine2D) -> list[Artist]:
    """Return the artists of the car in metres from the middle between its wheels."""
    outline = [(-2.12, -0.1), (-2.28, -0.1), (-2.26, 0.12), (-2.26, 0.5), (-2.12, 0.56)]
    outline += [(-1.95, 0.62), (-1.62, 0.64), (-1.05, 1.06), (-0.55, 1.08), (0.15, 1.12)]
    outline += [(0.55, 0.92), (0.85, 0.76), (1.08, 0.56), (1.75, 0.5), (2.08, 0.32), (2.28, 0.2)]
    outline += [(2.28, 0.02), (2.28, -0.1), (2.12, -0.1), (-2.12, -0.1)]
    curve = Path(outline, [Path.MOVETO, *[Path.CURVE3] * 18, Path.CLOSEPOLY])
    shapes = {
        GLASS: [
            [(-1.38, 0.62), (-0.92, 0.9), (-0.55, 0.97), (-0.3, 0.98), (-0.3, 0.62)],
            [(-0.2, 0.62), (-0.2, 0.98), (0.15, 0.96), (0.48, 0.85), (0.84, 0.62)],
        ],
        LAMP: [[(2.02, 0.3), (2.17, 0.24), (2.24, 0.14), (2.06, 0.18)]],
        VERMILLION: [[(-2.24, 0.24), (-2.22, 0.44), (-2.1, 0.46), (-2.12, 0.24)]],
    }
    artists: list[Artist] = [PathPatch(curve, facecolor=BLUE, edgecolor=INK, transform=body)]
    for colour, polygons in shapes.items():
        artists += [Polygon(points, facecolor=colour, transform=body) for points in polygons]

    # Each spoke goes out from the hub and back, so that all are one line.
    angles = 2.0 * np.pi * np.arange(5) / 5.0
    radii = [0.0, 0.62 * WHEEL_RADIUS, 0.0]
    spokes_x = np.outer(np.cos(angles), radii).ravel()
    spokes_y = np.outer(np.sin(angles), radii).ravel()
    for axle in AXLES:
        at = wheel + Affine2D().translate(axle, 0.0) + body
        artists += [
            Circle((axle, 0.04), 1.16 * WHEEL_RADIUS, facecolor=WELL, transform=body),
            Circle((0.0, 0.0), WHEEL_RADIUS, facecolor=INK, transform=at),
            Circle((0.0, 0.0), 0.68 * WHEEL_RADIUS, facecolor=RIM, transform=at),
            Line2D(spokes_x, spokes_y, color=INK, lw=2.0, transform=at),
        ]
    return artists


class TopView(RunView):
    """The car from above, on a grid, with its path, and with the edges of its track.

    On a track, a pale car shows the best lap at the same lap time.
    """

    PLACES: ClassVar = ((0.0, 0.28, 1.0, 0.62), (0.77, 0.02, 0.22, 0.24), (0.06, 0.09, 0.68, 0.165))
    VIEW_WIDTH = 50.0

    def read(self, log: Log) -> None:
        """Show this run from now on, with the same fixed parts."""
        super().read(log)
        x, y, self._psi = self._log.true_pose
        self._path = np.column_stack([x, y])
        self._path[self._starts[1:] - 1] = np.nan  # so that the next state begins a new line
        self.course = (x, y)
        if isinstance(log, TrackLog):
            self._on_track: TrackLog | None = log
            self._track = log.track
            self._laps, self._numbers = track_laps_of(log)
            self.along = log.s
            self.along_name = 'Distance along the track, over all laps [m]'
            self.charted = log.e_y
            self.charted_name = 'e_y [m]'
            self.chart_limits = limits(self.charted, share=0.15, minimum=0.1)
        else:
            self._on_track = None
            self._track = None
            self.along = self._log.t
            self.along_name = 'Time [s]'
            self.chart_limits = limits(self.charted, share=0.15, minimum=1.0)

    def _draw_scene(self, axes: Axes) -> list[Artist]:
        axes.set(facecolor='#F7F7F4')
        axes.text(0.01, 0.03, f'squares of {POST:g} m', transform=axes.transAxes, color=MUTED)
        self._grid = Affine2D()
        self._world = Affine2D()
        self._body = Affine2D()
        self._steering = Affine2D()

        world = self._world + axes.transData
        self._trail = Line2D([], [], color=BLUE, lw=2.0, transform=world)
        moving: list[Artist] = [
            _grid(2.0, '#EAEAE5', self._grid + axes.transData),
            _grid(POST, '#CFCFC8', self._grid + axes.transData),
        ]
        if self._on_track:
            self._ghost = Affine2D()
            self._ghost_steering = Affine2D()
            self._pale = _car_from_above(self._ghost + axes.transData, self._ghost_steering)
            for artist in self._pale:
                artist.set_alpha(0.3)
            moving += self._pale
        moving += [self._trail, *_car_from_above(self._body + axes.transData, self._steering)]
        for artist in moving:
            if isinstance(artist, Line2D):
                axes.add_line(artist)
            else:
                axes.add_artist(artist)

        if self._track:
            # The two grids are above the ground, and below the lines of the course.
            course = draw_course(axes, self._track, world)
            moving = [course[0], *moving[:2], *course[1:], *moving[2:]]
        return moving

    def _draw_course(self, axes: Axes) -> None:
        """Draw the whole path, or the whole track."""
        if self._track:
            draw_course(axes, self._track)
        else:
            axes.plot(*self._path.T, color=AHEAD, lw=1.5)
        axes.set_aspect('equal', adjustable='datalim')
        axes.set_axis_off()
        axes.margins(0.1)

    def _place(self, k: int, t: float, x: float, y: float) -> Mapping[str, str]:
        psi = float(np.interp(t, self._log.t, self._psi))
        servo = float(self._log.servo[k])
        self._world.clear().translate(-x, -y)
        self._grid.clear().translate(-(x % POST), -(y % POST))
        self._trail.set_data(*np.vstack([self._path[: k + 1], (x, y)]).T)
        self._body.clear().rotate(psi)
        self._steering.clear().rotate(np.nan_to_num(servo))
        # Rounded first: 359.7° is shown as 0°.
        readings = {'Heading': reading(round(float(np.degrees(psi))) % 360.0, 0, '°')}
        if self._on_track:
            readings = self._place_ghost(self._on_track, k, t, x, y)
        return {**readings, 'Steering': reading(float(np.degrees(servo)), 1, '°')}

    def _place_ghost(self, log: TrackLog, k: int, t: float, x: float, y: float) -> dict[str, str]:
        """Move the pale car to its place in the best lap; return the readings of the lap."""
        best = self._laps.best
        lap_time = float(log.lap_time[k] + t - log.t[k])
        is_visible = best is not None and best.number != self._numbers[k] and lap_time <= best.time
        for artist in self._pale:
            artist.set_visible(is_visible)

        if best is not None and is_visible:
            time_in_best = best.start + lap_time
            course_x, course_y = self.course
            ghost_x = float(np.interp(time_in_best, log.t, course_x))
            ghost_y = float(np.interp(time_in_best, log.t, course_y))
            psi = float(np.interp(time_in_best, log.t, self._psi))
            servo = float(np.interp(time_in_best, log.t, log.servo))
            self._ghost.clear().rotate(psi).translate(ghost_x - x, ghost_y - y)
            self._ghost_steering.clear().rotate(np.nan_to_num(servo))
        return {
            'Lap': f'{self._numbers[k] + 1}',
            'Lap time': reading(lap_time, 2, ' s'),
            'e_y': reading(float(np.interp(t, log.t, log.e_y)), 2, ' m'),
        }


def _grid(spacing: float, color: str, transform: Transform) -> Line2D:
    """Return a grid with lines at multiples of `spacing` [m], as one broken line."""
    reach = 80.0
    ticks = np.arange(-reach, reach + spacing / 2.0, spacing)
    ends = np.tile([-reach, reach, np.nan], len(ticks))
    places = np.repeat(ticks, 3)
    x = np.concatenate([places, ends])
    y = np.concatenate([ends, places])
    return Line2D(x, y, color=color, lw=0.8, transform=transform)


def _car_from_above(body: Transform, steering: Affine2D) -> list[Artist]:
    """Return the artists of the car in metres from its middle: rear wheels, front wheels, hull."""
    rear, front = AXLES
    wheels = []
    for axle, rotation in ((rear, Affine2D()), (front, steering)):
        for side in (-1, 1):
            place = Affine2D().translate(axle, side * HALF_TRACK)
            wheels.append(_wheel_from_above(rotation + place + body))

    hull = FancyBboxPatch(
        (-1.85, -0.53), 3.7, 1.06, boxstyle='round,pad=0.35', fc=BLUE, ec=INK, transform=body
    )
    windows = [
        [(0.95, 0.72), (0.3, 0.6), (0.3, -0.6), (0.95, -0.72)],
        [(-1.55, 0.62), (-1.1, 0.56), (-1.1, -0.56), (-1.55, -0.62)],
    ]
    head_lamps = []
    tail_lamps = []
    for side in (-1, 1):
        head_lamps.append([(2.05, 0.75 * side), (2.19, 0.6 * side), (2.08, 0.4 * side)])
        tail_lamps.append([(-2.19, 0.7 * side), (-2.1, 0.7 * side), (-2.15, 0.3 * side)])

    details = []
    for colour, polygons in ((GLASS, windows), (LAMP, head_lamps), (VERMILLION, tail_lamps)):
        details += [Polygon(points, facecolor=colour, transform=body) for points in polygons]
    return [*wheels, hull, *details]


def _wheel_from_above(transform: Transform) -> Rectangle:
    length = 0.7
    corner = (-length / 2.0, -WHEEL_WIDTH / 2.0)
    return Rectangle(corner, length, WHEEL_WIDTH, facecolor=INK, transform=transform)


def view_of(
    log: Log, figure: Figure, title: str = '', stretch: RoadStretch | None = None
) -> RunView:
    """Return the view of a run: from above on a track or by hand on the flat, else the side.

    The parameters are those of `RunView`.
    """
    if isinstance(log, TrackLog) or is_by_hand(log):
        return TopView(log, figure, title=title, stretch=stretch)
    return SideView(log, figure, title=title, stretch=stretch)


# An .mp4 has 1280 x 720 pixels, and every state.
MP4_DPI = 100
MP4_FPS = 50
# A GIF has 960 x 540 pixels: it is large, and its unit of time is 10 ms.
GIF_DPI = 75
GIF_FPS = 25
# The index comes first, so that a browser plays the file while it loads. The colour space is
# stated, so that players do not guess it. `superfast` takes half as long as `veryfast`, and less
# than the drawing, which runs in parallel; the file is 1.7 times as large.
ENCODING = {
    '-codec:v': 'libx264',
    '-pix_fmt': 'yuv420p',
    '-crf': '20',
    '-preset': 'superfast',
    '-tune': 'zerolatency',
    '-vf': 'scale=out_color_matrix=bt709:out_range=tv',
    '-colorspace': 'bt709',
    '-movflags': '+faststart',
}


def save_video(log: Log, path: pathlib.Path, *, title: str = '') -> None:
    """Write a video of a run in real time; a progress bar appears if stderr is a terminal.

    Parameters
    ----------
    log
        The run.
    path
        The file to write, whose name ends in .mp4 or .gif.
    title
        The heading.

    Raises
    ------
    UserError
        There is no ffmpeg, which an .mp4 needs.
    """
    from rich.console import Console  # noqa: PLC0415 (slow: not for figures)
    from rich.progress import track  # noqa: PLC0415

    is_gif = path.suffix.lower() == '.gif'
    dpi = GIF_DPI if is_gif else MP4_DPI
    fps = GIF_FPS if is_gif else MP4_FPS
    view = view_of(log, Figure(figsize=SIZE, dpi=dpi), title)
    times: Iterable[float] = frame_times(view.duration, fps)
    if sys.stderr.isatty():  # elsewhere rich before 15 prints an empty line
        times = track(times, 'Saving', console=Console(stderr=True), transient=True)
    images = frames(view, times)
    if is_gif:
        write_gif(path, images, fps=fps)
    else:
        width, height = view.figure.canvas.get_width_height()
        write_mp4(path, images, size=(width, height), fps=fps)


def frame_times(duration: float, fps: float) -> NDArray[np.float64]:
    """Return the times [s] of the frames of a video of `duration` [s], with both ends."""
    count = int(np.ceil(duration * fps - 1e-6)) + 1
    return np.minimum(np.arange(count) / fps, duration)


def frames(view: RunView, times: Iterable[float]) -> Iterator[NDArray[np.uint8]]:
    """Yield an RGBA image of shape `(height, width, 4)` for each of `times`.

    The fixed parts are drawn once. The next image overwrites the array.
    """
    canvas: Any = FigureCanvasAgg(view.figure)  # matplotlib has no types for it
    with style.context(STYLE):
        canvas.draw()
    still = canvas.copy_from_bbox(view.figure.bbox)
    image = np.asarray(canvas.buffer_rgba())
    for t in times:
        view.update(t)
        canvas.restore_region(still)
        for artist in view.artists:
            view.figure.draw_artist(artist)
        yield image


def write_mp4(path: pathlib.Path, images: Images, *, size: tuple[int, int], fps: int) -> None:
    """Write RGBA images of shape `(height, width, 4)` as H.264 in 4:2:0, which all players support.

    `size` is `(width, height)`, both even.
    """
    program = ffmpeg()
    if program is None:
        raise UserError(
            'a .mp4 needs ffmpeg, and none is on the PATH: install it, or run '
            'python -m pip install imageio-ffmpeg, or save as .gif'
        )
    width, height = size
    pixels = ['-f', 'rawvideo', '-pix_fmt', 'rgba', '-s', f'{width}x{height}', '-r', str(fps)]
    encoding = list(chain.from_iterable(ENCODING.items()))
    command = [program, '-loglevel', 'error', '-y', *pixels, '-i', '-', *encoding]
    command += ['-f', 'mp4', str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:  # noqa: S603
        with suppress(BrokenPipeError):  # ffmpeg has ended early; stderr has the reason
            for image in images:
                cast('IO[bytes]', encoder.stdin).write(image.tobytes())
        _, errors = encoder.communicate()
    if encoder.returncode:
        lines = errors.decode(errors='replace').splitlines()
        reason = lines[-1] if lines else ''
        raise OSError(f'{program}: {reason}')


def ffmpeg() -> str | None:
    """Return the path of ffmpeg, from the PATH or imageio-ffmpeg; None if there is none."""
    program = which('ffmpeg')
    if program is None:
        with suppress(ImportError, RuntimeError):
            from imageio_ffmpeg import get_ffmpeg_exe  # noqa: PLC0415 (an extra, and slow)

            program = get_ffmpeg_exe()
    return program


def write_gif(path: pathlib.Path, images: Images, *, fps: int) -> None:
    """Write RGBA images of shape `(height, width, 4)`, at least one, as a GIF that repeats.

    A GIF's unit of time is 10 ms, so `fps` should divide 100.
    """
    stills = _one_palette(images)
    first = next(stills)
    first.save(
        path, save_all=True, append_images=stills, duration=1000 // fps, loop=0, optimize=False
    )


def _one_palette(images: Images) -> Iterator[Image.Image]:
    """Yield the images with the palette of the first one: no flicker, and a small file."""
    from PIL import Image  # noqa: PLC0415

    palette = None
    for image in images:
        colours = Image.fromarray(image).convert('RGB')
        palette = palette or colours.quantize(256, dither=Image.Dither.NONE)
        yield colours.quantize(palette=palette, dither=Image.Dither.NONE)
