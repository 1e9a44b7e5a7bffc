"""The graph of nodes and topics that a bag has."""

from __future__ import annotations

import json

import pytest
from made_bags import GRAPH

from barc_sim.bags.graph import NodeGraph


@pytest.mark.parametrize(
    'text', ['9' * 100_000, '{"nodes": [1]}', json.dumps(json.loads(GRAPH) | {'topics': {}})]
)
def test_an_invalid_graph_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r'\w'):
        NodeGraph.from_json(text)
