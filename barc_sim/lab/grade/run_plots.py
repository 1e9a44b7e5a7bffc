"""Figures of a submission's runs beside the reference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.figures.style import BLUE, DASHES, EARTH, INK, VERMILLION
from barc_sim.lab.check.findings import Comparison, Trajectory
from barc_sim.lab.grade.text import label

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from barc_sim.lab.grade.grade import Item

_MOST = 2


def choose(items: Iterable[Item]) -> list[Item]:
    """Return the items to draw: the first ones with evidence."""
    return [item for item in items if item.evidence is not None][:_MOST]


def draw(figure: Figure, items: Sequence[Item], left: float, right: float, top: float) -> None:
    """Draw the items' figures below each other, in fractions of the page's width and height."""
    if not items:
        return
    height = (top - 0.01) / _MOST
    for row, item in enumerate(items):
        axes = figure.add_axes(
            (left, top - (row + 1) * height + 0.045, right - left, height - 0.075)
        )
        if isinstance(item.evidence, Trajectory):
            _draw_trajectory(axes, item.evidence)
        elif isinstance(item.evidence, Comparison):
            _draw_comparison(axes, item.evidence)
        axes.set_title(label(item.criterion), loc='left', fontsize=10, fontweight='bold', pad=5)
        axes.legend(
            loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=4, fontsize=8, borderpad=0.2
        )
        axes.tick_params(labelsize=8)
        axes.xaxis.label.set_fontsize(9)
        axes.yaxis.label.set_fontsize(9)


def _draw_trajectory(axes: Axes, drives: Trajectory) -> None:
    axes.plot(drives.user[:, 0], drives.user[:, 1], color=BLUE, lw=2.0, label='submission')
    axes.plot(
        drives.reference[:, 0],
        drives.reference[:, 1],
        color=INK,
        lw=1.2,
        ls=DASHES,
        label='expected',
    )
    _fit(axes, drives.reference[:, 1], drives.user[:, 1])
    axes.set(xlabel='x [m]', ylabel='y [m]')


def _draw_comparison(axes: Axes, runs: Comparison) -> None:
    own, reference = runs.user, runs.reference
    grade = axes.twinx()
    grade.fill_between(reference.distance, reference.theta_deg, step='post', color=EARTH)
    grade.set_ylabel('Grade [°]', fontsize=9)
    grade.tick_params(labelsize=8)
    grade.spines['right'].set_visible(False)
    grade.grid(visible=False)
    axes.set_zorder(grade.get_zorder() + 1)
    axes.patch.set_visible(False)
    axes.plot(own.distance, own.speed, color=BLUE, lw=1.8, label='submission')
    axes.plot(
        reference.distance, reference.speed, color=INK, lw=1.2, ls=DASHES, label="barc_sim's PID"
    )
    axes.plot(own.distance, own.reference, color=VERMILLION, lw=1.0, ls=':', label='set speed')
    _fit(axes, reference.speed, own.speed)
    axes.set_xlim(reference.distance[0], reference.distance[-1])
    axes.set(xlabel='Position along the road [m]', ylabel='Speed [m/s]')


def _fit(axes: Axes, expected: NDArray[np.float64], own: NDArray[np.float64]) -> None:
    """Show all expected values, and the submission's as far as those stay legible."""
    low, high = np.nanmin(expected), np.nanmax(expected)
    room = max(high - low, 1.0)
    finite = own[np.isfinite(own)]
    low = max(finite.min(initial=low), low - 2.0 * room)
    high = min(finite.max(initial=high), high + 2.0 * room)
    pad = 0.08 * (high - low)
    axes.set_ylim(low - pad, high + pad)
