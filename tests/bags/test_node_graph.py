"""The graph with the purposes of its nodes."""

from __future__ import annotations

import ast
from pathlib import Path

import barc_sim
from barc_sim.bags.node_graph import PURPOSES, NodeGraph, purposes


def test_our_own_nodes_have_a_purpose() -> None:
    graph = NodeGraph(('/car2/controller', '/rviz'), {}, (), ())
    ours, foreign = purposes(graph)
    assert ours == ('/car2/controller', PURPOSES['controller'])
    assert foreign == ('/rviz', '')


def test_purposes_are_the_descriptions_of_the_node_classes() -> None:
    found = {
        statement.value.value
        for path in (Path(barc_sim.__file__).parent / 'nodes').rglob('*.py')
        for each in ast.parse(path.read_text('utf-8')).body
        if isinstance(each, ast.ClassDef)
        for statement in each.body
        if isinstance(statement, ast.Assign)
        and ast.unparse(statement.targets[0]) == 'description'
        and isinstance(statement.value, ast.Constant)
    }
    assert found <= set(PURPOSES.values())
    assert PURPOSES['controller'] in found
