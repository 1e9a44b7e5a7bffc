"""Draws a run on a track: the path from above, and errors, speed and steering over a lap."""

from __future__ import annotations

from functools import partial
from itertools import cycle
from textwrap import shorten
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import style
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from barc_sim.control.lane import STEERING_LIMIT, speed_profile
from barc_sim.control.planning import lap_time
from barc_sim.figures.style import (
    BLUE,
    DASHES,
    EARTH,
    GREY,
    INK,
    MUTED,
    RUN_LINES,
    STYLE,
    VERMILLION,
    limits,
    speed_limits,
    use_measurement,
)
from barc_sim.simulation.metrics import LAP_HEADINGS, lap_settings_of, track_laps_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.transforms import Transform
    from numpy.typing import NDArray

    from barc_sim.control.planning import Limits
    from barc_sim.simulation.log import TrackLog
    from barc_sim.simulation.metrics import LapSettings, TrackLap, TrackLaps
    from barc_sim.vehicle.track import Track

    Floats = NDArray[np.float64]

TRACK_SIZE = (12.0, 7.6)  #: [inch]
TRACK_GROUND = '#F1F1EE'
_BENT = 0.9  #: If arcs fill at least this share of a lap, as on a racing line, none is shaded.
OTHER = '#A9B4BD'  #: colour of the laps beside the best and the last one
_BEST: dict[str, Any] = {'color': BLUE, 'lw': 1.8}
_LAST: dict[str, Any] = {'color': VERMILLION, 'lw': 1.4}
_OTHERS: dict[str, Any] = {'color': OTHER, 'lw': 1.0}
_WIDTHS = (0.25, 0.15, 0.16, 0.17, 0.27)  #: of the table's columns, as shares
_WIDTHS_WITH_GAINS = (0.13, 0.13, 0.14, 0.14, 0.23, 0.23)
_MAX_GAINS = 22  #: characters
_MAX_NAME = 20  #: characters of a run's name in the table
_LEGEND_CHARACTERS = 60  #: of the names in a row of the legend
_ARC: dict[str, Any] = {'step': 'post', 'color': EARTH, 'zorder': 0, 'lw': 0.0}


class _Curve(NamedTuple):
    """A drawn lap, or several laps as one broken line."""

    name: str
    line: dict[str, Any]
    log: TrackLog  #: of these laps
    s: Floats  #: [m] position from the finish line


#: Charts over the lap: label, values of a log, minimum half height of the axis, drawn limits (±).
_CHARTS: tuple[tuple[str, Callable[[TrackLog], Floats], float, float], ...] = (
    ('e_y [m]', lambda log: log.e_y, 0.05, 0.0),
    ('e_psi [°]', lambda log: np.degrees(log.e_psi), 1.0, 0.0),
    ('Speed [m/s]', lambda log: log.speed, 1.0, 0.0),
    ('Steering [°]', lambda log: np.degrees(log.servo), 1.0, float(np.degrees(STEERING_LIMIT))),
)


class _TrackRun(NamedTuple):
    """A run on a track, as it is drawn."""

    curves: list[_Curve]  #: the best lap is the last one
    laps: TrackLaps
    settings: LapSettings

    @property
    def shown(self) -> TrackLap:
        """The lap in front: the best one, or the only one."""
        return self.laps.best or self.laps.current


def _laps_of(log: TrackLog) -> _TrackRun:
    """Return a run's laps: the others in grey, the last finished one and the best in colour."""
    laps, numbers = track_laps_of(log)
    settings = lap_settings_of(log, numbers)
    _, first = np.unique(numbers, return_index=True)
    start = np.fmin.reduceat(log.s, first)[numbers]  # of each lap, if the track is unknown
    if log.track:
        start = log.lap * (log.track.length if log.track.is_closed else 0.0)
    place: Floats = log.s - start

    def curve(name: str, line: dict[str, Any], number: int) -> _Curve:
        rows = np.equal(numbers, number)
        return _Curve(name, line, log.map(partial(np.compress, rows)), place[rows])

    shown = laps.best or laps.current
    best = curve(f'{"best lap" if laps.best else "lap"}: {shown.number + 1}', _BEST, shown.number)
    if np.count_nonzero(np.not_equal(numbers, shown.number)) <= 1:
        return _TrackRun([best], laps, settings)  # a run ends with one state behind the line
    curves = [best]
    if laps.finished and laps.finished[-1].number != shown.number:
        last = laps.finished[-1].number
        curves.insert(0, curve(f'last lap: {last + 1}', _LAST, last))
    others = place.copy()
    others[first[1:]] = np.nan
    return _TrackRun([_Curve('other laps', _OTHERS, log, others), *curves], laps, settings)


