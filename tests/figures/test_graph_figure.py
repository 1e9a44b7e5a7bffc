"""Where the vertices of a graph go: layers, circles, ways around, and order."""

from __future__ import annotations

from itertools import combinations, pairwise

from barc_sim.figures.graph_figure import layout

LOOP = [('sim', 'state'), ('state', 'pid'), ('pid', 'ecu'), ('ecu', 'sim')]


def test_each_vertex_comes_after_what_leads_to_it() -> None:
    plan = layout(['c', 'b', 'a'], [('a', 'b'), ('b', 'c'), ('a', 'c')])
    assert {vertex: point.layer for vertex, point in plan.vertices.items()} == {
        'a': 0,
        'b': 1,
        'c': 2,
    }


def test_a_circle_is_entered_at_the_first_vertex_and_goes_back_once() -> None:
    plan = layout(['sim', 'pid', 'state', 'ecu'], LOOP)
    assert [plan.vertices[v].layer for v in ('sim', 'state', 'pid', 'ecu')] == [0, 1, 2, 3]
    back = plan.routes['ecu', 'sim']
    assert [point.layer for point in back] == [3, 2, 1, 0]
    assert (back[0], back[-1]) == (plan.vertices['ecu'], plan.vertices['sim'])


def test_an_edge_over_several_layers_keeps_clear_of_the_vertices_between() -> None:
    plan = layout(['a', 'b', 'c'], [('a', 'b'), ('b', 'c'), ('a', 'c')])
    route = plan.routes['a', 'c']
    assert [point.layer for point in route] == [0, 1, 2]
    assert abs(route[1].y - plan.vertices['b'].y) > 0.5


def test_vertices_of_a_layer_are_apart() -> None:
    names = [f't{k}' for k in range(9)]
    edges = [('a', name) for name in names] + [(name, 'b') for name in names]
    plan = layout(['a', 'b', *names], edges)
    for one, other in combinations(names, 2):
        assert abs(plan.vertices[one].y - plan.vertices[other].y) >= 1.0 - 1e-9


def test_pairs_side_by_side_do_not_cross() -> None:
    edges = [('a', 'x'), ('b', 'y'), ('c', 'z')]
    plan = layout(['a', 'b', 'c', 'z', 'y', 'x'], edges)
    order = sorted(edges, key=lambda edge: plan.vertices[edge[0]].y)
    heights = [plan.vertices[b].y for _, b in order]
    assert all(low < high for low, high in pairwise(heights))
