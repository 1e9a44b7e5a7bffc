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
from barc_sim.figures.files import save
from barc_sim.figures.style import (
    BLUE,
    COLOURS,
    DASHES,
    EARTH,
    GREEN,
    GREY,
    INK,
    MUTED,
    RUN_COLOURS,
    SKY,
    STYLE,
    TERM_DASHES,
    TERMS,
    VERMILLION,
    after_run_up,
    limits,
    speed_limits,
    use_measurement,
)
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
_INCHES = 0.85  #: [inch] of a chart's share of the height
_ROW_INCHES = 0.24  #: [inch] of a row of the table
_TABLE_WIDTHS = (0.08, 0.1, 0.12, 0.12, 0.11, 0.11, 0.36)  #: shares
_MAX_GAINS = 46  #: characters


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

    Several runs have a line each, with their `labels`. With `ax`, Matplotlib's axes, only the
    speed is drawn, in these axes. For a run on a track the figure has the path, and errors, speed
    and steering over a lap.

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
    names = [*labels, *(f'run {k}' for k in range(len(labels) + 1, len(logs) + 1))][: len(logs)]
    if ax is not None:
        for log, name, color in zip(logs, names, cycle(RUN_COLOURS), strict=False):
            curve = _Line(_broken(use_measurement(log)), name, color, color)
            _draw_speed(ax, curve, has_reference=True)
        ax.set_xlabel(_POSITION)
        ax.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.0)
        return ax.figure
    on_track = [log for log in logs if isinstance(log, TrackLog)]
    title = ''.join(labels) if len(logs) == 1 else ''
    if len(on_track) == len(logs):
        return track_figure(*on_track, labels=names, title=title, figure=NotebookFigure())
    return speed_figure(*logs, labels=names, title=title, figure=NotebookFigure())


class _Line(NamedTuple):
    """A run, a lap, or several laps as one broken line, in each of the charts."""

    log: Log
    name: str  #: in the legend
    speed: str  #: colour of the line in the chart of speed and error
    command: str  #: colour
    width: float = 1.4  #: [pt] of the speed's line


class _LapLines(NamedTuple):
    """The laps of a run that has several."""

    curves: list[_Line]  #: the others, the last one, and the best one
    shown: Log  #: the best lap
    rows: list[tuple[str, ...]]  #: of the table, its headings first
    colors: dict[int, str]  #: of rows of the table


@style.context(STYLE)
def speed_figure(
    *logs: Log,
    labels: Sequence[str] = (),
    title: str = '',
    settings: str = '',
    figure: Figure | None = None,
) -> Figure:
    """Draw speed, speed error, grade and command of runs over the position.

    The error is drawn after the run-up, unless the run is shorter or has no reference (NaN). The
    laps of a single run have their own lines, the best one and the last one in colour, and a table
    with the errors and the gains of each. Several runs have a line each, with their `labels`.
    `title` and `settings` are the two lines of the heading. `figure` must be empty; its size is set
    here.
    """
    runs = [use_measurement(log) for log in logs]
    is_single = len(runs) == 1
    laps = _laps_of(runs[0]) if is_single else None
    if laps:
        curves = laps.curves
    elif is_single:
        curves = [_Line(runs[0], 'speed', BLUE, GREEN, 2.0)]
    else:
        curves = [
            _Line(_broken(log), name, color, color)
            for log, name, color in zip(runs, labels, cycle(RUN_COLOURS), strict=False)
        ]
    figure = figure or Figure()
    speed, error, grade, command, table = _panels(figure, runs, len(laps.rows) if laps else 0)

    for curve in curves:
        log = curve.log
        steps: dict[str, Any] = {'where': 'post', 'marker': _marker(log), 'lw': 1.2}
        _draw_speed(speed, curve, has_reference=not (is_single or laps))
        if error:
            # During the run-up it is too large for the chart.
            values = np.where(log.distance >= metrics.RUN_UP, log.speed_error, np.nan)
            error.plot(log.distance, values, color=curve.speed, lw=1.4)
        grade.step(log.distance, log.theta_deg, color=MUTED if is_single else curve.speed, **steps)
        command.step(log.distance, log.motor, color=curve.command, **steps)
    if error:
        error.axhline(0.0, color=GREY, lw=0.8)
        error.set_ylabel('Error [m/s]')
    if is_single:
        shown = laps.shown if laps else runs[0]
        _draw_reference(speed, _broken(runs[0]), 'reference', 1.2)
        _add_details(runs[0], shown, speed, grade, command)
    if laps and table:
        draw_table(table, laps.rows, _TABLE_WIDTHS[: len(laps.rows[0])], laps.colors)
    if is_single and not laps:
        figure.supxlabel(_caption(logs[0]), x=0.99, ha='right', fontsize=9, color=MUTED)

    _name_position(command, *runs)
    speed.set_ylabel('Speed [m/s]')
    grades = np.concatenate([log.theta_deg for log in runs])
    grade.set(ylabel='Grade [°]', ylim=limits(grades, share=0.15, minimum=5.0))
    commands = np.concatenate([after_run_up(log, log.motor) for log in runs])
    command.set(ylabel='Command [m/s²]', ylim=limits(commands, share=0.12, minimum=1.0))
    # The heading's second line and the legend are above the axes, the title is above both.
    speed.set_title(title, loc='left', pad=26.0, fontsize=14, fontweight='bold')
    speed.annotate(settings, (0.0, 1.0), (0.0, 8.0), 'axes fraction', 'offset points', color=MUTED)
    speed.legend(loc='lower right', bbox_to_anchor=(1.0, 1.06), ncols=4, borderaxespad=0.0)
    figure.align_ylabels([axes for axes in (speed, error, grade, command) if axes])
    return figure


