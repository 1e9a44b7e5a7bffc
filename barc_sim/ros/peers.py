"""The nodes that take part: their graph, publishers, a simulator's claim to its topic."""

from __future__ import annotations

import hashlib
import os
import socket
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.bags.names import NodeGraph
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rclpy.node import Node
    from rclpy.topic_endpoint_info import TopicEndpointInfo

# Parts of a Fast DDS identifier (GID).
_PROCESS = slice(8)  #: vendor, host, half of the process's number, a random number
_PARTICIPANT = slice(12)


def node_graph(node: Node) -> NodeGraph:
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


def has_dds() -> bool:
    """Return whether messages reach other processes: not through `ros/local`."""
    return hasattr(sys.modules['rclpy'], '__file__')


def claim(node: Node, topic: str) -> socket.socket:
    """Claim `topic` for `node` on this machine, in its ROS domain; closing the result frees it.

    The claim is a socket's name in Linux's abstract namespace. It is taken at once, where discovery
    would need seconds to find another publisher, and it is free as soon as its process ends.
    """
    if not has_dds():
        return socket.socket()  # nobody else is there
    held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    # A topic's name may be longer than a socket's.
    digest = hashlib.sha256(node.resolve_topic_name(topic).encode()).hexdigest()
    try:
        held.bind(f'\0barc_sim/{node.context.get_domain_id()}/{digest}')
    except OSError:
        held.close()
        raise _taken(node, topic) from None
    return held


def others_here(domain: int) -> bool:
    """Return whether another process of this machine takes part in the ROS domain.

    DDS gives the participants of a domain UDP ports of a range of its own (RTPS 2.3, 9.6.1.1).
    """
    first = 7400 + 250 * domain
    own = {str(f.readlink()) for f in Path('/proc/self/fd').iterdir() if f.is_symlink()}
    for line in Path('/proc/net/udp').read_text(encoding='ascii').splitlines()[1:]:
        _, address, *_, inode = line.split()[:10]
        port = int(address.rpartition(':')[2], 16)
        if first <= port < first + 250 and f'socket:[{inode}]' not in own:
            return True
    return False


def _taken(node: Node, topic: str) -> UserError:
    """Return the error of a second publisher of `topic`."""
    name, dds = node.resolve_topic_name(topic), has_dds()
    here = f' in ROS domain {node.context.get_domain_id()}' if dds else ''
    return UserError(
        f'another simulator publishes {name}{here}: give this one a namespace '
        f'(--ros-args -r __ns:=/car2){" or a ROS_DOMAIN_ID" if dds else ""} of its own'
    )


def publishers(node: Node, topic: str) -> list[TopicEndpointInfo]:
    """Return the publishers of `topic` that are alive for DDS, which notices a kill after 20 s."""
    return [*node.get_publishers_info_by_topic(node.resolve_topic_name(topic))]


def full_names(ends: Iterable[TopicEndpointInfo]) -> list[str]:
    """Return the full names of the nodes that `ends` belong to."""
    return sorted(f'{end.node_namespace.rstrip("/")}/{end.node_name}' for end in ends)


def check_unique(node: Node, topic: str) -> None:
    """Check that `node` alone publishes `topic`."""
    if len(publishers(node, topic)) > 1:
        raise _taken(node, topic)


def all_own(node: Node, ends: Iterable[TopicEndpointInfo]) -> bool:
    """Return whether `ends` belong to nodes of this process, as `node` does."""
    own = (_own_gid(node) or b'') if has_dds() else None
    return own is None or all(bytes(end.endpoint_gid)[_PROCESS] == own[_PROCESS] for end in ends)


def of_participant(node: Node, ends: Iterable[TopicEndpointInfo]) -> list[TopicEndpointInfo]:
    """Return those of `ends` that belong to nodes in the DDS participant of `node`."""
    own = (_own_gid(node) or b'')[_PARTICIPANT]
    return [end for end in ends if bytes(end.endpoint_gid)[_PARTICIPANT] == own]


def _own_gid(node: Node) -> bytes | None:
    """Return the identifier of one of the node's publishers; None with another DDS."""
    number = (os.getpid() % (1 << 16)).to_bytes(2, 'little')
    topics = {publisher.topic_name for publisher in node.publishers}
    # Every node publishes /parameter_events: a topic of its own has fewer publishers to look at.
    for end in node.get_publishers_info_by_topic(min(topics, key=node.count_publishers)):
        gid = bytes(end.endpoint_gid)
        if end.node_name == node.get_name() and gid[_PROCESS].startswith(number, 4):
            return gid
    return None
