"""The nodes of the system: their graph, a topic's publishers, a simulator's claim to its topic."""

from __future__ import annotations

import hashlib
import os
import socket
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.bags.graph import NodeGraph
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rclpy.node import Node
    from rclpy.topic_endpoint_info import TopicEndpointInfo

# UDP ports of the ROS domains (RTPS 2.3, 9.6.1.1).
FIRST_PORT = 7400
PORTS_PER_DOMAIN = 250
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
    """Return whether messages reach other processes; they do not with `ros/local`."""
    return hasattr(sys.modules['rclpy'], '__file__')


def claim(node: Node, topic: str) -> socket.socket:
    """Claim `topic` for `node` on this machine, in its ROS domain; closing the result frees it.

    The claim is a socket's name in Linux's abstract namespace. It holds at once, while discovery
    of another publisher would take seconds, and it ends with its process.
    """
    if not has_dds():
        return socket.socket()  # no other process can publish the topic
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    # A topic's name may be longer than a socket's.
    digest = hashlib.sha256(node.resolve_topic_name(topic).encode()).hexdigest()
    try:
        lock.bind(f'\0barc_sim/{node.context.get_domain_id()}/{digest}')
    except OSError:
        lock.close()
        raise _topic_in_use(node, topic) from None
    return lock


def others_here(domain: int) -> bool:
    """Return whether another process of this machine takes part in the ROS domain.

    Each domain has its own range of UDP ports in DDS.
    """
    first = FIRST_PORT + PORTS_PER_DOMAIN * domain
    ports = range(first, first + PORTS_PER_DOMAIN)
    own_files = {str(f.readlink()) for f in Path('/proc/self/fd').iterdir() if f.is_symlink()}

    for line in Path('/proc/net/udp').read_text(encoding='ascii').splitlines()[1:]:
        columns = line.split()
        local_address = columns[1]
        inode = columns[9]
        port = int(local_address.rpartition(':')[2], 16)
        if port in ports and f'socket:[{inode}]' not in own_files:
            return True
    return False


def _topic_in_use(node: Node, topic: str) -> UserError:
    """Return the error of a second publisher of `topic`."""
    name = node.resolve_topic_name(topic)
    where = ''
    or_domain = ''
    if has_dds():
        where = f' in ROS domain {node.context.get_domain_id()}'
        or_domain = ' or a ROS_DOMAIN_ID'
    return UserError(
        f'another simulator publishes {name}{where}: give this one a namespace '
        f'(--ros-args -r __ns:=/car2){or_domain} of its own'
    )


def publishers(node: Node, topic: str) -> list[TopicEndpointInfo]:
    """Return the publishers of `topic`; DDS drops those of a killed process after 20 s."""
    return [*node.get_publishers_info_by_topic(node.resolve_topic_name(topic))]


def full_names(endpoints: Iterable[TopicEndpointInfo]) -> list[str]:
    """Return the full names of the nodes that have these endpoints."""
    return sorted(f'{each.node_namespace.rstrip("/")}/{each.node_name}' for each in endpoints)


def check_unique(node: Node, topic: str) -> None:
    """Check that `node` alone publishes `topic`."""
    if len(publishers(node, topic)) > 1:
        raise _topic_in_use(node, topic)


def all_own(node: Node, endpoints: Iterable[TopicEndpointInfo]) -> bool:
    """Return whether all `endpoints` belong to nodes in the process of `node`."""
    if not has_dds():
        return True
    process = (_own_gid(node) or b'')[_PROCESS]
    return all(bytes(each.endpoint_gid)[_PROCESS] == process for each in endpoints)


def of_participant(node: Node, endpoints: Iterable[TopicEndpointInfo]) -> list[TopicEndpointInfo]:
    """Return the endpoints that belong to nodes in the DDS participant of `node`."""
    participant = (_own_gid(node) or b'')[_PARTICIPANT]
    return [each for each in endpoints if bytes(each.endpoint_gid)[_PARTICIPANT] == participant]


def _own_gid(node: Node) -> bytes | None:
    """Return the GID of one of the node's publishers; None if it is not of Fast DDS."""
    number = (os.getpid() % (1 << 16)).to_bytes(2, 'little')
    topics = {publisher.topic_name for publisher in node.publishers}
    # Every node publishes /parameter_events: search the topic with the fewest publishers.
    for endpoint in node.get_publishers_info_by_topic(min(topics, key=node.count_publishers)):
        gid = bytes(endpoint.endpoint_gid)
        if endpoint.node_name == node.get_name() and gid[_PROCESS].startswith(number, 4):
            return gid
    return None
