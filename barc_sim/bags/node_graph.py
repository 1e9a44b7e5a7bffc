"""The graph of nodes and topics: as a record, as JSON, and as a table of the nodes' purposes."""

from __future__ import annotations

import ast
import json
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

#: ROS's own topics, which every node publishes; figures name them, but do not draw them.
EVERYONES = ('/rosout', '/parameter_events')

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
        """Return the graph from the JSON of `to_json`."""
        values = json.loads(text)
        return cls(
            nodes=tuple(values['nodes']),
            topics=values['topics'],
            publications=tuple((node, topic) for node, topic in values['publications']),
            subscriptions=tuple((topic, node) for topic, node in values['subscriptions']),
        )


class Part(NamedTuple):
    """A row of the table; source and purpose are empty for a node that is not ours."""

    name: str
    source: str
    purpose: str


def table(graph: NodeGraph) -> list[Part]:
    """Return a row for each node of `graph`."""
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
