"""Figures of a run: from a `Log` to a Matplotlib `Figure`, without a window."""

from __future__ import annotations

import textwrap
from io import BytesIO
from itertools import cycle
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.markers import TICKUP
from matplotlib.ticker import MaxNLocator

from barc_sim.cli.text import one_line
from barc_sim.control.cruise_control import GAINS
from barc_sim.errors import UserError
from barc_sim.figures.colours import (
    BLUE,
    COLOURS,
    DASHES,
    EARTH,
    GREEN,
    GREY,
    INK,
    MUTED,
    RUN_LINES,
    SKY,
    STYLE,
    TERM_DASHES,
    TERMS,
    VERMILLION,
)
from barc_sim.figures.differences import bag_settings, labels_of, log_settings
from barc_sim.figures.drawn_log import (
    after_run_up,
    driven_road,
    limits,
    speed_limits,
    with_zero_for_unknown_errors,
)
from barc_sim.figures.files import save
from barc_sim.figures.track_figure import OTHER, draw_table, track_figure
from barc_sim.simulation import metrics
from barc_sim.simulation.log import COLUMNS, Log, TrackLog
from barc_sim.simulation.metrics import (
    changes_of,
    lap_settings_of,
    laps_of,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure
    from numpy.typing import NDArray

_POSITION = 'Position along the road [m]'
_SHOWN = 120  # maximum length of a setting
_SEPARATOR = ' · '  #: between two settings
_INCHES = 0.85  #: [inch] of a chart's share of the height
_ROW_INCHES = 0.24  #: [inch] of a row of the table
_MAX_GAINS = 46  #: characters
ROW_HEADINGS = ('run', *metrics.ROAD_LAP_HEADINGS[1:])  #: of the table of a comparison
_MAX_NAME = 44  #: characters of a run's name in it
_LEGEND_CHARACTERS = 105  #: of a row of the legend
_HANDLE_CHARACTERS = 8  #: that the line in front of a name takes
_LEGEND_ROW = 16.0  #: [pt]


class NotebookFigure(Figure):
    """A figure that a notebook shows without pyplot."""

    @style.context(STYLE)
    def __init__(self) -> None:
        """Make an empty figure, which looks the same with any matplotlibrc."""
        super().__init__()

    def _repr_png_(self) -> bytes:
        data = BytesIO()
        save(self, data, format='png')
        return data.getvalue()


def plot(*logs: Log, labels: Sequence[str] = (), ax: Axes | None = None) -> Figure | SubFigure:
    """Return the figure of speed, grade and command over the position; `savefig` saves it.

    Several runs are compared: each has a line, and a row in a table of their errors. With `ax`,
    Matplotlib's axes, only the speed is drawn, in these axes. For a run on a track the figure has
    the path, and errors, speed and steering over a lap; of several, the best laps. A drive by hand
    has the figure of any run on a road; `barc plot` draws its path from above.

    Parameters
    ----------
    logs
        The runs, all on roads or all on one track.
    labels
        A label for each run; by default the parameters in which recorded runs differ, such as
        `kp 20`.
    ax
        The axes to draw into.

    Returns
    -------
    Figure
        The new figure, or that of `ax`.

    Raises
    ------
    UserError
        There is no log with a state, or the logs cannot be compared.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> figure = plot(simulate(kp=2.0), simulate(kp=20.0), labels=['kp 2', 'kp 20'])
    >>> figure.savefig('speed.png')
    """
    for log in logs:
        if not isinstance(log, Log):
            raise UserError(
                f'plot: {one_line(repr(log))} is not a log: pass each log that simulate() or '
                'read_bag() returns as a separate argument'
            )
    if not logs or any(not len(log) for log in logs):
        raise UserError('plot needs at least one log with a state: pass the log of a run')
    names = _default_labels(logs)
    for index, label in enumerate(labels[: len(logs)]):
        names[index] = label
    if ax is not None:
        for line in _run_lines([with_zero_for_unknown_errors(log) for log in logs], names):
            _draw_speed(ax, line)
            _draw_reference(ax, line.log, '', 0.8)
        ax.set_xlabel(_POSITION)
        ax.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.0)
        return ax.figure
    if len(logs) > 1:
        return comparison_figure(logs, names, figure=NotebookFigure())
    title = ''.join(labels)
    if isinstance(logs[0], TrackLog):
        return track_figure(logs[0], title=title, figure=NotebookFigure())
    return speed_figure(logs[0], title=title, figure=NotebookFigure())


