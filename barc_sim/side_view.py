"""The replay of a run on hills: the car from the side on its road, its speed below."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import style
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D

from barc_sim.plots import BLUE, EARTH, GREY, INK, LOOK, MUTED, limits
from barc_sim.side_car import AXLES, WHEEL_RADIUS, SideCar
from barc_sim.terrain import Terrain

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    from barc_sim.log import Log

SIZE = (12.8, 7.2)  #: [inch]
VIEW_WIDTH = 30.0  #: [m] of the map that are seen at once
POST_SPACING = 10.0  #: [m] along the road
POSTS = 12  #: more than are ever in view
LABEL_WIDTH = 2.0  #: [m] of the map, at most
DEPTH = 100.0  #: [m] of earth below the road: more than is ever seen
SKY_COLOUR = '#F4F8FB'
SURFACE_COLOUR = '#7D776A'


class SideView:
    """The car from the side at any time of a run.

    Attributes
    ----------
    figure
        What it is drawn on.
    duration
        [s] from the run's first state to its last.
    artists
        What `update` moves, in the order of drawing. Each stays within its axes.
    """

    def __init__(self, log: Log, figure: Figure, *, title: str = '') -> None:
        """Draw all that stands still on `figure`, which is empty, and show the first state."""
        self.figure = figure
        self.duration = float(log.t[-1])
        self.artists: list[Artist] = []
        self._log, self._distance, self._speed = log, log.distance, log.speed
        self._terrain = Terrain(log)
        self._wheel_path = self._terrain.wheel_path(WHEEL_RADIUS)
        with style.context(LOOK):
            self._draw_road(figure.add_axes((0.0, 0.4, 1.0, 0.5)))
            self._draw_course(
                figure.add_axes((0.06, 0.295, 0.925, 0.08)),
                figure.add_axes((0.06, 0.09, 0.925, 0.19)),
            )
            self._draw_readings(figure.add_axes((0.06, 0.9, 0.925, 0.1)), title)
        for artist in self.artists:
            artist.set_animated(True)
        self.update(0.0)

    def update(self, t: float) -> None:
        """Show the run at `t` [s]: positions between states, commands that hold until the next."""
        log = self._log
        k = int(np.searchsorted(log.t, t + 1e-9, side='right')) - 1
        distance = float(np.interp(t, log.t, self._distance))
        speed = float(np.interp(t, log.t, self._speed))
        self._place_car(distance)
        for dot, cursor, value in zip(
            self._dots, self._cursors, (self._terrain.at(distance)[1], speed), strict=True
        ):
            dot.set_data([distance], [value])
            cursor.set_xdata([distance, distance])
        self._trace.set_data(
            np.append(self._distance[: k + 1], distance), np.append(self._speed[: k + 1], speed)
        )
        self._readings['Time'].set_text(f'{t:.2f} s')
        self._readings['Speed'].set_text(_reading(speed, 2, ' m/s'))
        self._readings['Reference'].set_text(_reading(log.reference[k], 2, ' m/s'))
        self._readings['Grade'].set_text(_reading(log.theta_deg[k], 0, '°'))
        self._readings['Command'].set_text(_reading(log.motor[k], 2, ' m/s²'))

    def _place_car(self, distance: float) -> None:
        """Put the car where the camera looks, and the road under it."""
        horizontal, _ = self._terrain.at(np.add(distance, AXLES))
        wheels = np.column_stack([horizontal, np.interp(horizontal, *self._wheel_path)])
        camera = wheels.mean(axis=0)
        self._car.place(*(wheels - camera), rolled=distance)
        self._ground.clear().translate(*-camera)
        edge = self._road.get_xlim()[1]
        first = np.ceil(distance / POST_SPACING - POSTS / 2) * POST_SPACING
        for i, label in enumerate(self._posts):
            post = first + i * POST_SPACING
            x, y = self._terrain.at(post)
            # A text costs more than all else in a frame.
            label.set_visible(abs(x - camera[0]) < edge + LABEL_WIDTH)
            label.set_position((x, y - 0.7))
            label.set_text(_reading(post, 0, ' m'))

    def _draw_road(self, axes: Axes) -> None:
        # One scale for both, so that 30° are 30°: in a window of another shape more is seen.
        axes.set_xlim(-VIEW_WIDTH / 2.0, VIEW_WIDTH / 2.0, auto=True)
        axes.set_ylim(-3.5, 5.0, auto=True)
        axes.set_aspect('equal', adjustable='datalim')
        axes.set(facecolor=SKY_COLOUR, xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
        self._road = axes
        self._ground = Affine2D()
        ground = self._ground + axes.transData
        x, y = self._terrain.horizontal, self._terrain.elevation
        outline = [*zip(x, y, strict=True), (x[-1], y.min() - DEPTH), (x[0], y.min() - DEPTH)]
        posts = np.arange(
            np.ceil(self._terrain.distance[0] / POST_SPACING) * POST_SPACING,
            self._terrain.distance[-1],
            POST_SPACING,
        )
        post_x, post_y = (np.repeat(place, 3) for place in self._terrain.at(posts))
        post_y[1::3] -= 0.5
        post_y[2::3] = np.nan
        self._posts: list[Text] = [
            axes.text(0, 0, '', transform=ground, ha='center', va='top', color=MUTED, clip_on=True)
            for _ in range(POSTS)
        ]
        lines = [
            Line2D(post_x, post_y, color=SURFACE_COLOUR, lw=1.2, transform=ground),
            Line2D(x, y, color=SURFACE_COLOUR, lw=2.5, transform=ground),
        ]
        self.artists.append(axes.add_patch(Polygon(outline, facecolor=EARTH, transform=ground)))
        self.artists += [axes.add_line(line) for line in lines]
        self.artists += self._posts
        self._car = SideCar(axes)
        self.artists += self._car.artists

    def _draw_course(self, road: Axes, speed: Axes) -> None:
        """Draw all of the road, and the speed on it, one above the other."""
        x, y = self._terrain.distance, self._terrain.elevation
        road.fill_between(x, y, y.min() - DEPTH, color=EARTH)
        road.plot(x, y, color=SURFACE_COLOUR, lw=1.2)
        driven = y[1:-1]
        low, high = float(driven.min()), float(driven.max())
        road.set_ylim(low - 2.0, high + max(2.0, 0.3 * (high - low)))
        road.set_axis_off()
        speed.plot(self._distance, self._speed, color='#C4D3DD', lw=1.5)
        (self._trace,) = speed.plot([], [], color=BLUE, lw=2.2, label='speed')
        self.artists.append(self._trace)
        if not np.all(np.isnan(self._log.reference)):
            dashes = {'color': INK, 'lw': 1.0, 'ls': (0, (5, 3)), 'label': 'reference'}
            self.artists += speed.plot(self._distance, self._log.reference, **dashes)
        speed.legend(loc='upper right', bbox_to_anchor=(1.0, -0.16), ncols=2, borderaxespad=0.0)
        speed.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
        speed.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        values = np.concatenate([self._speed, self._log.reference])
        speed.set(
            xlabel='Position along the road [m]',
            ylabel='Speed [m/s]',
            ylim=limits(values, share=0.15, least=1.0),
        )
        self._dots, self._cursors = [], []
        for axes in (road, speed):
            axes.set_xlim(*limits(self._distance, share=0.01, least=5.0))
            cursor = axes.axvline(0.0, color=GREY, lw=0.8)
            (dot,) = axes.plot([], [], 'o', color=BLUE, mec='white', mew=1.2, ms=8, clip_on=False)
            self._cursors.append(cursor)
            self._dots.append(dot)
            self.artists += [cursor, dot]

    def _draw_readings(self, axes: Axes, title: str) -> None:
        axes.set_axis_off()
        axes.text(0.0, 0.5, title, fontsize=13, fontweight='bold', va='center')
        names = ['Time', 'Speed', 'Reference', 'Grade', 'Command']
        self._readings: dict[str, Text] = {}
        for name, x in zip(names, (0.5, 0.63, 0.76, 0.85, 1.0), strict=True):
            axes.text(x, 0.68, name, color=MUTED, fontsize=9, ha='right', va='bottom')
            self._readings[name] = axes.text(x, 0.56, '', fontsize=15, ha='right', va='top')
        self.artists += self._readings.values()


def _reading(value: float, digits: int, unit: str) -> str:
    """Return a value with its unit, a dash where there is none."""
    if np.isnan(value):
        return '\N{EN DASH}'
    # Adding zero turns a negative zero into zero.
    return f'{round(value, digits) + 0.0:.{digits}f}{unit}'.replace('-', '\N{MINUS SIGN}')
