"""The graph of a system's nodes and topics, as a bag holds it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from barc_sim.bags import bounds

if TYPE_CHECKING:
    from collections.abc import Iterable

Link = tuple[str, str]


@dataclass(frozen=True)
class NodeGraph:
    """The nodes of a system with their topics, all by their full names, sorted."""

    nodes: tuple[str, ...]
    topics: dict[str, str]  #: the type of each
    publications: tuple[Link, ...]  #: node and topic
    subscriptions: tuple[Link, ...]  #: topic and node

    def to_json(self) -> str:
        """Return the graph as JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> NodeGraph:
        """Return the graph from the JSON of `to_json`; ValueError: it has none, or is too large."""
        values = bounds.from_json(text)
        try:
            graph = cls(
                nodes=tuple(map(_name, values['nodes'])),
                topics={_name(topic): _name(kind) for topic, kind in values['topics'].items()},
                publications=_links(values['publications']),
                subscriptions=_links(values['subscriptions']),
            )
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(f'no graph: {error!r}') from None

        names = {*graph.nodes, *graph.topics}
        links = (*graph.publications, *graph.subscriptions)
        if len(names) > bounds.MAX_NODES or len(links) > bounds.MAX_LINKS:
            raise ValueError(f'a graph of {len(names)} nodes and topics, and {len(links)} links')
        if not all(source in names and target in names for source, target in links):
            raise ValueError('a graph with a link to a node or topic that it lacks')
        return graph


def _name(value: object) -> str:
    if not isinstance(value, str) or len(value) > bounds.MAX_NAME:
        raise TypeError('a name')
    return value


def _links(pairs: Iterable[tuple[object, object]]) -> tuple[Link, ...]:
    return tuple((_name(source), _name(target)) for source, target in pairs)
