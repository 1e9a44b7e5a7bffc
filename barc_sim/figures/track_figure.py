"""Draws a run on a track: the path from above, and errors, speed and steering over a lap."""

from __future__ import annotations

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
from barc_sim.figures.colours import (
    BLUE,
    DASHES,
    EARTH,
    GREY,
    INK,
    MUTED,
    RUN_LINES,
    STYLE,
    VERMILLION,
)
from barc_sim.figures.drawn_log import limits, speed_limits, with_zero_for_unknown_errors
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
#: Of the table; the share of states in which the steering is at its limit is the last one.
_HEADINGS = (*LAP_HEADINGS[:-1], 'at limit')
_PADDING = 0.2  #: on either side of a cell's text, as a share of the column's width
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


class _Chart(NamedTuple):
    """What a chart over the lap has."""

    label: str
    values: Callable[[TrackLog], Floats]  #: of a log
    min_height: float  #: of the axis, up and down from zero
    limit: float = 0.0  #: drawn up and down from zero


_CHARTS = (
    _Chart('e_y [m]', lambda log: log.e_y, min_height=0.05),
    _Chart('e_psi [°]', lambda log: np.degrees(log.e_psi), min_height=1.0),
    _Chart('Speed [m/s]', lambda log: log.speed, min_height=1.0),
    _Chart(
        'Steering [°]',
        lambda log: np.degrees(log.servo),
        min_height=1.0,
        limit=float(np.degrees(STEERING_LIMIT)),
    ),
)


class _TrackRun(NamedTuple):
    """A run on a track, as it is drawn."""

    curves: list[_Curve]  #: the best lap is the last one
    laps: TrackLaps
    settings: LapSettings

    @property
    def front(self) -> TrackLap:
        """The lap in front: the best one, or the only one."""
        return self.laps.best or self.laps.current


def _laps_of(log: TrackLog) -> _TrackRun:
    """Return a run's laps: the others in grey, the last finished one and the best in colour."""
    laps, numbers = track_laps_of(log)
    settings = lap_settings_of(log, numbers)
    _, first_of_lap = np.unique(numbers, return_index=True)
    positions = _positions_in_lap(log, np.asarray(numbers), first_of_lap)

    def curve(name: str, line: dict[str, Any], number: int) -> _Curve:
        rows = np.equal(numbers, number)
        return _Curve(name, line, log.map(lambda column: column[rows]), positions[rows])

    front = laps.best or laps.current
    name = 'best lap' if laps.best else 'lap'
    curves = [curve(f'{name}: {front.number + 1}', _BEST, front.number)]
    count_of_others = np.count_nonzero(np.not_equal(numbers, front.number))
    if count_of_others <= 1:  # a run ends with one state behind the line
        return _TrackRun(curves, laps, settings)

    if laps.finished and laps.finished[-1].number != front.number:
        last = laps.finished[-1].number
        curves.insert(0, curve(f'last lap: {last + 1}', _LAST, last))
    broken = positions.copy()
    broken[first_of_lap[1:]] = np.nan
    curves.insert(0, _Curve('other laps', _OTHERS, log, broken))
    return _TrackRun(curves, laps, settings)


def _positions_in_lap(
    log: TrackLog, numbers: NDArray[np.intp], first_of_lap: NDArray[np.intp]
) -> Floats:
    """Return the position of each state from the start of its lap [m]."""
    if log.track is None:
        start_of_lap = np.fmin.reduceat(log.s, first_of_lap)
        return log.s - start_of_lap[numbers]
    if log.track.is_closed:
        return log.s - log.lap * log.track.length
    return log.s


