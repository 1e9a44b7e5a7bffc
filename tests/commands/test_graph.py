"""The graph's command: of a running system and of a bag, in a file and as a table."""

from __future__ import annotations

import signal
import subprocess
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest

pytest.importorskip('rclpy')

from command_line import call, started
from rclpy.node import Node
from std_msgs.msg import String

from barc_sim.bags import reader as bag
from barc_sim.bags.names import NodeGraph
from barc_sim.figures.graph_figure import lines
from barc_sim.ros.peers import node_graph

if TYPE_CHECKING:
    from pathlib import Path

    from rclpy.context import Context

TELEOP = {'/vehicle_simulator', '/relay', '/bag_recorder'}
TOPICS = {'/cmd_vel', '/ecu', '/z_vhcl', '/ez_vhcl', '/environment'}


def texts(path: Path) -> set[str]:
    """Return what is written in an SVG file."""
    nodes = ET.parse(path).iter('{http://www.w3.org/2000/svg}text')
    return {''.join(node.itertext()).strip() for node in nodes}


def test_links_are_seen_as_they_are(ros: Context) -> None:
    talker, listener = Node('talker', context=ros), Node('listener', context=ros, namespace='a')
    talker.create_publisher(String, 'chatter', 10)
    talker.create_publisher(String, '_hidden', 10)
    listener.create_subscription(String, '/chatter', lambda _: None, 10)
    try:
        graph = node_graph(talker)
    finally:
        talker.destroy_node()
        listener.destroy_node()
    assert graph.nodes == ('/a/listener', '/talker')
    assert graph.topics['/chatter'] == 'std_msgs/msg/String'
    assert ('/talker', '/chatter') in graph.publications
    assert ('/chatter', '/a/listener') in graph.subscriptions
    assert '/_hidden' not in graph.topics


@pytest.mark.slow
@pytest.mark.usefixtures('ros_domain')
def test_graph_of_a_drive_by_hand_live_and_from_its_bag(tmp_path: Path) -> None:
    with started('teleop', '--view', 'none', cwd=tmp_path, stderr=subprocess.DEVNULL) as run:
        assert run.stdout
        run.stdout.readline()  # names the engine
        run.stdout.readline()  # it drives
        live = call('graph', '--save', 'live.svg', cwd=tmp_path)
        run.send_signal(signal.SIGTERM)
        run.communicate(timeout=60)
    assert live.returncode == 0, live.stderr
    (path,) = (tmp_path / 'bags').iterdir()
    recorded = call('graph', '--bag', str(path), cwd=tmp_path)
    assert recorded.stdout.splitlines()[:-1] == live.stdout.splitlines()[:-1]
    for name in ('live.svg', 'graph.svg'):
        assert texts(tmp_path / name) >= TELEOP | TOPICS
    assert '/relay              turns the driver' in live.stdout

    graph = NodeGraph.from_json(bag.info(path)['graph'])
    assert set(graph.nodes) == TELEOP
    assert set(graph.topics) >= TOPICS
    assert ('/relay', '/ecu') in graph.publications
    assert ('/ecu', '/vehicle_simulator') in graph.subscriptions
    assert ('/ecu', '/bag_recorder') in graph.subscriptions


def test_node_of_others_is_marked() -> None:
    graph = NodeGraph(('/rviz',), {}, (), ())
    assert lines(graph)[1] == '/rviz  (not of this package)'
