"""Who publishes a topic, without those whose process is gone.

DDS takes 20 s to notice that a process was killed. Fast DDS's identifiers tell host and process,
so that of those on this machine it is known at once; of others, all are taken to be there.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.topic_endpoint_info import TopicEndpointInfo

_HOST = slice(4)  #: in an endpoint's identifier: DDS's maker and the host
_PROCESS = slice(4, 6)  #: the lower half of the process's number
_HALF = 1 << 16
_PARAMETER_EVENTS = '/parameter_events'  # every node publishes it


def living_publishers(node: Node, topic: str) -> list[TopicEndpointInfo]:
    """Return those that publish `topic`, but for processes of this machine that have died."""
    ends = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    host = _host(node) if len(ends) else None
    return [end for end in ends if host is None or not _is_gone(bytes(end.endpoint_gid), host)]


def is_own(end: TopicEndpointInfo) -> bool:
    """Return whether `end` is of this process, as far as its identifier tells."""
    return _process(bytes(end.endpoint_gid)) == os.getpid() % _HALF


def _host(node: Node) -> bytes | None:
    """Return what identifiers of this machine begin with; None where they don't tell."""
    own = os.getpid() % _HALF
    for end in node.get_publishers_info_by_topic(_PARAMETER_EVENTS):
        gid = bytes(end.endpoint_gid)
        if end.node_name == node.get_name() and _process(gid) == own:
            return gid[_HOST]
    return None


def _process(gid: bytes) -> int:
    return int.from_bytes(gid[_PROCESS], 'little')


def _is_gone(gid: bytes, host: bytes) -> bool:
    return gid[_HOST] == host and not any(
        Path('/proc', str(number)).exists()
        for number in range(_process(gid), _greatest_number() + 1, _HALF)
    )


def _greatest_number() -> int:
    return int(Path('/proc/sys/kernel/pid_max').read_text(encoding='ascii'))