@style.context(STYLE)
def track_figure(
    *logs: TrackLog,
    labels: Sequence[str] = (),
    title: str = '',
    settings: str = '',
    figure: Figure | None = None,
) -> Figure:
    """Draw the path of a run from above, and errors, speed and steering over the lap.

    The best lap is in front; a table lists the laps, with the gains that each had. Of several runs
    only the best laps are drawn.

    Parameters
    ----------
    logs
        The runs.
    labels
        The name of each of several runs.
    title, settings
        The two lines of the heading.
    figure
        The empty figure to draw on, whose size is set; by default a new one.
    """
    runs = [with_zero_for_unknown_errors(log) for log in logs]
    results = [_laps_of(run) for run in runs]
    track = next((run.track for run in runs if run.track), None)

    figure = figure or Figure()
    figure.set_size_inches(TRACK_SIZE)
    figure.set_layout_engine('constrained', w_pad=0.08, h_pad=0.06)
    grid = figure.add_gridspec(4, 2, width_ratios=[1.0, 1.25])
    plan = figure.add_subplot(grid[:3, 0])
    table = figure.add_subplot(grid[3, 0])
    charts = [figure.add_subplot(grid[0, 1])]
    charts += [figure.add_subplot(grid[row, 1], sharex=charts[0]) for row in (1, 2, 3)]

    if len(runs) == 1:
        curves = results[0].curves
        _draw_laps(table, results[0])
    else:
        curves = _best_curves(results, labels)
        _draw_bests(table, results, curves)
    _draw_map(plan, track, curves)
    _draw_charts(charts, curves, track)
    ends = [end for run in runs for end in speed_limits(run)]
    charts[2].set_ylim(min(ends), max(ends))

    handles = [Line2D([], [], label=curve.name, **curve.line) for curve in curves]
    max_length = max(len(curve.name) for curve in curves)
    charts[0].legend(
        handles=handles,
        loc='lower right',
        bbox_to_anchor=(1.0, 1.0),
        ncols=max(min(3, _LEGEND_CHARACTERS // max_length), 1),
        borderaxespad=0.0,
    )
    plan.set_title(title, loc='left', pad=24.0, fontsize=14, fontweight='bold')
    plan.annotate(settings, (0.0, 1.0), (0.0, 8.0), 'axes fraction', 'offset points', color=MUTED)
    figure.align_ylabels(charts)
    return figure


def _best_curves(results: Sequence[_TrackRun], labels: Sequence[str]) -> list[_Curve]:
    """Return the curve in front of each run, with the run's label and a line of its own."""
    curves = []
    for result, label, (color, dashes) in zip(results, labels, cycle(RUN_LINES), strict=False):
        line = {'color': color, 'lw': 1.6, 'ls': dashes}
        curves.append(result.curves[-1]._replace(name=label, line=line))
    return curves


def _draw_laps(axes: Axes, result: _TrackRun) -> None:
    """Draw the table of a run's laps."""
    laps = result.laps.rows
    rows = [_cells(lap) for lap in laps]
    headings: tuple[str, ...] = _HEADINGS
    gains = [result.settings.text(lap.number) for lap in laps]
    if any(gains):
        headings = (*headings, 'gains')
        texts = [shorten(text, _MAX_GAINS, placeholder=' …') for text in gains]
        rows = [(*cells, text) for cells, text in zip(rows, texts, strict=True)]

    # The headings are row 0.
    row_of_lap = {lap.number: row for row, lap in enumerate(laps, start=1)}
    colors = {}
    has_last = len(result.curves) > 2  # noqa: PLR2004 (others, last, best)
    if has_last:
        last = result.laps.finished[-1]
        colors[row_of_lap[last.number]] = VERMILLION
    if result.front.number in row_of_lap:
        colors[row_of_lap[result.front.number]] = BLUE
    draw_table(axes, [headings, *rows], colors)


def _cells(lap: TrackLap) -> tuple[str, ...]:
    """Return the texts of a lap in the table, without its gains."""
    return (*lap.cells[:-1], f'{lap.at_limit:.0%}')


def _draw_bests(axes: Axes, results: Sequence[_TrackRun], curves: Sequence[_Curve]) -> None:
    """Draw the table of the best laps of several runs, each in the colour of its curve."""
    rows = []
    for curve, result in zip(curves, results, strict=True):
        name = shorten(curve.name, _MAX_NAME, placeholder=' …')
        if not result.front.is_finished:
            name = f'{name}, not finished'
        rows.append((name, *_cells(result.front)[1:]))
    colors = {row: curve.line['color'] for row, curve in enumerate(curves, start=1)}
    draw_table(axes, [('best lap of', *_HEADINGS[1:]), *rows], colors)


def _draw_map(axes: Axes, track: Track | None, curves: list[_Curve]) -> None:
    """Draw the track, with distances in metres beside it, and the path of each lap."""
    if track:
        draw_course(axes, track)
        _draw_distances(axes, track)
    for curve in curves:
        x, y, _ = curve.log.true_pose
        axes.plot(x, y, **curve.line)
    axes.set_aspect('equal', adjustable='datalim')
    axes.margins(0.06)
    axes.set(xlabel='x [m]', ylabel='y [m]')


def _draw_distances(axes: Axes, track: Track) -> None:
    """Draw distances from the start beside the track, none close to the start line."""
    ticks = MaxNLocator(12, steps=[1, 2, 2.5, 5, 10]).tick_values(0, track.length)
    step = ticks[1] - ticks[0]
    distances = np.arange(ticks[0], track.length - 0.4 * step, step)

    size = float(np.hypot(*axes.dataLim.size))
    to_the_left = -(0.5 * track.width + 1.0 + 0.04 * size)
    pose = track.place(distances, to_the_left)
    places = np.column_stack([pose.x, pose.y])
    centred: dict[str, Any] = {'ha': 'center', 'va': 'center'}
    for (text_x, text_y), distance in zip(places, distances, strict=True):
        axes.text(text_x, text_y, f'{distance:g} m', color=MUTED, fontsize=8, **centred)
    axes.update_datalim(places)  # so that the axes contain the text, too


def draw_course(axes: Axes, track: Track, transform: Transform | None = None) -> list[Artist]:
    """Draw a track from above.

    Parameters
    ----------
    axes
        Where to draw.
    track
        The track.
    transform
        From the track's metres to the screen; by default that of the axes.

    Returns
    -------
    list
        Its ground, left and right edge, centre line and finish line.
    """
    poses: Any = track.lines()  # of arrays
    left, right, centre = poses
    to_screen: dict[str, Any] = {'transform': transform or axes.transData}

    ground_x = np.append(left.x, right.x[::-1])
    ground_y = np.append(left.y, right.y[::-1])
    ground = axes.fill(ground_x, ground_y, color=TRACK_GROUND, lw=0.0, **to_screen)
    edges = axes.plot(left.x, left.y, right.x, right.y, color=INK, lw=1.2, **to_screen)
    centre_line = axes.plot(centre.x, centre.y, color=GREY, lw=0.8, ls=DASHES, **to_screen)
    finish_x = [left.x[0], right.x[0]]
    finish_y = [left.y[0], right.y[0]]
    finish = axes.plot(finish_x, finish_y, color=INK, lw=3.0, **to_screen)
    return [*ground, *edges, *centre_line, *finish]


def _draw_charts(charts: list[Axes], curves: list[_Curve], track: Track | None) -> None:
    """Draw the curves of each chart, the steering limit, the reference speed and the arcs."""
    front = curves[-1]
    is_bent = front.log.curvature != 0.0
    has_straights = float(is_bent.mean()) < _BENT
    for axes, chart in zip(charts, _CHARTS, strict=True):
        if chart.limit:
            axes.axhline(chart.limit, color=INK, lw=0.8, ls=DASHES)
            axes.axhline(-chart.limit, color=INK, lw=0.8, ls=DASHES)
        else:
            axes.axhline(0.0, color=GREY, lw=0.8)

        values = [chart.values(curve.log) for curve in curves]
        for curve, of_curve in zip(curves, values, strict=True):
            axes.plot(curve.s, of_curve, **curve.line)
        visible = np.concatenate([[chart.limit, -chart.limit], *values])
        axes.set(ylabel=chart.label, ylim=limits(visible, share=0.1, minimum=chart.min_height))
        axes.tick_params(labelbottom=axes is charts[-1])
        if has_straights:
            sides = axes.get_xaxis_transform()
            axes.fill_between(front.s, 0.0, 1.0, where=is_bent.tolist(), transform=sides, **_ARC)

    _, _, speed, steering = charts
    if np.isfinite(front.log.reference).any():
        speed.plot(front.s, front.log.reference, color=INK, lw=1.0, ls=DASHES, label='reference')
        speed.legend(loc='lower right', bbox_to_anchor=(1.0, 0.98), borderaxespad=0.0)
    steering.annotate(
        'limit',
        xy=(1.0, _CHARTS[-1].limit),
        xytext=(-2.0, -3.0),
        xycoords=('axes fraction', 'data'),
        textcoords='offset points',
        ha='right',
        va='top',
        color=MUTED,
        fontsize=8,
    )
    steering.set_xlabel('Position in the lap [m]' + ('; arcs are shaded' if has_straights else ''))
    steering.set_xlim(0.0, track.length if track else None)


@style.context(STYLE)
def line_figure(track: Track, line: Track, limits: Limits, title: str = '') -> Figure:
    """Draw a racing line, coloured by speed, and its speed and curvature beside the centre line's.

    Parameters
    ----------
    track
        The track.
    line
        The racing line on it.
    limits
        Those of `speed_profile`, with which the speeds are the fastest.
    title
        The heading.
    """
    figure = Figure(figsize=TRACK_SIZE, layout='constrained')
    figure.suptitle(title, x=0.02, ha='left', fontsize=14, fontweight='bold')
    grid = figure.add_gridspec(2, 2, width_ratios=[1.25, 1.0])
    plan = figure.add_subplot(grid[:, 0])
    speed = figure.add_subplot(grid[0, 1])
    curvature = figure.add_subplot(grid[1, 1])
    draw_course(plan, track)
    plan.set_aspect('equal', adjustable='datalim')

    for course, name, color in ((track, 'centre line', OTHER), (line, 'racing line', BLUE)):
        samples = course.samples()
        speeds = _speeds_along(course, samples, limits)
        pose = course.place(samples)
        # The horizontal axis is the position on the centre line beside each point.
        position = np.asarray(track.frenet(pose.x, pose.y, pose.psi).s) % track.length
        order = np.argsort(position)
        label = f'{name}, {lap_time(course, limits):.2f} s'
        speed.plot(position[order], speeds[order], color=color, lw=1.6, label=label)
        curvature.plot(position[order], course.curvature(samples[order]), color=color, lw=1.6)

    coloured = _coloured_line(line, limits)
    plan.add_collection(coloured)
    figure.colorbar(coloured, ax=plan, label='Speed [m/s]', orientation='horizontal', shrink=0.7)
    plan.set(xlabel='x [m]', ylabel='y [m]')
    speed.set(ylabel='Speed [m/s]', xlim=(0.0, track.length))
    speed.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)
    curvature.set(ylabel='Curvature [1/m]', xlabel='Position along the centre line [m]')
    curvature.set_xlim(0.0, track.length)
    return figure


def _speeds_along(course: Track, samples: Floats, limits: Limits) -> Floats:
    profile = speed_profile(course, *limits)
    return np.array([profile(0.0, s) for s in samples.tolist()])


def _coloured_line(line: Track, limits: Limits) -> LineCollection:
    """Return a racing line from above, each piece in the colour of its speed."""
    samples = line.samples()
    pose = line.place(samples)
    points = np.column_stack([pose.x, pose.y])
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    coloured = LineCollection(list(pieces), lw=3.5)
    coloured.set_array(_speeds_along(line, samples, limits)[:-1])
    return coloured


def draw_table(
    axes: Axes,
    rows: Sequence[Sequence[str]],
    colors: Mapping[int, str],
) -> None:
    """Draw a table, whose columns are as wide as their texts.

    Parameters
    ----------
    axes
        Where to draw.
    rows
        Its rows of cells; the first one has the headings.
    colors
        The colours of rows, by their index; these rows are bold.
    """
    axes.set_axis_off()
    table = axes.table(list(rows), cellLoc='right', edges='open', loc='upper center')
    table.auto_set_column_width(range(len(rows[0])))
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    for (row, _), cell in table.get_celld().items():
        cell.PAD = _PADDING
        default = INK if row else MUTED
        cell.get_text().set_color(colors.get(row, default))
        cell.get_text().set_fontweight('bold' if row in colors else 'normal')
