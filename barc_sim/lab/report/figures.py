"""The figures of a report, as SVG."""

from __future__ import annotations

import io
import warnings
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context, style
from matplotlib.figure import Figure

from barc_sim.figures.drive_figure import drive_figure
from barc_sim.figures.graph_figure import GraphDrawing
from barc_sim.figures.run_figures import speed_figure, terms_figure
from barc_sim.figures.style import BLUE, INK, STYLE, VERMILLION

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barc_sim.bags.node_graph import NodeGraph
    from barc_sim.simulation.log import Log


def speed(log: Log) -> str:
    """Return speed, grade and command over the position.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> '<svg' in speed(simulate())
    True
    """
    with _reproducible():
        return _svg(speed_figure(log))


def terms(log: Log) -> str | None:
    """Return the controller's terms over the position; None if they are unknown."""
    with _reproducible():
        figure = terms_figure(log)
        return None if figure is None else _svg(figure)


def drive(log: Log) -> str:
    """Return path, heading, speed and steering of a drive by hand."""
    with _reproducible():
        return _svg(drive_figure(log))


def path(log: Log) -> str | None:
    """Return the car's path from above; None if it is straight.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> path(simulate()) is None
    True
    """
    if not np.any(np.abs(log.across) > 0.01):  # noqa: PLR2004 ([m]: less is invisible)
        return None
    with _reproducible():
        figure = Figure(figsize=(9.6, 5.4), layout='constrained')
        axes = figure.subplots()
        axes.plot(log.distance, log.across, color=BLUE, lw=1.8)
        axes.plot(log.distance[:1], log.across[:1], 'o', color=INK, label='start')
        axes.plot(log.distance[-1:], log.across[-1:], 's', color=VERMILLION, label='end')
        axes.set_aspect('equal', adjustable='datalim')
        axes.set_xlabel('x [m]')
        axes.set_ylabel('y [m]')
        axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)
        return _svg(figure)


def graph(nodes: NodeGraph) -> str:
    """Return the graph of nodes and topics, and the table below it."""
    drawing = GraphDrawing(nodes)
    with _reproducible():
        figure = Figure(figsize=drawing.size)
        drawing.draw(figure)
        return _svg(figure)


@contextmanager
def _reproducible() -> Iterator[None]:
    """Draw the same figure each time, with any characters."""
    with warnings.catch_warnings(), style.context(STYLE):
        warnings.simplefilter('ignore')  # characters that the font lacks
        with rc_context({'svg.hashsalt': 'barc_sim'}):
            yield


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format='svg', metadata={'Date': None})
    return text.getvalue()
