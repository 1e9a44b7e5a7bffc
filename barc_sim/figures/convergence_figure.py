"""The figure of how errors fall with the step: one panel per test drive, both axes logarithmic."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from barc_sim.figures.style import BLUE, DASHES, EARTH, GREY, INK, MUTED, STYLE, VERMILLION
from barc_sim.simulation.convergence import ROUNDING, STEPS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from barc_sim.simulation.convergence import Study

SIZE = (11.0, 6.8)  #: [inch]
_COLUMNS = 3
_COLOURS = {'euler': VERMILLION, 'rk4': BLUE}
_NAMES = {'euler': 'forward Euler', 'rk4': 'Runge-Kutta (rk4)'}
#: Marker, whether it is filled, and its size: both models are visible if their errors are equal.
_MARKERS = {'kinematic': ('o', True, 4.5), 'dynamic': ('s', False, 8.0)}
_SLOPES = {1: 2e-3, 4: 1e-9}  # order, and error [m] at the longest step


@style.context(STYLE)
def convergence_figure(studies: Sequence[Study], *, figure: Figure | None = None) -> Figure:
    """Draw the errors of `studies`, those of a test drive next to each other.

    `figure` is an empty one to draw on, such as a window's.

    Examples
    --------
    >>> from barc_sim.simulation.convergence import studies
    >>> from barc_sim.simulation.reference_drives import REFERENCE_DRIVES
    >>> convergence_figure([*studies(REFERENCE_DRIVES[:1])]).savefig('convergence.svg')
    """
    figure = figure or Figure(figsize=SIZE)
    figure.set_layout_engine('constrained', w_pad=0.08, h_pad=0.12)
    panels = [[*group] for _, group in groupby(studies, lambda study: study.test_drive)]
    rows = -(-(len(panels) + 1) // _COLUMNS)
    grid = figure.subplots(rows, _COLUMNS, sharex=True, sharey=True, squeeze=False)
    axes = [*grid.flat]
    for panel, group in zip(axes, panels, strict=False):
        _draw(panel, group)
    for panel in axes[len(panels) :]:
        panel.set_axis_off()
    _explain(axes[-1])
    for panel in axes[: len(panels)]:
        panel.tick_params(labelbottom=True)
        panel.set_xlabel('Step [ms]')
    for row in grid:
        row[0].set_ylabel('Error [m]')
    figure.suptitle(
        'Error of the position at the end of a drive, by the length of the step',
        x=0.01,
        ha='left',
        fontsize=14,
        fontweight='bold',
    )
    return figure


def _draw(axes: Axes, studies: Sequence[Study]) -> None:
    for study in studies:
        errors = np.maximum(study.errors, np.finfo(float).tiny)
        axes.loglog(STEPS, errors, **_line(study.integrator, study.model))
    for order, error in _SLOPES.items():
        line = [error * (ts / STEPS[0]) ** order for ts in STEPS]
        axes.loglog(STEPS, line, color=GREY, lw=0.9, ls=DASHES, zorder=1)
        axes.annotate(
            f'{order}',
            (STEPS[0], error),
            (5.0, 0.0),
            'data',
            'offset points',
            color=MUTED,
            fontsize=9,
            va='center',
        )
    axes.axhspan(1e-14, ROUNDING, color=EARTH, alpha=0.6, lw=0.0, zorder=0)
    axes.set_ylim(1e-13, 1.0)
    axes.xaxis.set_major_locator(FixedLocator(STEPS))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda ts, _: f'{1e3 * ts:g}'))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_title(studies[0].test_drive, loc='left', fontsize=11, fontweight='bold', pad=18.0)
    text = axes.annotate(
        f'{studies[0].text}; against {studies[0].reference}',
        (0.0, 1.0),
        (0.0, 5.0),
        'axes fraction',
        'offset points',
        color=MUTED,
        fontsize=9,
    )
    text.set_in_layout(False)  # a long one must not move the panels apart


def _line(integrator: str, model: str) -> dict[str, Any]:
    """Return the look of a line."""
    colour, (marker, filled, size) = _COLOURS[integrator], _MARKERS[model]
    face = colour if filled else 'none'
    return {'c': colour, 'lw': 1.4, 'marker': marker, 'ms': size, 'mfc': face}


def _explain(axes: Axes) -> None:
    """Draw the legend in a panel of its own."""
    for integrator, name in _NAMES.items():
        for model in _MARKERS:
            axes.plot([], [], label=f'{name}, {model}', **_line(integrator, model))
    axes.plot([], [], color=GREY, lw=0.9, ls=DASHES, label='slopes 1 and 4')
    axes.fill_between([], [], color=EARTH, alpha=0.6, lw=0.0, label='rounding')
    axes.legend(loc='center left', labelcolor=INK, labelspacing=0.9)