@style.context(STYLE)
def track_figure(
    *logs: TrackLog,
    labels: Sequence[str] = (),
    title: str = '',
    settings: str = '',
    figure: Figure | None = None,
) -> Figure:
    """Draw the path of a run from above, and errors, speed and steering over the lap.

    The best lap is in front; a table lists the laps, with the gains that each had. For several
    runs, with their `labels`, only the best laps are drawn. `title` and `settings` are the two
    lines of the heading. `figure` must be empty.
    """
    runs = [*map(use_measurement, logs)]
    results = [_laps_of(each) for each in runs]
    figure = figure or Figure()
    figure.set_size_inches(TRACK_SIZE)
    figure.set_layout_engine('constrained', w_pad=0.08, h_pad=0.06)
    grid = figure.add_gridspec(4, 2, width_ratios=[1.0, 1.25])
    seen, below = figure.add_subplot(grid[:3, 0]), figure.add_subplot(grid[3, 0])
    charts = [figure.add_subplot(grid[0, 1])]
    charts += [figure.add_subplot(grid[row, 1], sharex=charts[0]) for row in (1, 2, 3)]
    track = next((log.track for log in runs if log.track), None)
    if len(runs) == 1:
        curves = results[0].curves
        _draw_laps(below, results[0])
    else:
        curves = [
            each.curves[-1]._replace(name=name, line={'color': color, 'lw': 1.6, 'ls': dashes})
            for each, name, (color, dashes) in zip(results, labels, cycle(RUN_LINES), strict=False)
        ]
        _draw_bests(below, results, curves)
    _draw_map(seen, track, curves)
    _draw_charts(charts, curves, track)
    ends = [end for each in runs for end in speed_limits(each)]
    charts[2].set_ylim(min(ends), max(ends))
    handles = [Line2D([], [], label=curve.name, **curve.line) for curve in curves]
    longest = max(len(curve.name) for curve in curves)
    charts[0].legend(
        handles=handles,
        loc='lower right',
        bbox_to_anchor=(1.0, 1.0),
        ncols=max(min(3, _LEGEND_CHARACTERS // longest), 1),
        borderaxespad=0.0,
    )
    seen.set_title(title, loc='left', pad=24.0, fontsize=14, fontweight='bold')
    seen.annotate(settings, (0.0, 1.0), (0.0, 8.0), 'axes fraction', 'offset points', color=MUTED)
    figure.align_ylabels(charts)
    return figure


def _draw_laps(axes: Axes, result: _TrackRun) -> None:
    """Draw the table of a run's laps."""
    laps = result.laps.rows
    rows = [lap.cells for lap in laps]
    headings: tuple[str, ...] = LAP_HEADINGS
    widths: tuple[float, ...] = _WIDTHS
    gains = [result.settings.text(lap.number) for lap in laps]
    if any(gains):
        texts = [shorten(text, _MAX_GAINS, placeholder=' …') for text in gains]
        headings, widths = (*headings, 'gains'), _WIDTHS_WITH_GAINS
        rows = [(*cells, text) for cells, text in zip(rows, texts, strict=True)]
    numbers = [lap.number for lap in laps]
    colors = {}
    if len(result.curves) > 2:  # noqa: PLR2004 (others, last, best)
        colors[1 + numbers.index(result.laps.finished[-1].number)] = VERMILLION
    if result.shown.number in numbers:
        colors[1 + numbers.index(result.shown.number)] = BLUE
    draw_table(axes, [headings, *rows], widths, colors)


def _draw_bests(axes: Axes, results: Sequence[_TrackRun], curves: Sequence[_Curve]) -> None:
    """Draw the table of the best laps of several runs, each in the colour of its curve."""
    rows = []
    for curve, result in zip(curves, results, strict=True):
        name = shorten(curve.name, _MAX_NAME, placeholder=' …')
        if not result.shown.is_finished:
            name = f'{name}, not finished'
        rows.append((name, *result.shown.cells[1:]))
    colors = {k: curve.line['color'] for k, curve in enumerate(curves, 1)}
    draw_table(axes, [('best lap of', *LAP_HEADINGS[1:]), *rows], _WIDTHS, colors)


def _draw_map(axes: Axes, track: Track | None, curves: list[_Curve]) -> None:
    """Draw the track, with distances in metres beside it, and the path of each lap."""
    if track:
        draw_course(axes, track)
        first, second, *_ = MaxNLocator(12, steps=[1, 2, 2.5, 5, 10]).tick_values(0, track.length)
        marks = np.arange(first, track.length - 0.4 * (second - first), second - first)
        size = float(np.hypot(*axes.dataLim.size))
        beside = track.place(marks, -(0.5 * track.width + 1.0 + 0.04 * size))
        places = np.column_stack([beside.x, beside.y])
        for (u, v), s in zip(places, marks, strict=True):
            axes.text(u, v, f'{s:g} m', color=MUTED, fontsize=8, ha='center', va='center')
        axes.update_datalim(places)  # so that the axes contain the text, too
    for curve in curves:
        x, y, _ = curve.log.true_pose
        axes.plot(x, y, **curve.line)
    axes.set_aspect('equal', adjustable='datalim')
    axes.margins(0.06)
    axes.set(xlabel='x [m]', ylabel='y [m]')


def draw_course(axes: Axes, track: Track, transform: Transform | None = None) -> list[Artist]:
    """Draw a track from above; return its ground, edges, centre line and finish line."""
    lines: Any = track.lines()
    on: dict[str, Any] = {'transform': transform or axes.transData}
    (u, v, _), (x, y, _), centre = lines
    ground = np.append(u, x[::-1]), np.append(v, y[::-1])
    return [
        *axes.fill(*ground, color=TRACK_GROUND, lw=0.0, **on),
        *axes.plot(u, v, x, y, color=INK, lw=1.2, **on),
        *axes.plot(*centre[:2], color=GREY, lw=0.8, ls=DASHES, **on),
        *axes.plot([u[0], x[0]], [v[0], y[0]], color=INK, lw=3.0, **on),
    ]


def _draw_charts(charts: list[Axes], curves: list[_Curve], track: Track | None) -> None:
    """Draw the curves of each chart, the steering limit, the reference speed and the arcs."""
    log, s = curves[-1].log, curves[-1].s
    bent = log.curvature != 0.0
    has_straights = float(bent.mean()) < _BENT
    for axes, (name, values, minimum, limit) in zip(charts, _CHARTS, strict=True):
        for level in {limit, -limit}:
            axes.axhline(level, color=INK if limit else GREY, lw=0.8, ls=DASHES if limit else '-')
        for curve in curves:
            axes.plot(curve.s, values(curve.log), **curve.line)
        shown = np.concatenate([[limit, -limit], *(values(curve.log) for curve in curves)])
        axes.set(ylabel=name, ylim=limits(shown, share=0.1, minimum=minimum))
        axes.tick_params(labelbottom=axes is charts[-1])
        if has_straights:
            sides = axes.get_xaxis_transform()
            axes.fill_between(s, 0.0, 1.0, where=bent.tolist(), transform=sides, **_ARC)
    *_, speed, steering = charts
    if np.isfinite(log.reference).any():
        speed.plot(s, log.reference, color=INK, lw=1.0, ls=DASHES, label='reference')
        speed.legend(loc='lower right', bbox_to_anchor=(1.0, 0.98), borderaxespad=0.0)
    steering.annotate(
        'limit', (1.0, limit), (-2.0, -3.0), ('axes fraction', 'data'), 'offset points',
        ha='right', va='top', color=MUTED, fontsize=8,
    )  # fmt: skip
    steering.set_xlabel('Position in the lap [m]' + ('; arcs are shaded' if has_straights else ''))
    steering.set_xlim(0.0, track.length if track else None)


@style.context(STYLE)
def line_figure(track: Track, line: Track, limits: Limits, title: str = '') -> Figure:
    """Draw a racing line, coloured by speed, and its speed and curvature beside the centre line's.

    The speeds are the fastest within `limits`, from `speed_profile`.
    """
    figure = Figure(figsize=TRACK_SIZE, layout='constrained')
    figure.suptitle(title, x=0.02, ha='left', fontsize=14, fontweight='bold')
    grid = figure.add_gridspec(2, 2, width_ratios=[1.25, 1.0])
    seen, above, below = (figure.add_subplot(cell) for cell in (grid[:, 0], grid[0, 1], grid[1, 1]))
    draw_course(seen, track)
    seen.set_aspect('equal', adjustable='datalim')
    for each, name, color in ((track, 'centre line', OTHER), (line, 'racing line', BLUE)):
        places, profile = each.samples(), speed_profile(each, *limits)
        speeds, pose = [profile(0.0, s) for s in places.tolist()], each.place(places)
        # The horizontal axis is the position on the centre line beside each point.
        beside = np.asarray(track.frenet(pose.x, pose.y, pose.psi).s) % track.length
        order = np.argsort(beside)
        label = f'{name}, {lap_time(each, limits):.2f} s'
        above.plot(beside[order], np.take(speeds, order), color=color, lw=1.6, label=label)
        below.plot(beside[order], each.curvature(places[order]), color=color, lw=1.6)
    points = np.column_stack([pose.x, pose.y])
    coloured = LineCollection([*np.stack([points[:-1], points[1:]], axis=1)], lw=3.5)
    coloured.set_array(speeds[:-1])
    seen.add_collection(coloured)
    figure.colorbar(coloured, ax=seen, label='Speed [m/s]', orientation='horizontal', shrink=0.7)
    seen.set(xlabel='x [m]', ylabel='y [m]')
    above.set(ylabel='Speed [m/s]', xlim=(0.0, track.length))
    above.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)
    below.set(ylabel='Curvature [1/m]', xlabel='Position along the centre line [m]')
    below.set_xlim(0.0, track.length)
    return figure


def draw_table(
    axes: Axes,
    rows: Sequence[Sequence[str]],
    widths: Sequence[float],
    colors: Mapping[int, str],
) -> None:
    """Draw a table, whose first row has the headings; rows with a color are bold."""
    axes.set_axis_off()
    table = axes.table(
        [*rows], colWidths=[*widths], cellLoc='right', edges='open', loc='upper center'
    )
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    for (k, _), cell in table.get_celld().items():
        cell.get_text().set_color(colors.get(k, INK if k else MUTED))
        cell.get_text().set_fontweight('bold' if k in colors else 'normal')