def _panels(
    figure: Figure, runs: Sequence[Log], rows: int
) -> tuple[Axes, Axes | None, Axes, Axes, Axes | None]:
    """Return the charts of speed, error, grade and command, and a table of so many rows.

    There is no chart of an error that is unknown, and no table without rows.
    """
    heights = [4.0, 1.8, 1.4, 1.6] if any(map(_has_error, runs)) else [4.0, 1.4, 1.6]
    height = 0.9 + _INCHES * sum(heights)
    count = len(heights)
    if rows:
        heights.append((_ROW_INCHES * rows + 0.1) / _INCHES)
        height += _ROW_INCHES * rows + 0.3
    figure.set_size_inches(9.6, height)
    figure.set_layout_engine('constrained', w_pad=0.08, h_pad=0.08)
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    charts = [figure.add_subplot(grid[0])]
    charts += [figure.add_subplot(grid[k], sharex=charts[0]) for k in range(1, count)]
    for axes in charts[:-1]:
        axes.tick_params(labelbottom=False)
    speed, *error, grade, command = charts
    table = figure.add_subplot(grid[count]) if rows else None
    return speed, error[0] if error else None, grade, command, table


def _laps_of(run: Log) -> _LapLines | None:
    """Return the laps of a run; None if it has only one."""
    laps, numbers = laps_of(run)
    if not laps.finished:
        return None
    settings = lap_settings_of(run, numbers)
    best, last = laps.best or laps.current, laps.current
    of_lap = np.array(numbers)

    def lap_of(number: int) -> Log:
        return run.map(lambda column: column[of_lap == number])

    words = ['best'] * bool(laps.best) + ['last'] * (best.number == last.number)
    name = f'lap {best.number + 1}, {" and ".join(words)}'
    curves = [_Line(lap_of(best.number), name, BLUE, BLUE, 2.0)]
    colors = {best.number: BLUE}
    if last.number != best.number:
        name = f'lap {last.number + 1}, last'
        curves.insert(0, _Line(lap_of(last.number), name, VERMILLION, VERMILLION))
        colors[last.number] = VERMILLION
    if not {*numbers} <= colors.keys():
        others = _broken(run.map(lambda column: column[~np.isin(of_lap, [*colors])]))
        name = 'other lap' if len({*numbers}) == len(colors) + 1 else 'other laps'
        curves.insert(0, _Line(others, name, OTHER, OTHER, 1.0))

    headings: tuple[str, ...] = metrics.ROAD_LAP_HEADINGS
    rows = [lap.cells for lap in laps.rows]
    gains = [settings.text(lap.number) for lap in laps.rows]
    if any(gains):
        texts = [textwrap.shorten(text, _MAX_GAINS, placeholder=' …') for text in gains]
        headings = (*headings, 'gains')
        rows = [(*cells, text) for cells, text in zip(rows, texts, strict=True)]
    of_row = {k: colors[lap.number] for k, lap in enumerate(laps.rows, 1) if lap.number in colors}
    return _LapLines(curves, curves[-1].log, [headings, *rows], of_row)