def _default_labels(logs: Sequence[Log]) -> list[str]:
    """Return what recorded runs differ in, or else `run 1`, `run 2` and so on."""
    names = [f'run {k}' for k in range(1, len(logs) + 1)]
    return labels_of([log_settings(log) for log in logs], names)


class _Line(NamedTuple):
    """A run, a lap, or several laps as one broken line, in each of the charts."""

    log: Log
    name: str  #: in the legend
    speed_color: str  #: in the charts of speed and error
    command_color: str
    width: float = 1.4  #: [pt] of the speed's line
    dashes: Any = '-'


class _LapLines(NamedTuple):
    """The laps of a run that has several."""

    lines: list[_Line]  #: the others, the last one, and the one in front
    front: Log  #: the lap in front: the best one, or the only one
    rows: list[tuple[str, ...]]  #: of the table, its headings first
    colors: dict[int, str]  #: of rows of the table


class _Charts(NamedTuple):
    """The charts of a figure over the position along the road, and a table below them."""

    speed: Axes
    error: Axes | None  #: None: no run has a known error
    grade: Axes
    command: Axes
    table: Axes | None  #: None: it has no rows


@style.context(STYLE)
def speed_figure(
    log: Log, *, title: str = '', settings: str = '', figure: Figure | None = None
) -> Figure:
    """Draw speed, speed error, grade and command of a run over the position.

    The error is drawn after the run-up, unless the run is shorter or has no reference (NaN). The
    laps of a run with several have their own lines, the best one and the last one in colour, and a
    table with the errors and the gains of each.

    Parameters
    ----------
    log
        The run.
    title, settings
        The two lines of the heading.
    figure
        The empty figure to draw on, whose size is set; by default a new one.
    """
    run = with_zero_for_unknown_errors(log)
    laps = _lap_lines(run)
    lines = laps.lines if laps else [_Line(run, 'speed', BLUE, GREEN, 2.0)]
    front = laps.front if laps else run
    figure = figure or Figure()
    charts = _add_charts(figure, [run], len(laps.rows) if laps else 0)

    for line in lines:
        _draw_line(charts, line)
        _draw_grade(charts.grade, line.log, MUTED)
    _draw_reference(charts.speed, _broken(run), 'reference', 1.2)
    _add_details(run, front, charts)
    if laps and charts.table:
        draw_table(charts.table, laps.rows, laps.colors)
    if not laps:
        # The errors of the raw log: a state whose true speed is unknown does not count.
        figure.supxlabel(_caption(log), x=0.99, ha='right', fontsize=9, color=MUTED)

    _finish(figure, charts, [run])
    # The heading's second line and the legend are above the axes, the title is above both.
    speed = charts.speed
    speed.set_title(title, loc='left', pad=26.0, fontsize=14, fontweight='bold')
    speed.annotate(settings, (0.0, 1.0), (0.0, 8.0), 'axes fraction', 'offset points', color=MUTED)
    speed.legend(loc='lower right', bbox_to_anchor=(1.0, 1.06), ncols=4, borderaxespad=0.0)
    return figure


