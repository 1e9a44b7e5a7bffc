"""Draws the graph of nodes and topics: a column for each node, and a row for each topic.

In a topic's row, arrows point from the nodes that publish it to the nodes that subscribe to it. So
no arrow crosses another; a closed loop has one arrow to the right and a blue one to the left.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, FancyBboxPatch

from barc_sim.errors import escaped
from barc_sim.figures import files
from barc_sim.figures.colours import (
    BLUE,
    GREY,
    INK,
    MUTED,
    STYLE,
)
from barc_sim.interfaces.nodes import NODES
from barc_sim.interfaces.topics import EVERYONES

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from matplotlib.axes import Axes

    from barc_sim.bags.graph import NodeGraph

CHARACTER = 0.088  #: [inch] the width of a character
ROW = 0.4  #: [inch] between two topics
GAP = 0.35  #: [inch] between two nodes
MARGIN = 0.3  #: [inch]
LINE = 0.24  #: [inch] between two lines of the table
NODE_FILL = '#E3F0F8'
TOPIC_FILL = '#F4F4F4'
GUIDE = '#DDDDDD'
_DPI = 110.0
_MAX_PIXELS = 16_000.0


class _Grid(NamedTuple):
    """What is drawn, and where; places in inches, from the nodes' row to the right and down."""

    nodes: dict[str, float]  #: place of the middle of each, from left to right
    half_widths: dict[str, float]  #: of each node
    topics: list[str]  #: from top to bottom
    left: float  #: where the boxes of the topics end
    right: float  #: where the last node ends

    @property
    def bottom(self) -> float:
        """The place below the last topic."""
        return -ROW * (len(self.topics) + 1.0)


class _Ends(NamedTuple):
    """The nodes at both ends of a topic's arrows."""

    sources: list[str]
    targets: list[str]


@style.context(STYLE)
def graph_figure(graph: NodeGraph, title: str = '', figure: Figure | None = None) -> Figure:
    """Draw the graph, and a table of its nodes below.

    Parameters
    ----------
    graph
        The nodes and topics; those topics that every node publishes are left out.
    title
        The heading.
    figure
        The empty figure to draw on, whose size is set; by default a new one.
    """
    ends = {topic: _ends_of(graph, topic) for topic in graph.topics if topic not in EVERYONES}
    grid = _arrange(graph, ends)
    omitted = f'not drawn, because every node publishes them: {", ".join(EVERYONES)}'
    table = [*lines(graph), '', omitted]
    table_width = MARGIN + CHARACTER * max(map(len, table))
    low = grid.bottom - LINE * (len(table) + 0.5)
    high = 0.9
    width = max(grid.right, table_width) + MARGIN

    figure = figure or Figure()
    figure.set_size_inches(width, high - low)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, width), ylim=(low, high))
    axes.set_axis_off()
    axes.text(MARGIN, 0.5, title, fontsize=12, fontweight='bold')

    for node in grid.nodes:
        _draw_node(axes, grid, node)
    for row, topic in enumerate(grid.topics, start=1):
        _draw_topic(axes, grid, topic, -ROW * (row + 0.25), ends[topic])
    for row, text in enumerate(table, start=1):
        axes.text(
            MARGIN,
            grid.bottom - LINE * row,
            escaped(text),
            family='monospace',
            fontsize=9,
            color=INK if row > 1 else MUTED,
        )
    return figure


def _ends_of(graph: NodeGraph, topic: str) -> _Ends:
    return _Ends(
        sources=[node for node, published in graph.publications if published == topic],
        targets=[node for subscribed, node in graph.subscriptions if subscribed == topic],
    )


