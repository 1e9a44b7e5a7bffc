"""The figures of a report, as SVG."""

from __future__ import annotations

import io
import warnings
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context, style
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from barc_sim.figures.graph_figure import GraphDrawing
from barc_sim.figures.run_figures import speed_figure
from barc_sim.figures.style import BLUE, DASHES, GREEN, GREY, INK, LOOK, VERMILLION, limits

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barc_sim.bags.node_graph import NodeGraph
    from barc_sim.simulation.log import Log

_SIZE = (9.6, 3.6)  #: [inch]


def speed(log: Log) -> str:
    """Return speed, grade and command over the position."""
    with _as_written():
        return _svg(speed_figure(log))


def terms(log: Log) -> str | None:
    """Return the controller's terms over the position; None where they are not known."""
    names = ('proportional', 'integral', 'derivative')
    if all(np.isnan(getattr(log, name)).all() for name in names):
        return None
    with _as_written():
        figure = Figure(figsize=_SIZE, layout='constrained')
        axes = figure.subplots()
        axes.step(
            log.distance, log.motor, where='post', color=INK, lw=1.0, ls=DASHES, label='command'
        )
        for name, color in zip(names, (BLUE, GREEN, VERMILLION), strict=True):
            axes.step(
                log.distance, getattr(log, name), where='post', color=color, lw=1.4, label=name
            )
        # The first moments, at full throttle, would leave nothing to see of the rest.
        low, high = limits(log.motor, share=0.5, least=1.0)
        axes.set(xlim=limits(log.distance, share=0.01, least=0.5), ylim=(low, high))
        axes.axhline(0.0, color=GREY, lw=0.8)
        axes.set_xlabel('Position along the road [m]')
        axes.set_ylabel('Acceleration [m/s²]')
        axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
        axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.0)
        return _svg(figure)


def path(log: Log) -> str | None:
    """Return the car's way from above; None where it went straight on."""
    if not np.any(np.abs(log.across) > 0.01):  # noqa: PLR2004 ([m]: less is not to be seen)
        return None
    with _as_written():
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
    with _as_written():
        figure = Figure(figsize=drawing.size)
        drawing.draw(figure)
        return _svg(figure)


@contextmanager
def _as_written() -> Iterator[None]:
    """Draw the same each time, whatever a bag has in it."""
    with warnings.catch_warnings(), style.context(LOOK):
        warnings.simplefilter('ignore')  # characters that the font has not
        with rc_context({'svg.hashsalt': 'barc_sim'}):
            yield


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format='svg', metadata={'Date': None})
    return text.getvalue()