@style.context(STYLE)
def comparison_figure(
    logs: Sequence[Log],
    labels: Sequence[str],
    *,
    title: str = '',
    settings: str = '',
    figure: Figure | None = None,
) -> Figure:
    """Draw several runs in one figure, each in a colour of its own and with its label.

    On roads it has the charts of `speed_figure` and a table of the errors; the slopes are shaded if
    all runs have the same. Runs on a track are drawn by `track_figure`.

    Parameters
    ----------
    logs
        The runs.
    labels
        The label of each.
    title, settings
        The two lines of the heading: what the runs have in common.
    figure
        The empty figure to draw on, whose size is set; by default a new one.

    Raises
    ------
    UserError
        The runs cannot be compared.
    """
    on_track = [log for log in logs if isinstance(log, TrackLog)]
    if on_track:
        _check_tracks(logs)
        return track_figure(*on_track, labels=labels, title=title, settings=settings, figure=figure)

    runs = [with_zero_for_unknown_errors(log) for log in logs]
    lines = _run_lines(runs, labels)
    figure = figure or Figure()
    charts = _add_charts(figure, runs, 1 + len(runs))

    for line in lines:
        _draw_line(charts, line)
    _draw_references(charts.speed, [line.log for line in lines])
    longest = max(runs, key=lambda run: float(np.ptp(run.distance)))
    if all(_has_slopes_of(run, longest) for run in runs):
        _draw_grade(charts.grade, longest, MUTED)
        _shade(charts.grade, longest)
    else:
        for line in lines:
            _draw_grade(charts.grade, line.log, line.speed_color)
    ends = [end for run in runs if _has_error(run) for end in speed_limits(run)]
    if ends:
        charts.speed.set_ylim(min(ends), max(ends))
    if charts.table:
        rows = [_row_of(label, log) for label, log in zip(labels, logs, strict=True)]
        colors = {row: line.speed_color for row, line in enumerate(lines, start=1)}
        draw_table(charts.table, [ROW_HEADINGS, *rows], colors)

    _finish(figure, charts, runs)
    _add_heading(charts.speed, title, settings)
    return figure


def _run_lines(runs: Sequence[Log], labels: Sequence[str]) -> list[_Line]:
    """Return the line of each of several runs."""
    return [
        _Line(_broken(run), label, color, color, dashes=dashes)
        for run, label, (color, dashes) in zip(runs, labels, cycle(RUN_LINES), strict=False)
    ]


def _check_tracks(logs: Sequence[Log]) -> None:
    """Raise UserError unless all runs are on one track; one that is unknown may be any."""
    if not all(isinstance(log, TrackLog) for log in logs):
        raise UserError(
            'runs on a track and on a road have no position in common to be compared at: plot '
            'them apart'
        )
    tracks = [log.track for log in logs if isinstance(log, TrackLog) and log.track]
    for track in tracks:
        if track != tracks[0]:
            raise UserError(
                f'runs on the tracks {tracks[0].name!r} and {track.name!r} have no position in '
                'common to be compared at: plot them apart'
            )


def _row_of(label: str, log: Log) -> tuple[str, ...]:
    """Return the row of a run in the table of a comparison."""
    lap = metrics.Lap(0, log.t[0], log.t[-1], 0.0, 0.0, metrics.summary(log))
    name = textwrap.shorten(label, _MAX_NAME, placeholder=' …')
    return (name, *lap.cells[1:])


def _draw_references(axes: Axes, logs: Sequence[Log]) -> None:
    """Draw the reference of each run; a speed that several runs hold is drawn for the longest."""
    drawn: set[float] = set()
    name = 'reference'
    for log in sorted(logs, key=lambda log: -float(np.nanmax(log.distance))):
        speeds = set(log.reference[np.isfinite(log.reference)].tolist())
        if len(speeds) == 1:
            if speeds <= drawn:
                continue
            drawn |= speeds
        _draw_reference(axes, log, name, 0.8)
        name = ''


