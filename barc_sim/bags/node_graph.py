"""The graph of nodes and topics: as a record, as JSON, and as a table of the nodes' purposes."""

from __future__ import annotations

import ast
import json
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.bags import bounds

if TYPE_CHECKING:
    from collections.abc import Iterable

#: ROS's own topics, which every node publishes; figures name them, but do not draw them.
EVERYONES = ('/rosout', '/parameter_events')

Link = tuple[str, str]


@dataclass(frozen=True)
class NodeGraph:
    """The nodes of a system with their topics, all by their full names, sorted.

    Examples
    --------
    >>> graph = NodeGraph(('/controller',), {}, (), ())
    >>> NodeGraph.from_json(graph.to_json()) == graph
    True
    """

    nodes: tuple[str, ...]
    topics: dict[str, str]  #: the type of each
    publications: tuple[Link, ...]  #: node and topic
    subscriptions: tuple[Link, ...]  #: topic and node

    def to_json(self) -> str:
        """Return the graph as JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> NodeGraph:
        """Return the graph from the JSON of `to_json`.

        Raises
        ------
        ValueError
            It is none, or too large.
        """
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


class Part(NamedTuple):
    """A row of the table; source and purpose are empty for a node that is not ours."""

    name: str
    source: str
    purpose: str


def table(graph: NodeGraph) -> list[Part]:
    """Return a row for each node of `graph`.

    Examples
    --------
    >>> graph = NodeGraph(('/controller',), {}, (), ())
    >>> table(graph)[0].purpose
    'holds the speed; each state that arrives is answered by a command'
    """
    known = _known()
    return [Part(name, *known.get(name.rpartition('/')[2], ('', ''))) for name in graph.nodes]


def _known() -> dict[str, tuple[str, str]]:
    """Return source and purpose of our own nodes, by name, from their modules' docstrings."""
    package = Path(__file__).parents[1]
    known = {}
    for path in sorted((package / 'nodes').rglob('*.py')):
        text = path.read_text(encoding='utf-8')
        name = re.search(r"super\(\).__init__\('(\w+)'", text)
        if name:
            first = (ast.get_docstring(ast.parse(text)) or '').partition('\n\n')[0]
            purpose = ' '.join(first.split()).partition(': ')[2].rstrip('.')
            known[name[1]] = str(path.relative_to(package.parent)), purpose
    return known
