"""The graph with the purposes of its nodes."""

from __future__ import annotations

import json

import pytest
from made_bags import GRAPH

from barc_sim.bags.names import NODES, NodeGraph, purposes


def test_our_own_nodes_have_a_purpose() -> None:
    graph = NodeGraph(('/car2/controller', '/rviz'), {}, (), ())
    ours, foreign = purposes(graph)
    assert ours == ('/car2/controller', NODES['controller'])
    assert foreign == ('/rviz', '')


def test_the_users_relay_is_named_as_a_function_and_as_a_node_of_its_own() -> None:
    code = {'relay': 'mine.py'}
    graph = NodeGraph(('/controller', '/relay', '/rviz'), {}, (), (), code)
    about = dict(purposes(NodeGraph.from_json(graph.to_json())))
    assert about == {
        '/controller': NODES['controller'],
        '/relay': f'{NODES["relay"]}; code: mine.py',
        '/rviz': '',
    }
    links = (('/keys', '/cmd_vel'), ('/own', '/ecu'))
    graph = NodeGraph(('/keys', '/own'), {}, links, (), code)
    assert purposes(graph) == [('/keys', ''), ('/own', 'code: mine.py')]


@pytest.mark.parametrize(
    'text', ['9' * 100_000, '{"nodes": [1]}', json.dumps(json.loads(GRAPH) | {'topics': {}})]
)
def test_what_is_no_graph_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r'\w'):
        NodeGraph.from_json(text)