def _has_slopes_of(run: Log, other: Log) -> bool:
    """Return whether a run has the grades of another one, as far as both recorded them."""
    road = driven_road(other)
    if road is None or driven_road(run) is None:
        return False
    # The states of two runs lie at different places: near an edge either grade may be recorded.
    margin = max(_longest_step(run), _longest_step(other))
    within = (run.distance >= other.distance.min()) & (run.distance <= other.distance.max())
    recorded = within & np.isfinite(run.theta_deg)
    distance = run.distance[recorded]
    grades = [road.grade_deg(distance + shift) for shift in (-margin, 0.0, margin)]
    is_equal = run.theta_deg[recorded] == np.array(grades)
    return bool(is_equal.any(axis=0).all())


def _longest_step(run: Log) -> float:
    """Return the distance between two states at the highest speed [m]."""
    period = float(np.median(np.diff(run.t))) if len(run) > 1 else 0.0
    return period * float(np.nanmax(np.abs(run.speed)))


def _add_charts(figure: Figure, runs: Sequence[Log], rows: int) -> _Charts:
    """Add the charts to an empty figure, and a table of so many rows."""
    has_error = any(map(_has_error, runs))
    heights = [4.0, 1.8, 1.4, 1.6] if has_error else [4.0, 1.4, 1.6]
    height = 0.9 + _INCHES * sum(heights)
    count = len(heights)
    if rows:
        heights.append((_ROW_INCHES * rows + 0.1) / _INCHES)
        height += _ROW_INCHES * rows + 0.3
    figure.set_size_inches(9.6, height)
    figure.set_layout_engine('constrained', w_pad=0.08, h_pad=0.08)

    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    axes = [figure.add_subplot(grid[0])]
    axes += [figure.add_subplot(grid[k], sharex=axes[0]) for k in range(1, count)]
    for upper in axes[:-1]:
        upper.tick_params(labelbottom=False)
    return _Charts(
        speed=axes[0],
        error=axes[1] if has_error else None,
        grade=axes[-2],
        command=axes[-1],
        table=figure.add_subplot(grid[count]) if rows else None,
    )


def _draw_line(charts: _Charts, line: _Line) -> None:
    """Draw speed, error and command of a run or lap."""
    log = line.log
    _draw_speed(charts.speed, line)
    if charts.error:
        # During the run-up it is too large for the chart.
        values = np.where(log.distance >= metrics.RUN_UP, log.speed_error, np.nan)
        charts.error.plot(log.distance, values, color=line.speed_color, lw=1.4, ls=line.dashes)
    charts.command.step(
        log.distance,
        log.motor,
        where='post',
        marker=_marker(log),
        lw=1.2,
        ls=line.dashes,
        color=line.command_color,
    )


def _draw_grade(axes: Axes, log: Log, color: str) -> None:
    """Draw the grade along the road."""
    axes.step(log.distance, log.theta_deg, where='post', marker=_marker(log), lw=1.2, color=color)


def _shade(axes: Axes, log: Log) -> None:
    """Shade the slopes."""
    axes.fill_between(log.distance, log.theta_deg, step='post', color=EARTH)


def _finish(figure: Figure, charts: _Charts, runs: Sequence[Log]) -> None:
    """Name and scale the axes."""
    charts.speed.set_ylabel('Speed [m/s]')
    if charts.error:
        charts.error.axhline(0.0, color=GREY, lw=0.8)
        charts.error.set_ylabel('Error [m/s]')
    grades = np.concatenate([log.theta_deg for log in runs])
    charts.grade.set(ylabel='Grade [°]', ylim=limits(grades, share=0.15, minimum=5.0))
    commands = np.concatenate([after_run_up(log, log.motor) for log in runs])
    charts.command.set(ylabel='Command [m/s²]', ylim=limits(commands, share=0.12, minimum=1.0))
    _name_position(charts.command, *runs)
    named = (charts.speed, charts.error, charts.grade, charts.command)
    figure.align_ylabels([axes for axes in named if axes])