def _arrange(graph: NodeGraph, ends: Mapping[str, _Ends]) -> _Grid:
    """Order and place nodes and topics, so that most arrows point to the right and down."""

    def count_subscribers(node: str) -> int:
        return sum(len(of_topic.targets) for of_topic in ends.values() if node in of_topic.sources)

    nodes = sorted(graph.nodes, key=count_subscribers, reverse=True)
    column = {node: index for index, node in enumerate(nodes)}

    def first_column(topic: str) -> int:
        return min((column[node] for node in ends[topic].sources), default=len(nodes))

    topics = sorted(ends, key=first_column)
    left = MARGIN + 0.24 + CHARACTER * max(map(len, topics), default=0)

    half = np.array([0.12 + 0.55 * CHARACTER * len(node) for node in nodes])
    right_ends = left + np.cumsum(GAP + 2.0 * half)
    return _Grid(
        nodes=dict(zip(nodes, (right_ends - half).tolist(), strict=True)),
        half_widths=dict(zip(nodes, half.tolist(), strict=True)),
        topics=topics,
        left=left,
        right=float(right_ends.max(initial=left)),
    )


def _draw_node(axes: Axes, grid: _Grid, node: str) -> None:
    """Draw a node at the top of its column, and the line of the column."""
    x = grid.nodes[node]
    axes.plot([x, x], [0.0, grid.bottom], color=GREY, lw=0.8, ls=(0.0, (1.0, 3.0)))
    width = 2.0 * grid.half_widths[node]
    axes.add_patch(Ellipse((x, 0.0), width, 0.48, fc=NODE_FILL, ec=BLUE, lw=1.4, zorder=2))
    axes.text(x, 0.0, escaped(node), ha='center', va='center', fontsize=9.5)


def _draw_topic(axes: Axes, grid: _Grid, topic: str, y: float, ends: _Ends) -> None:
    """Draw a topic's box, and an arrow to each target in its row, at the height `y`."""
    sources = [grid.nodes[node] for node in ends.sources if node in grid.nodes]
    targets = [grid.nodes[node] for node in ends.targets if node in grid.nodes]
    right = grid.left
    width = CHARACTER * len(topic) + 0.24
    box = FancyBboxPatch(
        (right - width + 0.04, y - 0.1),
        width - 0.08,
        0.2,
        boxstyle='round,pad=0.04',
        fc=TOPIC_FILL,
        ec=GREY,
    )
    axes.add_patch(box)
    axes.text(right - width / 2.0, y, escaped(topic), ha='center', va='center', fontsize=9.5)
    axes.plot([right, max(sources, default=right)], [y, y], color=GUIDE, lw=0.8, zorder=1)
    axes.plot(sources, [y] * len(sources), 'o', ms=5.0, color=INK)

    to_the_right: list[tuple[float, float]] = []
    to_the_left: list[tuple[float, float]] = []
    for target in targets:
        others = [source for source in sources if source != target] or [right]
        nearest = min(others, key=lambda source: abs(source - target))
        if target > nearest:
            to_the_right.append((nearest, target))
        else:
            to_the_left.append((nearest, target))
    _draw_arrows(axes, to_the_right, y, color=MUTED, head='>', shift=-0.05)
    _draw_arrows(axes, to_the_left, y, color=BLUE, head='<', shift=0.05)


def _draw_arrows(
    axes: Axes, ends: list[tuple[float, float]], y: float, *, color: str, head: str, shift: float
) -> None:
    """Draw arrows as one broken line; each head is `shift` from the end."""
    x = [place for start, end in ends for place in (start, end, np.nan)]
    axes.plot(x, [y] * len(x), color=color, lw=1.2)
    tips = [end + shift for _, end in ends]
    axes.plot(tips, [y] * len(tips), head, color=color, ms=5.0)


def lines(graph: NodeGraph) -> list[str]:
    """Return the table of nodes as lines of text, with a heading."""
    rows = {'node': 'what it does'}
    for name in graph.nodes:
        _, _, base = name.rpartition('/')
        description = NODES.get(base)
        rows[name] = description.purpose if description else '(not of this package)'
    width = max(map(len, rows))
    return [f'{name:{width}}  {purpose}' for name, purpose in rows.items()]


def save(figure: Figure, path: Path) -> None:
    """Save to a file in the format of its extension; text remains searchable text."""
    settings = {'svg.fonttype': 'none', 'pdf.fonttype': 42}
    dpi = min(_DPI, _MAX_PIXELS / max(figure.get_size_inches()))
    files.save(figure, path, settings, dpi=dpi)
