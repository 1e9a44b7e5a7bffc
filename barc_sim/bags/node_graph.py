"""The graph of nodes and topics: as a record, as JSON, and with the nodes' purposes."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING

from barc_sim.bags import bounds
from barc_sim.bags.names import ECU, NODES

if TYPE_CHECKING:
    from collections.abc import Iterable

#: ROS's own topics, which every node publishes; figures name them, but do not draw them.
EVERYONES = ('/rosout', '/parameter_events')

Link = tuple[str, str]
#: The part of the user's code that a node of ours runs.
_PARTS = {'vehicle_simulator': 'model', 'controller': 'controller', 'relay': 'relay'}


@dataclass(frozen=True)
class NodeGraph:
    """The nodes of a system with their topics, all by their full names, sorted."""

    nodes: tuple[str, ...]
    topics: dict[str, str]  #: the type of each
    publications: tuple[Link, ...]  #: node and topic
    subscriptions: tuple[Link, ...]  #: topic and node
    code: dict[str, str] = field(default_factory=dict)  #: the user's file of each part

    def to_json(self) -> str:
        """Return the graph as JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> NodeGraph:
        """Return the graph from the JSON of `to_json`."""
        values = bounds.from_json(text)
        try:
            graph = cls(
                nodes=tuple(map(_name, values['nodes'])),
                topics={_name(topic): _name(kind) for topic, kind in values['topics'].items()},
                publications=_links(values['publications']),
                subscriptions=_links(values['subscriptions']),
                code={part: _name(file) for part, file in values.get('code', {}).items()},
            )
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(f'no graph: {error!r}') from None
        known = {*graph.nodes, *graph.topics}
        links = (*graph.publications, *graph.subscriptions)
        if len(known) > bounds.MAX_NODES or len(links) > bounds.MAX_LINKS:
            raise ValueError(f'a graph of {len(known)} nodes and topics, and {len(links)} links')
        if not known.issuperset(name for link in links for name in link):
            raise ValueError('a graph with a link to a node or topic that it lacks')
        return graph


def _name(value: object) -> str:
    if not isinstance(value, str) or len(value) > bounds.MAX_NAME:
        raise TypeError('a name')
    return value


def _links(pairs: Iterable[tuple[object, object]]) -> tuple[Link, ...]:
    return tuple((_name(source), _name(target)) for source, target in pairs)


def purposes(graph: NodeGraph) -> list[tuple[str, str]]:
    """Return each node with its purpose and the user's file; empty for a node that is not ours.

    A node that is not ours and commands is the user's relay, where a file of one was named.
    """
    commanding = {node for node, topic in graph.publications if topic.endswith(f'/{ECU}')}
    rows = []
    for name in graph.nodes:
        node = name.rpartition('/')[2]
        about = NODES.get(node, '')
        part = _PARTS.get(node) if about else 'relay' if name in commanding else None
        code = graph.code.get(part or '')
        words = [about, f'code: {code}' if code else '']
        rows.append((name, '; '.join(filter(None, words))))
    return rows