def _add_heading(axes: Axes, title: str, settings: str) -> None:
    """Add the legend above the axes, and the two lines of the heading above the legend.

    Long labels have fewer columns.
    """
    handles, names = axes.get_legend_handles_labels()
    longest = max(map(len, names))
    columns = max(min(len(names), _LEGEND_CHARACTERS // (longest + _HANDLE_CHARACTERS)), 1)
    rows = -(-len(names) // columns)
    axes.legend(
        handles,
        names,
        loc='lower left',
        bbox_to_anchor=(0.0, 1.02),
        ncols=columns,
        borderaxespad=0.0,
    )
    height = 10.0 + _LEGEND_ROW * rows
    axes.annotate(
        settings, (0.0, 1.0), (0.0, height), 'axes fraction', 'offset points', color=MUTED
    )
    above = height + (18.0 if settings else 0.0)
    axes.set_title(title, loc='left', pad=above, fontsize=14, fontweight='bold')


def _lap_lines(run: Log) -> _LapLines | None:
    """Return the lines of the laps of a run; None if it has only one lap."""
    laps, numbers = laps_of(run)
    if not laps.finished:
        return None
    best = laps.best or laps.current
    last = laps.current
    number_of_state = np.array(numbers)

    def lap_log(number: int) -> Log:
        return run.map(lambda column: column[number_of_state == number])

    # The best lap is drawn last, over the others.
    roles = []
    if laps.best:
        roles.append('best')
    if best.number == last.number:
        roles.append('last')
    name = f'lap {best.number + 1}, {" and ".join(roles)}'
    best_log = lap_log(best.number)
    lines = [_Line(best_log, name, BLUE, BLUE, 2.0)]
    colors = {best.number: BLUE}

    if last.number != best.number:
        name = f'lap {last.number + 1}, last'
        lines.insert(0, _Line(lap_log(last.number), name, VERMILLION, VERMILLION))
        colors[last.number] = VERMILLION

    others = set(numbers) - colors.keys()
    if others:
        is_other = np.isin(number_of_state, list(others))
        log = _broken(run.map(lambda column: column[is_other]))
        name = 'other lap' if len(others) == 1 else 'other laps'
        lines.insert(0, _Line(log, name, OTHER, OTHER, 1.0))

    headings: tuple[str, ...] = metrics.ROAD_LAP_HEADINGS
    rows = [lap.cells for lap in laps.rows]
    settings = lap_settings_of(run, numbers)
    gains = [settings.text(lap.number) for lap in laps.rows]
    if any(gains):
        texts = [textwrap.shorten(text, _MAX_GAINS, placeholder=' …') for text in gains]
        headings = (*headings, 'gains')
        rows = [(*cells, text) for cells, text in zip(rows, texts, strict=True)]
    # The headings are row 0.
    color_of_row = {
        row: colors[lap.number]
        for row, lap in enumerate(laps.rows, start=1)
        if lap.number in colors
    }
    return _LapLines(lines, best_log, [headings, *rows], color_of_row)


def _name_position(axes: Axes, *logs: Log) -> None:
    """Label and scale the axis of the position."""
    distance = np.concatenate([log.distance for log in logs])
    axes.set(xlabel=_POSITION, xlim=limits(distance, share=0.01, minimum=0.5))
    axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))


def run_figure(log: Log, info: Mapping[str, str], title: str, figure: Figure | None) -> Figure:
    """Draw a run with its metadata: over the road, on its track, or from above if by hand.

    `plot` draws without metadata, and never from above: all its runs on roads are drawn over the
    position, so that any of them can be compared.
    """
    if isinstance(log, TrackLog):
        return track_figure(log, title=title, settings=settings(info, log), figure=figure)
    if is_by_hand(log):
        return drive_figure(log, title=title, figure=figure)
    return speed_figure(log, title=title, settings=settings(info, log), figure=figure)


class RecordedRun(NamedTuple):
    """A run, read from its bag."""

    name: str
    info: Mapping[str, str]  #: the metadata
    car: str  #: its namespace
    log: Log


def runs_figure(runs: Sequence[RecordedRun], title: str, figure: Figure | None) -> Figure:
    """Draw several recorded runs; the heading has what they have in common.

    UserError: they cannot be compared.
    """
    of_bags = [bag_settings(run.info, run.car, run.log) for run in runs]
    labels = labels_of(of_bags, [run.name for run in runs])
    headings = [_heading(run.info, run.log) for run in runs]
    common = [
        text
        for name, text in headings[0].items()
        if all(heading.get(name) == text for heading in headings)
    ]
    logs = [run.log for run in runs]
    return comparison_figure(
        logs, labels, title=title, settings=_SEPARATOR.join(common), figure=figure
    )


def settings(info: Mapping[str, str], log: Log) -> str:
    """Return road or track, and the gains of a run with its metadata, in one line."""
    return _SEPARATOR.join(_heading(info, log).values())


def _heading(info: Mapping[str, str], log: Log) -> dict[str, str]:
    """Return the texts of `settings`, by name."""
    course = 'track' if 'track' in info else 'road'
    texts = {key: f'{key} {info[key]}' for key in (course, 'lane', *GAINS) if key in info}
    texts |= changes_of(log)
    return {name: textwrap.shorten(text, _SHOWN, placeholder=' …') for name, text in texts.items()}


@style.context(STYLE)
def terms_figure(log: Log) -> Figure | None:
    """Draw the controller's terms over the position along the road; None if all are unknown.

    Several laps would hide one another: give one of them.
    """
    if all(np.isnan(values).all() for values in log.terms.values()):
        return None
    figure = Figure(figsize=(9.6, 3.6), layout='constrained')
    axes = figure.subplots()
    axes.step(log.distance, log.motor, where='post', color=GREEN, lw=2.0, label='command')
    for name, color, dashes in zip(log.terms, cycle(TERMS), cycle(TERM_DASHES), strict=False):
        axes.step(
            log.distance,
            log.terms[name],
            where='post',
            color=COLOURS[color].light,
            lw=1.4,
            ls=dashes,
            label=name,
        )
    # The limits fit the command; at the start the terms are so large that the rest would look flat.
    low, high = limits(log.motor, share=0.5, minimum=1.0)
    axes.set(ylim=(low, high), ylabel='Acceleration [m/s²]')
    axes.axhline(0.0, color=GREY, lw=0.8)
    _name_position(axes, log)
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.0)
    return figure


