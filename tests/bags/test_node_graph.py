"""The graph with the purposes of its nodes."""

from __future__ import annotations

from barc_sim.bags.names import NODES
from barc_sim.bags.node_graph import NodeGraph, purposes


def test_our_own_nodes_have_a_purpose() -> None:
    graph = NodeGraph(('/car2/controller', '/rviz'), {}, (), ())
    ours, foreign = purposes(graph)
    assert ours == ('/car2/controller', NODES['controller'])
    assert foreign == ('/rviz', '')
