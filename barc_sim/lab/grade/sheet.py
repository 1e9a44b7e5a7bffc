"""A grade as a sheet of A4 to print: the criteria, and the submission's runs as figures."""

from __future__ import annotations

import io
import textwrap
import threading
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import font_manager, style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from barc_sim.figures.style import (
    BLUE,
    DASHES,
    EARTH,
    GREEN,
    GREY,
    INK,
    MUTED,
    STYLE,
    VERMILLION,
)
from barc_sim.lab.check.findings import LABELS, Comparison, Trajectory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from barc_sim.lab.grade.grade import Grade, Item

SIZE = (8.27, 11.69)  #: [inch] A4
DPI = 150
_LEFT, _RIGHT = 0.08, 0.93  # of the page's width
_BARS = (0.32, 0.42)
_TEXT = 0.515
_TOP, _BOTTOM = 0.9, 0.46  # of the page's height: the criteria
_MESSAGE = 66  # characters in a line of a message
_LINES = 3  # of a message, where there are not more rows than these
_ROWS = 16
_FIGURES = 2  # the first ones with evidence
_EXPECTED: dict[str, Any] = {'color': INK, 'lw': 1.2, 'ls': DASHES}
# Matplotlib's settings are global, and several threads can draw.
_DRAWING = threading.Lock()


def draw(grade: Grade) -> tuple[bytes, bytes]:
    """Return two PNGs: the sheet, and its figures alone, which are empty if there are none."""
    drawn = [item for item in grade.items if item.evidence is not None][:_FIGURES]
    with _DRAWING, style.context(STYLE):
        figure = Figure(figsize=SIZE, dpi=DPI)
        canvas: Any = FigureCanvasAgg(figure)
        _draw_heading(figure, grade)
        _draw_items(figure, grade.items)
        _draw_runs(figure, drawn)
        canvas.draw()
        page = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    cut = page.crop((0, round(page.height * (1.0 - _BOTTOM)), page.width, page.height))
    return _png(page), _png(cut) if drawn else b''


def _draw_heading(figure: Figure, grade: Grade) -> None:
    score = f'{grade.score:g} / {grade.max_score:g}'
    _text(figure, _LEFT, 0.955, grade.name, width=44, size=20, weight='bold', va='baseline')
    _text(figure, _RIGHT, 0.955, score, size=20, weight='bold', ha='right', va='baseline')
    _text(figure, _LEFT, 0.933, grade.title, width=90, color=MUTED, size=11)
    if grade.notes:
        _text(figure, _LEFT, 0.912, '; '.join(grade.notes), width=110, color=VERMILLION, size=9)


def _draw_items(figure: Figure, items: tuple[Item, ...]) -> None:
    """Draw a row for each criterion: its name, a bar, its points and the message."""
    axes = figure.add_axes((0.0, _BOTTOM, 1.0, _TOP - _BOTTOM))
    axes.set(xlim=(0.0, 1.0), ylim=(len(items) - 0.4, -0.6))
    axes.axis('off')
    most = _LINES if len(items) <= _ROWS else _LINES - 1
    for row, item in enumerate(items):
        _draw_bar(axes, row, item.points / item.max_points)
        points = f'{item.points:g} / {item.max_points:g}'
        lines = textwrap.wrap(item.message, _MESSAGE, max_lines=most, placeholder=' …')
        _text(axes, _LEFT, row, LABELS[item.criterion], size=9)
        _text(axes, _BARS[1] + 0.078, row, points, size=9, ha='right')
        _text(axes, _TEXT, row, '\n'.join(lines), size=7, color=MUTED, linespacing=1.0)


def _draw_bar(axes: Axes, row: int, share: float) -> None:
    left, right = _BARS
    axes.barh(row, right - left, left=left, height=0.26, color='#EDEDED')
    axes.barh(row, share * (right - left), left=left, height=0.26, color=GREEN)
    axes.axhline(row + 0.5, _LEFT, _RIGHT, color=GREY, lw=0.3)


def _draw_runs(figure: Figure, items: Sequence[Item]) -> None:
    """Draw the items' figures below each other."""
    height = (_BOTTOM - 0.01) / _FIGURES
    for row, item in enumerate(items):
        bottom = _BOTTOM - (row + 1) * height + 0.045
        axes = figure.add_axes((_LEFT, bottom, _RIGHT - _LEFT, height - 0.075))
        if isinstance(item.evidence, Trajectory):
            _draw_trajectory(axes, item.evidence)
        elif isinstance(item.evidence, Comparison):
            _draw_comparison(axes, item.evidence)
        axes.set_title(LABELS[item.criterion], loc='left', fontsize=10, fontweight='bold', pad=5)
        axes.legend(
            loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=4, fontsize=8, borderpad=0.2
        )
        axes.tick_params(labelsize=8)
        axes.xaxis.label.set_fontsize(9)
        axes.yaxis.label.set_fontsize(9)


def _draw_trajectory(axes: Axes, drives: Trajectory) -> None:
    axes.plot(*drives.user[:, :2].T, color=BLUE, lw=2.0, label='submission')
    axes.plot(*drives.reference[:, :2].T, label='expected', **_EXPECTED)
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
    axes.plot(reference.distance, reference.speed, label="barc_sim's PID", **_EXPECTED)
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


def _text(on: Figure | Axes, x: float, y: float, text: str, width: int = 0, **look: Any) -> None:  # noqa: ANN401 (Matplotlib's)
    """Write any text: dollars stay dollars, and characters that the font lacks are replaced."""
    text = textwrap.shorten(text, width, placeholder=' …') if width else text
    known = _characters()
    text = ''.join(c if c == '\n' or ord(c) in known else '\N{REPLACEMENT CHARACTER}' for c in text)
    on.text(
        x, y, text, parse_math=False, **{'color': INK, 'va': 'center', 'linespacing': 1.2, **look}
    )


@cache
def _characters() -> frozenset[int]:
    """Return the characters that the page's font has."""
    return frozenset(font_manager.get_font(font_manager.findfont('DejaVu Sans')).get_charmap())


def _png(image: Image.Image) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, 'png', dpi=(DPI, DPI))
    return buffer.getvalue()