def _caption(log: Log) -> str:
    """Return a line on the speed error; empty without a reference."""
    summary = metrics.summary(log)
    texts = []
    if not np.isnan(summary.rms_error_after_run_up):
        errors = _errors(summary.rms_error_after_run_up, summary.max_error_after_run_up)
        texts.append(f'after the first {metrics.RUN_UP:g} m: {errors}')
    if not np.isnan(summary.rms_error):
        texts.append(f'whole run: {_errors(summary.rms_error, summary.max_error)}')
    return f'Speed error {"; ".join(texts)}' if texts else ''


def _errors(rms: float, maximum: float) -> str:
    return f'RMS {rms:.3f} m/s, maximum {maximum:.3f} m/s'


def _broken(log: Log) -> Log:
    """Return the log with a row of NaN between two laps, so that no line joins them."""
    _, numbers = laps_of(log)
    first_of_lap = np.flatnonzero(np.diff(numbers)) + 1
    if not first_of_lap.size:
        return log

    def with_gaps(column: NDArray[Any]) -> NDArray[Any]:
        gap = False if column.dtype == np.bool_ else np.nan
        return np.insert(column, first_of_lap, gap)

    return log.map(with_gaps)


def _draw_speed(axes: Axes, line: _Line) -> None:
    """Draw the true speed."""
    log = line.log
    axes.plot(
        log.distance,
        log.speed,
        label=line.name,
        color=line.speed_color,
        lw=line.width,
        ls=line.dashes,
        marker=_marker(log),
    )


