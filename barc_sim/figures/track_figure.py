"""Draws a run on a track: the path from above, and errors, speed and steering over a lap."""

from __future__ import annotations

from functools import partial
from itertools import cycle
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
    RUN_COLOURS,
    STYLE,
    limits,
    speed_limits,
    use_measurement,
)
from barc_sim.simulation.metrics import LAP_HEADINGS, track_laps_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.transforms import Transform
    from numpy.typing import NDArray

    from barc_sim.control.planning import Limits
    from barc_sim.simulation.log import TrackLog
    from barc_sim.simulation.metrics import TrackLaps
    from barc_sim.vehicle.track import Track

    Floats = NDArray[np.float64]

TRACK_SIZE = (12.0, 7.6)  #: [inch]
TRACK_GROUND = '#F1F1EE'
_BENT = 0.9  #: If arcs fill at least this share of a lap, as on a racing line, none is shaded.
_OTHER = '#A9B4BD'  #: colour of the laps beside the best one
_SHOWN_LINE: dict[str, Any] = {'color': BLUE, 'lw': 1.8}
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


def _laps_of(log: TrackLog) -> tuple[list[_Curve], TrackLaps]:
    """Return the curves of a run, its best lap last, and the times and errors of its laps."""
    laps, numbers = track_laps_of(log)
    _, first = np.unique(numbers, return_index=True)
    start = np.fmin.reduceat(log.s, first)[numbers]  # of each lap, if the track is unknown
    if log.track:
        start = log.lap * (log.track.length if log.track.is_closed else 0.0)
    place: Floats = log.s - start
    shown = laps.best or laps.current
    is_shown = np.equal(numbers, shown.number)
    name = f'{"best lap" if laps.best else "lap"}: {shown.number + 1}'
    best = _Curve(name, _SHOWN_LINE, log.map(partial(np.compress, is_shown)), place[is_shown])
    if np.count_nonzero(~is_shown) <= 1:  # a run ends with one state behind the line
        return [best], laps
    place[first[1:]] = np.nan
    return [_Curve('other laps', {'color': _OTHER, 'lw': 1.0}, log, place), best], laps


@style.context(STYLE)
def track_figure(
    *logs: TrackLog,
    labels: Sequence[str] = (),
    title: str = '',
    settings: str = '',
    figure: Figure | None = None,
) -> Figure:
    """Draw the path of a run from above, and errors, speed and steering over the lap.

    The best lap is in front; a table lists all laps. For several runs, with their `labels`, only
    the best laps are drawn. `title` and `settings` are the two lines of the heading. `figure` must
    be empty.
    """
    runs = [*map(use_measurement, logs)]
    results = [_laps_of(each) for each in runs]
    bests = [laps.best or laps.current for _, laps in results]
    is_single = len(runs) == 1
    if is_single:
        [(curves, laps)] = results
        table = [LAP_HEADINGS, *(lap.cells for lap in laps.rows)]
    else:
        curves = [
            own[-1]._replace(name=name, line={'color': color, 'lw': 1.6})
            for (own, _), name, color in zip(results, labels, cycle(RUN_COLOURS), strict=False)
        ]
        table = [('best lap of', *LAP_HEADINGS[1:])]
        for name, lap in zip(labels, bests, strict=True):
            shown = name if lap.is_finished else f'{name}, not finished'
            table.append((shown, *lap.cells[1:]))
    figure = figure or Figure()
    figure.set_size_inches(TRACK_SIZE)
    figure.set_layout_engine('constrained', w_pad=0.08, h_pad=0.06)
    grid = figure.add_gridspec(4, 2, width_ratios=[1.0, 1.25])
    seen, below = figure.add_subplot(grid[:3, 0]), figure.add_subplot(grid[3, 0])
    charts = [figure.add_subplot(grid[0, 1])]
    charts += [figure.add_subplot(grid[row, 1], sharex=charts[0]) for row in (1, 2, 3)]
    track = next((log.track for log in runs if log.track), None)
    _draw_map(seen, track, curves)
    _draw_table(below, table, bests[0].cells if is_single else ())
    _draw_charts(charts, curves, track)
    ends = [end for each in runs for end in speed_limits(each)]
    charts[2].set_ylim(min(ends), max(ends))
    handles = [Line2D([], [], label=curve.name, **curve.line) for curve in curves]
    charts[0].legend(
        handles=handles, loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.0
    )
    seen.set_title(title, loc='left', pad=24.0, fontsize=14, fontweight='bold')
    seen.annotate(settings, (0.0, 1.0), (0.0, 8.0), 'axes fraction', 'offset points', color=MUTED)
    figure.align_ylabels(charts)
    return figure


def _draw_map(axes: Axes, track: Track | None, curves: list[_Curve]) -> None:
    """Draw the track, with distances in metres beside it, and the path of each lap."""
    if track:
        draw_course(axes, track)
        first, second, *_ = MaxNLocator(12, steps=[1, 2, 2.5, 5, 10]).tick_values(0, track.length)
        marks = np.arange(first, track.length - 0.4 * (second - first), second - first)
        size = float(np.hypot(*axes.dataLim.size))
        beside = track.place(marks, -(0.5 * track.width + 1.0 + 0.04 * size))
        places = np.column_stack(beside[:2])
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
    for each, name, color in ((track, 'centre line', _OTHER), (line, 'racing line', BLUE)):
        places, profile = each.samples(), speed_profile(each, *limits)
        speeds, pose = [profile(0.0, s) for s in places.tolist()], each.place(places)
        # The horizontal axis is the position on the centre line beside each point.
        beside = np.asarray(track.frenet(*pose).s) % track.length
        order = np.argsort(beside)
        label = f'{name}, {lap_time(each, limits):.2f} s'
        above.plot(beside[order], np.take(speeds, order), color=color, lw=1.6, label=label)
        below.plot(beside[order], each.curvature(places[order]), color=color, lw=1.6)
    points = np.column_stack(pose[:2])
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


def _draw_table(axes: Axes, rows: Sequence[Sequence[str]], best: Sequence[str]) -> None:
    """Draw a table of the laps, whose first row has the headings; `best` is bold."""
    axes.set_axis_off()
    table = axes.table(
        [*rows],
        colWidths=(0.25, 0.15, 0.16, 0.17, 0.27),
        cellLoc='right',
        edges='open',
        loc='upper center',
    )
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    for (k, _), cell in table.get_celld().items():
        is_best = rows[k] == best
        cell.get_text().set_color(BLUE if is_best else INK if k else MUTED)
        cell.get_text().set_fontweight('bold' if is_best else 'normal')
