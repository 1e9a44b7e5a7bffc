"""Draws the graph of nodes and topics: a column for each node, and a row for each topic.

In a topic's row, arrows point from the nodes that publish it to the nodes that subscribe to it. So
no arrow crosses another; a closed loop has one arrow to the right and a blue one to the left.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, FancyBboxPatch

from barc_sim.errors import escaped
from barc_sim.figures import files
from barc_sim.figures.style import BLUE, GREY, INK, MUTED, STYLE
from barc_sim.interfaces.nodes import NODES
from barc_sim.interfaces.topics import EVERYONES

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

    from barc_sim.bags.graph import NodeGraph

# All in inches.
CHARACTER = 0.088
ROW, GAP, MARGIN = 0.4, 0.35, 0.3
LINE = 0.24
NODE_FILL, TOPIC_FILL, GUIDE = '#E3F0F8', '#F4F4F4', '#DDDDDD'
_DPI, _MAX_PIXELS = 110.0, 16_000.0


@style.context(STYLE)
def graph_figure(graph: NodeGraph, title: str = '', figure: Figure | None = None) -> Figure:
    """Draw the graph, and a table of its nodes below; set the size of `figure`."""
    topics = [topic for topic in graph.topics if topic not in EVERYONES]
    sources = {topic: [node for node, to in graph.publications if to == topic] for topic in topics}
    targets = {topic: [node for of, node in graph.subscriptions if of == topic] for topic in topics}
    # The node with most subscribers is on the left.
    nodes = sorted(
        graph.nodes, key=lambda node: -sum(len(targets[t]) for t in topics if node in sources[t])
    )
    topics.sort(key=lambda topic: min(map(nodes.index, sources[topic]), default=len(nodes)))
    half = np.array([0.12 + 0.55 * CHARACTER * len(node) for node in nodes])
    left = MARGIN + 0.24 + CHARACTER * max(map(len, topics), default=0)
    right = left + np.cumsum(GAP + 2.0 * half)
    x = dict(zip(nodes, (right - half).tolist(), strict=True))
    omitted = f'not drawn, because every node publishes them: {", ".join(EVERYONES)}'
    table = [*lines(graph), '', omitted]
    bottom = -ROW * (len(topics) + 1.0)
    low, high = bottom - LINE * (len(table) + 0.5), 0.9
    width = max(right.max(initial=left), MARGIN + CHARACTER * max(map(len, table)))

    figure = figure or Figure()
    figure.set_size_inches(width + MARGIN, high - low)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, width + MARGIN), ylim=(low, high))
    axes.set_axis_off()
    axes.text(MARGIN, 0.5, title, fontsize=12, fontweight='bold')
    for node, radius in zip(nodes, half, strict=True):
        axes.plot([x[node]] * 2, [0.0, bottom], color=GREY, lw=0.8, ls=(0.0, (1.0, 3.0)))
        axes.add_patch(
            Ellipse((x[node], 0.0), 2.0 * radius, 0.48, fc=NODE_FILL, ec=BLUE, lw=1.4, zorder=2)
        )
        axes.text(x[node], 0.0, escaped(node), ha='center', va='center', fontsize=9.5)
    for k, topic in enumerate(topics, start=1):
        ends = ([x[node] for node in links[topic] if node in x] for links in (sources, targets))
        _draw_topic(axes, topic, (left, -ROW * (k + 0.25)), *ends)
    for k, row in enumerate(table, start=1):
        color = INK if k > 1 else MUTED
        axes.text(
            MARGIN, bottom - LINE * k, escaped(row), family='monospace', fontsize=9, color=color
        )
    return figure


def _draw_topic(
    axes: Axes, topic: str, at: tuple[float, float], sources: list[float], targets: list[float]
) -> None:
    """Draw a topic's box, with its right end at `at`, and an arrow to each target."""
    (right, y), width = at, CHARACTER * len(topic) + 0.24
    box = FancyBboxPatch(
        (right - width + 0.04, y - 0.1), width - 0.08, 0.2, boxstyle='round,pad=0.04',
        fc=TOPIC_FILL, ec=GREY,
    )  # fmt: skip
    axes.add_patch(box)
    axes.text(right - width / 2.0, y, escaped(topic), ha='center', va='center', fontsize=9.5)
    axes.plot([right, max(sources, default=right)], [y, y], color=GUIDE, lw=0.8, zorder=1)
    axes.plot(sources, [y] * len(sources), 'o', ms=5.0, color=INK)
    ahead: list[tuple[float, float, float]] = []
    back: list[tuple[float, float, float]] = []
    for target in targets:
        others = [each for each in sources if each != target] or [right]
        nearest = min(others, key=lambda each: abs(each - target))
        (ahead if target > nearest else back).append((nearest, target, np.nan))
    for arrows, color, head, shift in ((ahead, MUTED, '>', -0.05), (back, BLUE, '<', 0.05)):
        axes.plot(np.ravel(arrows), np.full(3 * len(arrows), y), color=color, lw=1.2)
        tips = [target + shift for _, target, _ in arrows]
        axes.plot(tips, [y] * len(tips), head, color=color, ms=5.0)


def lines(graph: NodeGraph) -> list[str]:
    """Return the table of nodes as lines of text, with a heading."""
    rows = {'node': 'what it does'}
    for name in graph.nodes:
        description = NODES.get(name.rpartition('/')[2])
        rows[name] = description.purpose if description else '(not of this package)'
    width = max(map(len, rows))
    return [f'{name:{width}}  {purpose}' for name, purpose in rows.items()]


def save(figure: Figure, path: Path) -> None:
    """Save to a file in the format of its extension; text remains searchable text."""
    settings = {'svg.fonttype': 'none', 'pdf.fonttype': 42}
    dpi = min(_DPI, _MAX_PIXELS / max(figure.get_size_inches()))
    files.save(figure, path, settings, dpi=dpi)