def _draw_reference(axes: Axes, log: Log, name: str, width: float) -> None:
    """Draw the reference, if there is one."""
    if not np.all(np.isnan(log.reference)):
        axes.plot(
            log.distance,
            log.reference,
            label=name,
            color=INK,
            lw=width,
            ls=DASHES,
            marker=_marker(log),
        )


def _has_error(log: Log) -> bool:
    """Return whether there is a speed error after the run-up."""
    return bool(np.isfinite(log.speed_error[log.distance >= metrics.RUN_UP]).any())


def _add_details(log: Log, front: Log, charts: _Charts) -> None:
    """Add the details of a single run; ground and measured speed are those of the `front` lap."""
    speed = charts.speed
    command = charts.command
    if np.any(front.e_v_x):
        speed.plot(
            front.distance, front.v_x, color=SKY, alpha=0.6, lw=0.8, label='measured', zorder=1.9
        )
    if np.min(log.speed) < 0.0:
        speed.axhline(0.0, color=GREY, lw=0.8)
    if _has_error(log):
        speed.set_ylim(*speed_limits(log))
    _shade(charts.grade, front)
    if log.missed.any():
        _mark_missed(command, log)


def _mark_missed(axes: Axes, log: Log) -> None:
    """Mark each missed deadline at the bottom of a chart."""
    count = np.count_nonzero(log.missed)
    axes.plot(
        log.distance[log.missed],
        np.zeros(count),
        transform=axes.get_xaxis_transform(),
        label=f'{count} missed deadline' + ('s' if count > 1 else ''),
        ls='',
        marker=TICKUP,
        markersize=8,
        color=INK,
    )
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 0.98), borderaxespad=0.0)


def _marker(log: Log) -> str:
    """Return the marker of a line through the states; a single state needs one."""
    return 'o' if len(log) == 1 else ''


@style.context(STYLE)
def drive_figure(log: Log, *, title: str = '', figure: Figure | None = None) -> Figure:
    """Draw the path from above, and heading, speed and steering over time.

    For a drive straight ahead, draw speed and command only. The lines are broken where the car was
    reset to the start.

    Parameters
    ----------
    log
        The drive.
    title
        The heading.
    figure
        The empty figure to draw on, whose size is set; by default a new one.
    """
    log = with_zero_for_unknown_errors(log)
    _, lap_numbers = laps_of(log)
    is_reset = np.diff(lap_numbers) > 0
    speed = _TimeChart('Speed [m/s]', _without_jumps(log.speed, is_reset), BLUE)
    has_turns = bool(np.nan_to_num(log.servo).any())

    figure = figure or Figure()
    figure.set_size_inches(9.6, 9.6)
    figure.set_layout_engine('constrained')
    if has_turns:
        plan, *axes_of_charts = figure.subplots(4, 1, height_ratios=[4.0, 1.4, 1.4, 1.4])
        x = _without_jumps(log.distance, is_reset)
        y = _without_jumps(log.across, is_reset)
        draw_path(plan, x, y)

        heading = _without_jumps(_headings(log, is_reset), is_reset)
        steering = _without_jumps(np.degrees(log.servo), is_reset)
        charts = [
            _TimeChart('Heading [°]', heading, INK),
            speed,
            _TimeChart('Steering [°]', steering, GREEN, 'steps-post'),
        ]
        top = plan
    else:
        axes_of_charts = list(figure.subplots(2, 1))
        charts = [speed, _TimeChart('Command [m/s²]', log.motor, GREEN, 'steps-post')]
        top = axes_of_charts[0]

    for axes, chart in zip(axes_of_charts, charts, strict=True):
        axes.plot(log.t, chart.values, color=chart.color, lw=1.8, drawstyle=chart.drawstyle)
        axes.set_ylim(*limits(chart.values, share=0.1, minimum=1.0))
        axes.set_xlim(*limits(log.t, share=0.01, minimum=1.0))
        axes.set_ylabel(chart.label)
        axes.tick_params(labelbottom=axes is axes_of_charts[-1])
    axes_of_charts[-1].set_xlabel('Time [s]; left is positive' if has_turns else 'Time [s]')
    top.set_title(title, loc='left', fontsize=14, fontweight='bold')
    figure.align_ylabels(axes_of_charts)
    return figure


