"""Saves figures so that they look the same with any matplotlibrc.

Matplotlib makes some parts, such as ticks, only when a figure is drawn, from the settings of that
time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, BinaryIO, TextIO

from barc_sim.cli.files import saving
from barc_sim.cli.parser import show
from barc_sim.figures.colours import STYLE

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from matplotlib.figure import Figure

_DPI = 150


def save(
    figure: Figure,
    file: Path | BinaryIO | TextIO,
    settings: Mapping[str, Any] | None = None,
    **options: Any,  # noqa: ANN401 (of savefig)
) -> None:
    """Save a figure with the style of our figures, and with other settings of Matplotlib."""
    from matplotlib import style  # noqa: PLC0415 (slow: not for --help)

    with style.context([*STYLE, dict(settings or {})]):
        figure.savefig(file, **options)


def save_figure(path: Path, figure: Figure) -> None:
    """Save a figure, and print where it is."""
    with saving(path) as part:
        save(figure, part, dpi=_DPI)
    show(path)