def _name_position(axes: Axes, *logs: Log) -> None:
    """Label and scale the axis of the position."""
    distance = np.concatenate([log.distance for log in logs])
    axes.set(xlabel=_POSITION, xlim=limits(distance, share=0.01, minimum=0.5))
    axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))


def run_figure(log: Log, info: Mapping[str, str], title: str, figure: Figure | None) -> Figure:
    """Draw a run with its metadata: over the road, on its track, or from above if by hand."""
    if isinstance(log, TrackLog):
        return track_figure(log, title=title, settings=settings(info, log), figure=figure)
    if is_by_hand(log):
        return drive_figure(log, title=title, figure=figure)
    return speed_figure(log, title=title, settings=settings(info, log), figure=figure)


def settings(info: Mapping[str, str], log: Log) -> str:
    """Return road or track, and the gains of a run with its metadata, in one line."""
    texts = {
        key: f'{key} {info[key]}'
        for key in ('track' if 'track' in info else 'road', 'lane', *GAINS)
        if key in info
    }
    texts |= changes_of(log)
    return ' · '.join(textwrap.shorten(text, _SHOWN, placeholder=' …') for text in texts.values())


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
    whole = metrics.summary(log)
    parts = {
        f'after the first {metrics.RUN_UP:g} m': (
            whole.rms_error_after_run_up,
            whole.max_error_after_run_up,
        ),
        'whole run': (whole.rms_error, whole.max_error),
    }
    texts = [
        f'{part}: RMS {rms:.3f} m/s, maximum {maximum:.3f} m/s'
        for part, (rms, maximum) in parts.items()
        if not np.isnan(rms)
    ]
    return f'Speed error {"; ".join(texts)}' if texts else ''


def _broken(log: Log) -> Log:
    """Return the log with a row of NaN between two laps, so that no line joins them."""
    first = np.flatnonzero(np.diff(laps_of(log)[1])) + 1
    if not first.size:
        return log
    return log.map(
        lambda column: np.insert(column, first, False if column.dtype == np.bool_ else np.nan)
    )


def _draw_speed(axes: Axes, curve: _Line, *, has_reference: bool) -> None:
    """Draw the true speed, and perhaps the reference, which then has no name in the legend."""
    log = curve.log
    axes.plot(
        log.distance,
        log.speed,
        label=curve.name,
        color=curve.speed,
        lw=curve.width,
        marker=_marker(log),
    )
    if has_reference:
        _draw_reference(axes, log, '', 0.8)


def _draw_reference(axes: Axes, log: Log, name: str, width: float) -> None:
    """Draw the reference, if there is one."""
    if not np.all(np.isnan(log.reference)):
        line: dict[str, Any] = {'color': INK, 'lw': width, 'ls': DASHES, 'marker': _marker(log)}
        axes.plot(log.distance, log.reference, label=name, **line)


def _has_error(log: Log) -> bool:
    """Return whether there is a speed error after the run-up."""
    return bool(np.isfinite(log.speed_error[log.distance >= metrics.RUN_UP]).any())


def _add_details(log: Log, shown: Log, speed: Axes, grade: Axes, command: Axes) -> None:
    """Add the details of a single run; ground and measured speed are those of the `shown` lap."""
    if np.any(shown.e_v_x):
        speed.plot(
            shown.distance, shown.v_x, color=SKY, alpha=0.6, lw=0.8, label='measured', zorder=1.9
        )
    if np.min(log.speed) < 0.0:
        speed.axhline(0.0, color=GREY, lw=0.8)
    if _has_error(log):
        speed.set_ylim(*speed_limits(log))
    grade.fill_between(shown.distance, shown.theta_deg, step='post', color=EARTH)
    if missed := np.count_nonzero(log.missed):
        label = f'{missed} missed deadline' + ('s' if missed > 1 else '')
        marks: dict[str, Any] = {
            'ls': '',
            'marker': TICKUP,
            'markersize': 8,
            'color': INK,
            'label': label,
        }
        bottom = command.get_xaxis_transform()
        command.plot(log.distance[log.missed], np.zeros(missed), transform=bottom, **marks)
        command.legend(loc='lower right', bbox_to_anchor=(1.0, 0.98), borderaxespad=0.0)


