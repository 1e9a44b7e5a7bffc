"""A graph of nodes and topics as a figure, like rqt_graph: nodes are ellipses, topics boxes.

The layout is in layers from left to right, with few crossings, after Sugiyama, Tagawa and Toda
(1981): edges that close a circle are turned around, each vertex comes one layer after the last that
leads to it, an edge over several layers gets a way point in each, and layers are put in order by
the mean place of their neighbours.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib import rc_context, style
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, FancyArrowPatch, FancyBboxPatch
from matplotlib.path import Path as Curve

from barc_sim.bags.names import EVERYONES, purposes
from barc_sim.figures.style import BLUE, GREY, INK, MUTED, STYLE

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from barc_sim.bags.names import NodeGraph

    Box = tuple[float, float]  # half of width and of height
    Vertex = Hashable  # a name, or a way point: an edge and a layer
    Edge = tuple[str, str]

# All in inches.
CHARACTER = 0.088
ROW, GAP, MARGIN = 0.62, 0.55, 0.3
LINE = 0.24
_SWEEPS = 12
NODE_FILL, TOPIC_FILL = '#E3F0F8', '#F4F4F4'


class GraphDrawing:
    """A graph ready to be drawn, with a table of its nodes below."""

    def __init__(self, graph: NodeGraph, title: str = '') -> None:
        """Compute all places."""
        self._title = title
        # Separate vertices: a node and a topic can have the same name.
        self._names = {f'node {node}': node for node in graph.nodes}
        self._names |= {f'topic {name}': name for name in graph.topics if name not in EVERYONES}
        edges = [(f'node {node}', f'topic {topic}') for node, topic in graph.publications]
        edges += [(f'topic {topic}', f'node {node}') for topic, node in graph.subscriptions]
        self._plan = layout(
            list(self._names), [edge for edge in edges if self._names.keys() >= set(edge)]
        )
        self._boxes = {vertex: _box(vertex, name) for vertex, name in self._names.items()}
        self._columns = _columns(self._plan, self._boxes)
        points = [point for route in self._plan.routes.values() for point in route]
        points += self._plan.vertices.values()
        self._lowest, highest = min(p.y for p in points), max(p.y for p in points)
        everyones = ', '.join(EVERYONES)
        self._rows = [*lines(graph), '', f'not drawn, as every node publishes them: {everyones}']
        width = max(self._columns[-1] + GAP, CHARACTER * max(map(len, self._rows)) + 2 * MARGIN)
        self._top = ROW * (highest - self._lowest + 1.0)
        self._bottom = LINE * (len(self._rows) + 0.5)
        self.size = (width, self._top + self._bottom + 2 * MARGIN)  #: [inch] width and height

    def draw(self, figure: Figure) -> None:
        """Draw on an empty `figure` of that size."""
        with style.context(STYLE):
            axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
            axes.set(xlim=(0.0, self.size[0]), ylim=(-self._bottom - MARGIN, self._top + MARGIN))
            axes.set_axis_off()
            for (source, target), route in self._plan.routes.items():
                points = np.array([self._place(point) for point in route])
                _draw_edge(axes, points, self._boxes[source], self._boxes[target])
            for vertex, name in self._names.items():
                place = self._place(self._plan.vertices[vertex])
                _draw_vertex(axes, vertex, name, place, self._boxes[vertex])
            axes.text(MARGIN, self._top + 0.08, self._title, fontsize=12, fontweight='bold')
            for k, row in enumerate(self._rows):
                y, color = -LINE * (k + 1), INK if k else MUTED
                axes.text(MARGIN, y, row, family='monospace', fontsize=9, color=color)

    def save(self, path: Path, dpi: float = 110.0) -> None:
        """Draw into a file; its extension sets the format."""
        figure = Figure(figsize=self.size)
        self.draw(figure)
        with rc_context({'svg.fonttype': 'none', 'pdf.fonttype': 42}):  # text stays text
            figure.savefig(path, dpi=dpi)

    def _place(self, point: Point) -> tuple[float, float]:
        """Return a point of the plan in inches, the plan in the middle."""
        shift = (self.size[0] - self._columns[-1] - GAP) / 2.0
        return self._columns[point.layer] + shift, ROW * (point.y - self._lowest + 0.5)


def lines(graph: NodeGraph) -> list[str]:
    """Return the table of nodes in lines of text, the heading first."""
    rows = [('node', 'what it does'), *purposes(graph)]
    width = max(len(name) for name, _ in rows)
    return [f'{name:{width}}  {purpose or "(not of this package)"}' for name, purpose in rows]


def _box(vertex: str, name: str) -> Box:
    half = CHARACTER * len(name) / 2.0
    # An ellipse must be wider and higher than its text.
    return (1.25 * half + 0.12, 0.24) if vertex.startswith('node') else (half + 0.12, 0.16)


def _columns(plan: Layout, boxes: dict[str, Box]) -> list[float]:
    """Return the middle of each layer, and the right edge last."""
    half = [0.0] * (1 + max(point.layer for point in plan.vertices.values()))
    for vertex, point in plan.vertices.items():
        half[point.layer] = max(half[point.layer], boxes[vertex][0])
    x, columns = 0.0, []
    for width in half:
        columns.append(x + GAP + width)
        x += GAP + 2.0 * width
    return [*columns, x]


def _draw_vertex(axes: Axes, vertex: str, name: str, place: tuple[float, float], box: Box) -> None:
    if vertex.startswith('node'):
        axes.add_patch(Ellipse(place, 2 * box[0], 2 * box[1], fc=NODE_FILL, ec=BLUE, lw=1.4))
    else:
        corner = (place[0] - box[0] + 0.04, place[1] - box[1] + 0.04)
        axes.add_patch(
            FancyBboxPatch(
                corner,
                2 * box[0] - 0.08,
                2 * box[1] - 0.08,
                boxstyle='round,pad=0.04',
                fc=TOPIC_FILL,
                ec=GREY,
                lw=1.0,
            )
        )
    axes.text(place[0], place[1], name, ha='center', va='center', fontsize=9.5)


def _draw_edge(axes: Axes, points: NDArray[np.float64], source: Box, target: Box) -> None:
    """Draw an arrow through `points`, from the side of the source to that of the target."""
    way = np.sign(points[-1, 0] - points[0, 0])
    points = points.copy()
    points[0, 0] += way * source[0]
    points[-1, 0] -= way * target[0]
    axes.add_patch(
        FancyArrowPatch(
            path=_curve(points),
            arrowstyle='-|>,head_length=5,head_width=2.5',
            color=MUTED if way > 0.0 else BLUE,  # blue: backwards
            lw=0.9,
            shrinkA=0.0,
            shrinkB=0.0,
        )
    )


def _curve(points: NDArray[np.float64]) -> Curve:
    """Return curves that are horizontal at each of `points`."""
    vertices, codes = [points[0]], [Curve.MOVETO]
    for a, b in pairwise(points):
        middle = (a[0] + b[0]) / 2.0
        vertices += [np.array([middle, a[1]]), np.array([middle, b[1]]), b]
        codes += [Curve.CURVE4] * 3
    return Curve(np.array(vertices), codes)


class Point(NamedTuple):
    """A place in the drawing."""

    layer: int  #: from 0
    y: float  #: upwards; vertices are at least 1 apart


class Layout(NamedTuple):
    """The places of all vertices and edges."""

    vertices: dict[str, Point]
    routes: dict[Edge, list[Point]]  #: from an edge's source to its target, both included


def layout(vertices: Sequence[str], edges: Sequence[Edge], way_gap: float = 0.4) -> Layout:
    """Return a layout of `edges` between `vertices`; circles are entered where these come first.

    `way_gap` is the distance that a way point keeps, where vertices keep 1.
    """
    forward = _without_circles(vertices, edges)
    layer = _layers(vertices, list(forward))
    chains: dict[Edge, list[Vertex]] = {
        (a, b): [a, *(((a, b), k) for k in range(layer[a] + 1, layer[b])), b] for a, b in forward
    }
    columns: dict[int, list[Vertex]] = defaultdict(list)
    for vertex in vertices:
        columns[layer[vertex]].append(vertex)
    for edge, chain in chains.items():
        for k, way_point in enumerate(chain[1:-1], start=layer[edge[0]] + 1):
            columns[k].append(way_point)
    y = _heights([columns[k] for k in sorted(columns)], chains, set(vertices), way_gap)

    routes = {}
    for edge in edges:
        a, b = edge
        chain = chains[edge] if edge in chains else chains[b, a][::-1]
        first, way = (layer[a], 1) if layer[a] < layer[b] else (layer[a], -1)
        routes[edge] = [Point(first + way * k, y[vertex]) for k, vertex in enumerate(chain)]
    return Layout({vertex: Point(layer[vertex], y[vertex]) for vertex in vertices}, routes)


def _without_circles(vertices: Sequence[str], edges: Sequence[Edge]) -> dict[Edge, None]:
    """Return the edges, in order and each once; those that close a cycle are reversed."""
    following: dict[str, list[str]] = defaultdict(list)
    for a, b in edges:
        following[a].append(b)
    sources = [vertex for vertex in vertices if vertex not in {b for _, b in edges}]
    done: set[str] = set()
    forward: dict[Edge, None] = {}

    def visit(vertex: str, path: tuple[str, ...]) -> None:
        done.add(vertex)
        for other in following[vertex]:
            forward[(other, vertex) if other in path else (vertex, other)] = None
            if other not in done:
                visit(other, (*path, other))

    for vertex in (*sources, *vertices):
        if vertex not in done:
            visit(vertex, (vertex,))
    return forward


def _layers(vertices: Sequence[str], edges: Sequence[Edge]) -> dict[str, int]:
    layer = dict.fromkeys(vertices, 0)
    for _ in vertices:  # no path is longer
        for a, b in edges:
            layer[b] = max(layer[b], layer[a] + 1)
    return layer


def _heights(
    columns: list[list[Vertex]],
    chains: Mapping[Edge, list[Vertex]],
    vertices: set[str],
    way_gap: float,
) -> dict[Vertex, float]:
    neighbours: dict[Vertex, list[Vertex]] = defaultdict(list)
    for chain in chains.values():
        for a, b in pairwise(chain):
            neighbours[a].append(b)
            neighbours[b].append(a)
    y: dict[Vertex, float] = {}
    for column in columns:
        y.update((vertex, float(-k)) for k, vertex in enumerate(column))
    for sweep in range(_SWEEPS):
        for column in columns if sweep % 2 else reversed(columns):
            wanted = {
                vertex: sum(y[other] for other in neighbours[vertex]) / len(neighbours[vertex])
                if neighbours[vertex]
                else y[vertex]
                for vertex in column
            }
            column.sort(key=lambda vertex, wanted=wanted: -wanted[vertex])  # type: ignore[misc]
            y.update(_spread(column, wanted, vertices, way_gap))
    return y


def _spread(
    column: list[Vertex], wanted: Mapping[Vertex, float], vertices: set[str], way_gap: float
) -> dict[Vertex, float]:
    """Return the places from top to bottom, far enough apart, around the wanted mean."""
    room = {vertex: 1.0 if vertex in vertices else way_gap for vertex in column}
    places: dict[Vertex, float] = {}
    for above, vertex in pairwise([None, *column]):
        places[vertex] = wanted[vertex]
        if above is not None:
            gap = (room[above] + room[vertex]) / 2.0
            places[vertex] = min(places[vertex], places[above] - gap)
    shift = sum(wanted[vertex] - places[vertex] for vertex in column) / len(column)
    return {vertex: place + shift for vertex, place in places.items()}
