"""The graph as a record and a table."""

from __future__ import annotations

from pathlib import Path

import barc_sim
from barc_sim.bags.node_graph import NodeGraph, table

GRAPH = NodeGraph(
    nodes=('/car2/controller', '/rviz'),
    topics={'/car2/ecu': 'barc_interfaces/msg/ECU'},
    publications=(('/car2/controller', '/car2/ecu'),),
    subscriptions=(('/car2/ecu', '/rviz'),),
)


def test_table_tells_source_and_purpose_of_our_own_nodes() -> None:
    ours, foreign = table(GRAPH)
    assert ours.name == '/car2/controller'
    assert ours.source == 'barc_sim/nodes/controller.py'
    assert ours.purpose.startswith('holds the speed')
    assert foreign == ('/rviz', '', '')


def test_every_node_of_the_package_is_in_the_table() -> None:
    package = Path(barc_sim.__file__).parent
    modules = (*package.glob('nodes/[a-z]*.py'), *package.glob('nodes/*/node.py'))
    sources = {str(path.relative_to(package.parent)) for path in modules}
    drive = ('vehicle_simulator', 'controller', 'relay', 'keyboard')
    names = (*drive, 'bag_recorder', 'view', 'mirror', 'foxglove')
    rows = table(NodeGraph(tuple(f'/{name}' for name in names), {}, (), ()))
    assert {row.source for row in rows} - {''} == sources
    assert all(row.purpose for row in rows if row.source)
