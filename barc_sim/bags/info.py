"""What `barc info` prints of a bag: files, time, topics, losses, damage and metadata."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

from barc_sim.bags.bounds import LONG
from barc_sim.bags.contents import Contents

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_LOSSES = ('lost ', 'lost_messages', 'not recorded ')


def describe(path: Path) -> dict[str, Any]:
    """Read a whole bag; return what is in it, in JSON's types, times in seconds.

    Raises
    ------
    UserError
        There is no bag, or it cannot be read.
    """
    contents = Contents(path)
    for _ in contents.messages():
        pass
    span, metadata = contents.span, contents.metadata
    files = [
        file for each in contents.sources for file in (each.iterdir() if each.is_dir() else [each])
    ]
    return {
        'path': str(path),
        'files': {file.name: file.stat().st_size for file in sorted(files)},
        'start': (span.start or 0) / 1e9,
        'duration': span.duration / 1e9,
        'messages': span.count,
        'topics': [
            {'name': name, 'type': topic.type, 'messages': contents.counts[name]}
            for name, topic in sorted(contents.topics.items())
        ],
        'losses': {k: v for k, v in metadata.items() if k.startswith(_LOSSES)},
        'damages': {name: vars(damage) for name, damage in contents.damages.items()},
        'metadata': {k: v for k, v in metadata.items() if not k.startswith(_LOSSES)},
    }


def lines(found: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of a description, much as `ros2 bag info` has them."""
    start = datetime.fromtimestamp(found['start'], timezone.utc).astimezone()
    yield f'Files:     {", ".join(found["files"])}'
    yield f'Bag size:  {sum(found["files"].values()) / 1024:.1f} KiB'
    yield f'Duration:  {found["duration"]:.9f} s'
    yield f'Start:     {start:%b %d %Y %H:%M:%S.%f} ({found["start"]:.9f})'
    yield f'Messages:  {found["messages"]}'
    for topic in found['topics']:
        yield f'{topic["messages"]:9} {topic["name"]} [{topic["type"]}]'
    for name, damage in found['damages'].items():
        chunks = damage['unreadable_chunks']
        yield f'{name} is damaged: {chunks} chunks and {damage["unread"]} bytes cannot be read'
    for name, text in (*found['losses'].items(), *found['metadata'].items()):
        if name not in LONG:
            yield f'{name}: {" ".join(text.split())}'