class _TimeChart(NamedTuple):
    """A chart over time."""

    label: str
    values: NDArray[np.float64]
    color: str
    drawstyle: str = 'default'  #: `steps-post` for commands, which hold until the next one


def _headings(log: Log, is_reset: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the true heading of each state [deg], unwrapped from each reset on.

    A reset turns the car back to 0°.
    """
    heading = np.nan_to_num(log.psi - log.e_epsi)
    drives = np.split(heading, np.flatnonzero(is_reset) + 1)
    unwrapped = np.concatenate([np.unwrap(drive) for drive in drives])
    degrees: NDArray[np.float64] = np.degrees(unwrapped)
    return degrees


def is_by_hand(log: Log) -> bool:
    """Return whether a run seems to be driven by hand on the flat, so that a view from above fits.

    A log does not have its controller, so this is a guess: no speed was to be held, and the road
    had no elevation. It is also true of a controller without a reference, on the flat.
    """
    return bool(np.isnan(log.reference).all() and not np.nan_to_num(log.elevation).any())


def _without_jumps(values: NDArray[np.float64], jumps: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return `values` with NaN before each jump."""
    return np.where(np.append(jumps, False), np.nan, values)


def draw_path(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    """Draw a path from above, with its start and its end."""
    axes.plot(x, y, color=BLUE, lw=1.8)
    axes.plot(x[:1], y[:1], 'o', color=INK, label='start')
    axes.plot(x[-1:], y[-1:], 's', color=MUTED, label='end')
    axes.set_aspect('equal', adjustable='datalim')
    axes.set(xlabel='x [m]', ylabel='y [m]')
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)


@style.context(STYLE)
def identification_figure(
    signals: Mapping[str, tuple[NDArray[np.float64], ...]], *, title: str = ''
) -> Figure:
    """Draw each signal as measured and predicted, and the error below; one log after the other.

    Parameters
    ----------
    signals
        The arrays of `Identified` by the signal's name: time, measured and predicted values.
    title
        The heading.
    """
    count = len(signals)
    figure = Figure(figsize=(9.0, 1.2 + 3.2 * count), layout='constrained')
    figure.suptitle(title, x=0.02, ha='left', fontsize=14, fontweight='bold')
    heights = [3.0, 1.2] * count
    panels = figure.subplots(2 * count, 1, sharex=True, height_ratios=heights)
    for index, (name, (t, measured, predicted)) in enumerate(signals.items()):
        _draw_prediction(panels[2 * index], panels[2 * index + 1], name, t, measured, predicted)
    panels[0].legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
    panels[-1].set_xlabel('Time [s]')
    return figure


def _draw_prediction(
    above: Axes,
    below: Axes,
    name: str,
    t: NDArray[np.float64],
    measured: NDArray[np.float64],
    predicted: NDArray[np.float64],
) -> None:
    """Draw a signal, and its error in the axes below."""
    # No line joins the end of a log to the start of the next one.
    steps = np.diff(t, prepend=t[0])
    is_new_log = steps < 0.0
    time = np.cumsum(np.where(is_new_log, np.median(steps), steps))
    line = np.where(is_new_log, np.nan, predicted)

    column = COLUMNS[name]
    above.plot(time, measured, '.', ms=2.0, color=INK, alpha=0.5, label='measured')
    above.plot(time, line, lw=1.2, color=BLUE, label='predicted from the first state')
    above.set_ylabel(f'{column.meaning.capitalize()} [{column.unit}]')
    below.plot(time, predicted - measured, lw=0.6, color=VERMILLION)
    below.axhline(0.0, lw=0.8, color=INK)
    below.set_ylabel(f'Residual [{column.unit}]')