def _marker(log: Log) -> str:
    """Return the marker of a line through the states; a single state needs one."""
    return 'o' if len(log) == 1 else ''


@style.context(STYLE)
def drive_figure(log: Log, *, title: str = '', figure: Figure | None = None) -> Figure:
    """Draw the path from above, and heading, speed and steering over time.

    For a drive straight ahead, draw speed and command only. The lines are broken where the car was
    reset to the start.
    """
    log = use_measurement(log)
    figure = figure or Figure()
    figure.set_size_inches(9.6, 9.6)
    figure.set_layout_engine('constrained')
    resets = np.diff(laps_of(log)[1]) > 0
    speed = (_without_jumps(log.speed, resets), BLUE, 'Speed [m/s]')
    if np.nan_to_num(log.servo).any():
        turns = np.split(np.nan_to_num(log.psi - log.e_epsi), np.flatnonzero(resets) + 1)
        # The heading is unwrapped from each reset on: a reset turns the car back to 0°.
        degrees = np.degrees(np.concatenate([np.unwrap(each) for each in turns]))
        heading = (_without_jumps(degrees, resets), INK, 'Heading [°]')
        steering = (_without_jumps(np.degrees(log.servo), resets), GREEN, 'Steering [°]')
        drawn = [heading, speed, steering]
        top, *charts = figure.subplots(4, 1, height_ratios=[4.0, 1.4, 1.4, 1.4])
        draw_path(top, *(_without_jumps(values, resets) for values in (log.distance, log.across)))
    else:
        drawn = [speed, (log.motor, GREEN, 'Command [m/s²]')]
        top, _ = charts = [*figure.subplots(2, 1)]
    for axes, (values, color, label) in zip(charts, drawn, strict=True):
        line_style = 'steps-post' if color == GREEN else 'default'  # commands are held
        axes.plot(log.t, values, color=color, lw=1.8, drawstyle=line_style)
        axes.set_ylim(*limits(values, share=0.1, minimum=1.0))
        axes.set_xlim(*limits(log.t, share=0.01, minimum=1.0))
        axes.set_ylabel(label)
        axes.tick_params(labelbottom=axes is charts[-1])
    charts[-1].set_xlabel('Time [s]; left is positive' if len(charts) > 2 else 'Time [s]')  # noqa: PLR2004
    top.set_title(title, loc='left', fontsize=14, fontweight='bold')
    figure.align_ylabels(charts)
    return figure


def is_by_hand(log: Log) -> bool:
    """Return whether a run was driven by hand on the flat, so that a view from above fits."""
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

    `signals` has the arrays of `Identified`: time, measured and predicted values, by name.
    """
    n = len(signals)
    figure = Figure(figsize=(9.0, 1.2 + 3.2 * n), layout='constrained')
    figure.suptitle(title, x=0.02, ha='left', fontsize=14, fontweight='bold')
    panels = figure.subplots(2 * n, 1, sharex=True, height_ratios=[3.0, 1.2] * n, squeeze=False)
    for (name, (t, measured, predicted)), (above, below) in zip(
        signals.items(), panels[:, 0].reshape(n, 2), strict=True
    ):
        # No line joins the end of a log to the start of the next one.
        steps = np.diff(t, prepend=t[0])
        begins = steps < 0.0
        time = np.cumsum(np.where(begins, np.median(steps), steps))
        line = np.where(begins, np.nan, predicted)
        above.plot(time, measured, '.', ms=2.0, color=INK, alpha=0.5, label='measured')
        above.plot(time, line, lw=1.2, color=BLUE, label='predicted from the first state')
        unit, meaning, *_ = COLUMNS[name]
        above.set_ylabel(f'{meaning.capitalize()} [{unit}]')
        below.plot(time, predicted - measured, lw=0.6, color=VERMILLION)
        below.axhline(0.0, lw=0.8, color=INK)
        below.set_ylabel(f'Residual [{unit}]')
    panels[0, 0].legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
    panels[-1, 0].set_xlabel('Time [s]')
    return figure
