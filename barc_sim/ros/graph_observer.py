"""Observes the graph of nodes and topics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.bags.node_graph import NodeGraph

if TYPE_CHECKING:
    from rclpy.node import Node


def observe(node: Node) -> NodeGraph:
    """Return the present graph of all visible nodes and topics, through `node`."""
    nodes: list[str] = []
    topics: dict[str, str] = {}
    publications: set[tuple[str, str]] = set()
    subscriptions: set[tuple[str, str]] = set()
    for name, namespace in set(node.get_node_names_and_namespaces()):
        if name.startswith('_'):
            continue
        full = f'{namespace.rstrip("/")}/{name}'
        nodes.append(full)
        for find, links in (
            (node.get_publisher_names_and_types_by_node, publications),
            (node.get_subscriber_names_and_types_by_node, subscriptions),
        ):
            for topic, types in find(name, namespace):
                if '/_' not in topic:
                    topics[topic] = types[0]
                    links.add((full, topic))
    return NodeGraph(
        nodes=tuple(sorted(nodes)),
        topics=dict(sorted(topics.items())),
        publications=tuple(sorted(publications)),
        subscriptions=tuple(sorted((topic, name) for name, topic in subscriptions)),
    )
