"""Lays out a directed graph: its vertices in layers from left to right, with few crossings.

After Sugiyama, Tagawa and Toda (1981): edges that close a circle are turned around, each vertex
comes one layer after the last that leads to it, an edge over several layers gets a way point in
each, and layers are put in order by the mean place of their neighbours.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping, Sequence

    Vertex = Hashable  # a name, or a way point: an edge and a layer
    Edge = tuple[str, str]

_SWEEPS = 12


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

    Examples
    --------
    >>> edges = [('controller', 'ecu'), ('ecu', 'simulator')]
    >>> places = layout(['controller', 'ecu', 'simulator'], edges).vertices
    >>> places['controller'].layer, places['ecu'].layer, places['simulator'].layer
    (0, 1, 2)
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
