"""The figures of `barc tune`, a map of the cost and two runs, and of `barc identify`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import colormaps, style
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from barc_sim.figures.style import BLUE, DASHES, EARTH, INK, MUTED, STYLE, VERMILLION, limits
from barc_sim.simulation.metrics import RUN_UP

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log
    from barc_sim.tuning.identification import Identified
    from barc_sim.tuning.search import Surface

    Floats = NDArray[np.float64]
    #: Logs, each with the style of its line.
    Runs = tuple[tuple[Log, dict[str, Any]], ...]

SIZE = (11.2, 5.8)  #: [inch]
LABELS = ('kp [1/s]', 'ki [1/s²]', 'kd')
#: Colours show the logarithm of costs up to this multiple of the minimum; above it they are equal.
_WIDE = 10.0
#: [s] The step response is shown for so long after the slower run reaches the reference.
_AFTER = 1.0


class Point(NamedTuple):
    """Gains on the map, and their run over the first of the roads."""

    gains: Floats  #: shape `(3,)`: kp, ki, kd
    log: Log


@style.context(STYLE)
def tuning_figure(
    surface: Surface, start: Point, found: Point, *, cost: str, title: str = '', settings: str = ''
) -> Figure:
    """Draw the map of the cost beside the step responses and the speed errors of both points.

    `cost` is what the map shows, with its unit; `title` and `settings` are the heading's two lines.
    """
    figure = Figure(figsize=SIZE)
    figure.set_layout_engine('constrained', w_pad=0.08, h_pad=0.08)
    grid = figure.add_gridspec(2, 2, width_ratios=[1.15, 1.0])
    plane = figure.add_subplot(grid[:, 0])
    response, errors = (figure.add_subplot(grid[row, 1]) for row in (0, 1))
    _draw_map(plane, surface, start, found, cost)
    runs = (
        (start.log, {'color': VERMILLION, 'ls': DASHES, 'label': 'start'}),
        (found.log, {'color': BLUE, 'label': 'found'}),
    )
    _draw_response(response, runs)
    _draw_errors(errors, runs)
    figure.align_ylabels((response, errors))
    # The heading's second line is above the axes, the title above that.
    plane.set_title(title, loc='left', pad=26.0, fontsize=14, fontweight='bold')
    plane.annotate(settings, (0.0, 1.0), (0.0, 8.0), 'axes fraction', 'offset points', color=MUTED)
    response.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2)
    figure.supxlabel(_caption(surface, start, found), x=0.99, ha='right', fontsize=9, color=MUTED)
    return figure


def _draw_map(axes: Axes, surface: Surface, start: Point, found: Point, cost: str) -> None:
    known = np.ma.masked_invalid(surface.cost)
    # Light means a low cost; cividis looks alike to colour-blind readers.
    colours = colormaps['cividis_r'].with_extremes(bad='white')
    mesh = axes.pcolormesh(
        surface.right,
        surface.up,
        known,
        cmap=colours,
        norm=_norm(known.compressed()),
        shading='nearest',
        rasterized=True,
    )
    cut = isinstance(mesh.norm, LogNorm)
    bar = axes.figure.colorbar(
        mesh, ax=axes, label=cost, pad=0.02, extend='max' if cut else 'neither'
    )
    if cut:
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        bar.ax.yaxis.set_major_formatter('{x:g}')
        bar.ax.yaxis.set_minor_formatter(NullFormatter())
    marks: dict[str, Any] = {'ls': '', 'mec': 'white', 'mew': 1.2, 'clip_on': False, 'zorder': 3}
    for point, marker, size, colour, name in (
        (start, 'o', 9, VERMILLION, 'start'),
        (found, '*', 16, BLUE, 'found'),
    ):
        x, y = (point.gains[axis] for axis in surface.axes)
        axes.plot(x, y, marker, ms=size, color=colour, label=name, **marks)
    axes.grid(visible=False)
    axes.set(xlabel=LABELS[surface.axes[0]], xlim=(surface.right[0], surface.right[-1]))
    axes.set(ylabel=LABELS[surface.axes[1]], ylim=(surface.up[0], surface.up[-1]))
    axes.legend(loc='upper right', frameon=True, framealpha=0.85)


def _norm(values: Floats) -> Normalize:
    if values.size and values.min() > 0.0 and values.max() > _WIDE * values.min():
        return LogNorm(values.min(), _WIDE * values.min())
    return Normalize()


def _draw_response(axes: Axes, runs: Runs) -> None:
    """Draw the speeds over time, from when the faster run is about to reach the reference."""
    reference = runs[0][0].reference[0]
    reached = [float(log.t[log.speed >= reference].min(initial=log.t[-1])) for log, _ in runs]
    begin, end = min(reached), max(reached) + _AFTER
    for log, line in runs:
        axes.plot(log.t, log.speed, lw=1.6, **line)
    axes.axhline(reference, color=INK, lw=0.9, ls=(0.0, (1.0, 2.0)), label='reference')
    peak = max(float(log.speed[log.t <= end].max()) for log, _ in runs)
    axes.set(xlabel='Time [s]', ylabel='Speed [m/s]')
    axes.ticklabel_format(useOffset=False)
    if peak < reference:
        axes.set(xlim=(0.0, end), ylim=(0.0, 1.12 * reference))
    else:
        beyond = max(1.2 * (peak - reference), 0.002 * reference)
        axes.set(
            xlim=(begin - 0.1 * (end - begin), end), ylim=(reference - beyond, reference + beyond)
        )


def _draw_errors(axes: Axes, runs: Runs) -> None:
    """Draw the errors after the run-up, with the slopes shaded."""
    seen = []
    for log, line in runs:
        after = log.distance >= RUN_UP
        seen.append(log.speed_error[after])
        axes.plot(log.distance[after], seen[-1], lw=1.2, **line)
    log = max((log for log, _ in runs), key=len)
    sloping = log.theta_deg != 0.0
    axes.fill_between(
        log.distance,
        0.0,
        1.0,
        where=sloping.tolist(),
        step='post',
        color=EARTH,
        transform=axes.get_xaxis_transform(),
        zorder=0,
        lw=0.0,
    )
    axes.set(xlim=(RUN_UP, log.distance[-1]), xlabel='Position along the road [m], slopes shaded')
    axes.set(ylabel='Speed error [m/s]', ylim=limits(np.concatenate(seen), share=0.1, minimum=1e-3))


def _caption(surface: Surface, start: Point, found: Point) -> str:
    (third,) = {0, 1, 2} - set(surface.axes)
    name = LABELS[third].partition(' ')[0]
    parts = [f'Map at {name} = {found.gains[third]:g}']
    if start.gains[third] != found.gains[third]:
        parts.append(f'the start has {start.gains[third]:g}')
    if not np.isfinite(surface.cost).all():
        parts.append('white: never arrives')
    return '; '.join(parts)


SIGNALS = {'v_x': 'Speed [m/s]', 'psi_dot': 'Yaw rate [rad/s]', 'v_y': 'Lateral speed [m/s]'}


def identification_figure(found: Identified, *, title: str = '') -> Figure:
    """Draw each signal, its prediction, and the error below; logs follow one another."""
    n = len(found.signals)
    figure = Figure(figsize=(9.0, 1.2 + 3.2 * n), layout='constrained')
    figure.suptitle(title)
    panels = figure.subplots(2 * n, 1, sharex=True, height_ratios=[3.0, 1.2] * n, squeeze=False)
    for (name, (t, measured, predicted)), (above, below) in zip(
        found.signals.items(), panels[:, 0].reshape(n, 2), strict=True
    ):
        # One log follows the other, without a line from the end of the first to the next.
        steps = np.diff(t, prepend=t[0])
        begins = steps < 0.0
        time = np.cumsum(np.where(begins, np.median(steps), steps))
        line = np.where(begins, np.nan, predicted)
        above.plot(time, measured, '.', ms=2.0, color=INK, alpha=0.5, label='measured')
        above.plot(time, line, lw=1.2, color=BLUE, label='predicted from the first state')
        above.set_ylabel(SIGNALS[name])
        below.plot(time, predicted - measured, lw=0.6, color=VERMILLION)
        below.axhline(0.0, lw=0.8, color=INK)
        below.set_ylabel('Error')
    panels[0, 0].legend(loc='lower right')
    panels[-1, 0].set_xlabel('Time [s]')
    return figure
