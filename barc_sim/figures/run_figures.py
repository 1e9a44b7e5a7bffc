"""Figures of a run: from a `Log` to a Matplotlib `Figure`, without a window."""

from __future__ import annotations

import textwrap
from io import BytesIO
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.markers import TICKUP
from matplotlib.ticker import MaxNLocator

from barc_sim.control.cruise_control import GAINS
from barc_sim.errors import UserError, one_line
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
from barc_sim.figures.track_figure import track_figure
from barc_sim.simulation import metrics
from barc_sim.simulation.log import COLUMNS, Log, TrackLog
from barc_sim.simulation.metrics import laps_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure
    from numpy.typing import NDArray

_POSITION = 'Position along the road [m]'
JUMP = 5.0  #: [m] A car that moves more between two states was reset to the start.
_SHOWN = 120  # maximum length of a setting


class NotebookFigure(Figure):
    """A figure that a notebook shows without pyplot."""

    def _repr_png_(self) -> bytes:
        data = BytesIO()
        self.savefig(data, format='png')
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
            _draw_speed(ax, _broken(use_measurement(log)), name, color)
        ax.set_xlabel(_POSITION)
        ax.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.0)
        return ax.figure
    on_track = [log for log in logs if isinstance(log, TrackLog)]
    title = ''.join(labels) if len(logs) == 1 else ''
    if len(on_track) == len(logs):
        return track_figure(*on_track, labels=names, title=title, figure=NotebookFigure())
    return speed_figure(*logs, labels=names, title=title, figure=NotebookFigure())


@style.context(STYLE)
def speed_figure(
    *logs: Log,
    labels: Sequence[str] = (),
    title: str = '',
    settings: str = '',
    figure: Figure | None = None,
) -> Figure:
    """Draw speed, speed error, grade and command of runs over the position.

    The error is drawn after the run-up, unless the run is shorter or has no reference (NaN).
    Several runs have a line each, with their `labels`. `title` and `settings` are the two lines of
    the heading. `figure` must be empty; its size is set here.
    """
    runs = [_broken(use_measurement(log)) for log in logs]
    figure = figure or Figure()
    figure.set_size_inches(9.6, 8.4)
    figure.set_layout_engine('constrained', w_pad=0.08, h_pad=0.08)
    heights = [4, 1.8, 1.4, 1.6] if any(map(_has_error, runs)) else [4, 1.4, 1.6]
    speed, *error, grade, command = figure.subplots(
        len(heights), 1, sharex=True, height_ratios=heights
    )
    looks: list[tuple[str, ...]] = [('', BLUE, MUTED, GREEN)]
    if len(runs) > 1:
        looks = [(name, *[color] * 3) for name, color in zip(labels, cycle(RUN_COLOURS))]
    for log, (name, color, of_grade, of_command) in zip(runs, looks, strict=True):
        steps: dict[str, Any] = {'where': 'post', 'marker': _marker(log), 'lw': 1.2}
        _draw_speed(speed, log, name, color)
        for axes in error:  # during the run-up it is too large for the chart
            values = np.where(log.distance >= metrics.RUN_UP, log.speed_error, np.nan)
            axes.plot(log.distance, values, color=color, lw=1.4)
            axes.axhline(0.0, color=GREY, lw=0.8)
            axes.set_ylabel('Error [m/s]')
        grade.step(log.distance, log.theta_deg, color=of_grade, **steps)
        command.step(log.distance, log.motor, color=of_command, **steps)
    if len(runs) == 1:
        _add_details(runs[0], speed, grade, command)
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
    speed.legend(loc='lower right', bbox_to_anchor=(1.0, 1.06), ncols=3, borderaxespad=0.0)
    figure.align_ylabels()
    return figure


def _name_position(axes: Axes, *logs: Log) -> None:
    """Label and scale the axis of the position."""
    distance = np.concatenate([log.distance for log in logs])
    axes.set(xlabel=_POSITION, xlim=limits(distance, share=0.01, minimum=0.5))
    axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))


def run_figure(log: Log, info: Mapping[str, str], title: str, figure: Figure | None) -> Figure:
    """Draw a run with its metadata: over the road, on its track, or from above if by hand."""
    if isinstance(log, TrackLog):
        return track_figure(log, title=title, settings=settings(info), figure=figure)
    if is_by_hand(log):
        return drive_figure(log, title=title, figure=figure)
    return speed_figure(log, title=title, settings=settings(info), figure=figure)


def settings(info: Mapping[str, str]) -> str:
    """Return road or track, and the gains in a run's metadata, in one line."""
    return ' · '.join(
        f'{key} {textwrap.shorten(info[key], _SHOWN, placeholder=" …")}'
        for key in ('track' if 'track' in info else 'road', 'lane', *GAINS)
        if key in info
    )


@style.context(STYLE)
def terms_figure(log: Log) -> Figure | None:
    """Draw the controller's terms over the position along the road; None if all are unknown."""
    if all(np.isnan(values).all() for values in log.terms.values()):
        return None
    log = _broken(log)
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


def _draw_speed(axes: Axes, log: Log, name: str, color: str) -> None:
    """Draw the true speed and the reference; the reference has a label only in a single run."""
    widths = (1.4, 0.8) if name else (2.0, 1.2)
    line: dict[str, Any] = {'color': color, 'lw': widths[0], 'marker': _marker(log)}
    axes.plot(log.distance, log.speed, label=name or 'speed', **line)
    if not np.all(np.isnan(log.reference)):
        line |= {'color': INK, 'lw': widths[1], 'ls': DASHES}
        axes.plot(log.distance, log.reference, label='' if name else 'reference', **line)


def _has_error(log: Log) -> bool:
    """Return whether there is a speed error after the run-up."""
    return bool(np.isfinite(log.speed_error[log.distance >= metrics.RUN_UP]).any())


def _add_details(log: Log, speed: Axes, grade: Axes, command: Axes) -> None:
    """Add the details of a single run: measured speed, ground and missed deadlines."""
    if np.nan_to_num(log.e_v_x).any():  # NaN between two laps
        speed.plot(
            log.distance, log.v_x, color=SKY, alpha=0.6, lw=0.8, label='measured', zorder=1.9
        )
    if np.min(log.speed) < 0.0:
        speed.axhline(0.0, color=GREY, lw=0.8)
    if _has_error(log):
        speed.set_ylim(*speed_limits(log))
    grade.fill_between(log.distance, log.theta_deg, step='post', color=EARTH)
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
    jumps = np.hypot(np.diff(log.distance), np.diff(log.across)) > JUMP
    speed = (_without_jumps(log.speed, jumps), BLUE, 'Speed [m/s]')
    if np.nan_to_num(log.servo).any():
        degrees = np.degrees(np.unwrap(np.nan_to_num(log.psi - log.e_epsi)))
        heading = (_without_jumps(degrees, jumps), INK, 'Heading [°]')
        drawn = [heading, speed, (np.degrees(log.servo), GREEN, 'Steering [°]')]
        top, *charts = figure.subplots(4, 1, height_ratios=[4.0, 1.4, 1.4, 1.4])
        draw_path(top, *(_without_jumps(values, jumps) for values in (log.distance, log.across)))
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
