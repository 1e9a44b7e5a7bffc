"""A topic for one publisher only: two cars' simulators must not drive each other."""

from __future__ import annotations

import hashlib
import socket
from typing import TYPE_CHECKING

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from rclpy.node import Node


def claim(node: Node, topic: str) -> socket.socket:
    """Claim `topic` for `node` on this machine, in its ROS domain; closing the result frees it.

    The claim is a socket's name in Linux's abstract namespace: taken at once, where discovery
    would need seconds to see a peer, and free as soon as its process is gone, however it ended.

    Raises
    ------
    UserError
        where the topic is taken.
    """
    name = node.resolve_topic_name(topic)
    domain = node.context.get_domain_id()
    # A topic's name may be longer than a socket's.
    digest = hashlib.sha256(name.encode()).hexdigest()
    held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        held.bind(f'\0barc_sim/{domain}/{digest}')
    except OSError:
        held.close()
        raise UserError(taken(name, domain)) from None
    return held


def taken(topic: str, domain: int) -> str:
    """Return the sentence for a second publisher of `topic`."""
    return (
        f'another simulator publishes {topic} in ROS domain {domain}: give this one a namespace '
        f'(--ros-args -r __ns:=/car2) or a domain (ROS_DOMAIN_ID={domain + 1}) of its own'
    )
