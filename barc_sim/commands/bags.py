"""`info`, `convert` and `recover`: what is in a bag, as tables, and whole again."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from barc_sim.errors import escaped
from barc_sim.runs.options import add_topic_choice

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator

    from barc_sim.bags.contents import Contents
    from barc_sim.cli.parser import Parser


#: What each format makes of a bag's name.
_FORMATS = {
    'csv': '{}_csv',
    'parquet': '{}_parquet',
    'mat': '{}.mat',
    'ros1': '{}.bag',
    'sqlite3': '{}_sqlite3',
}


def add_arguments_info(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Print what is in a bag of any ROS 2 recorder, as `ros2 bag info` does.'
    parser.epilog = 'It reads every message, so that it counts what can be read.'
    parser.add_argument('bag', type=Path, metavar='BAG', help='directory of the bag, or a file')
    parser.add_argument('--json', action='store_true', help='print JSON')


def run_info(options: Namespace) -> None:
    """Read the bag, and print what is in it."""
    import json  # noqa: PLC0415 (not for --help)

    from barc_sim.bags.contents import describe  # noqa: PLC0415 (slow: not for --help)

    found = describe(options.bag)
    for line in [json.dumps(found, indent=2)] if options.json else _described(found):
        print(escaped(line))  # noqa: T201


def _described(found: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of a description, much as `ros2 bag info` has them."""
    from barc_sim.bags.bounds import LONG  # noqa: PLC0415

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


def add_arguments_convert(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Convert a bag of any ROS 2 recorder: to tables, one a topic, or to another kind of bag.'
    )
    parser.add_argument('bag', type=Path, metavar='BAG', help='directory of the bag, or a file')
    parser.add_argument(
        '--to', choices=_FORMATS, default='csv', help='the format (csv); mat is for MATLAB'
    )
    parser.add_argument(
        '-o', '--output', type=Path, metavar='PATH', help='new folder or file (BAG_csv, BAG.mat)'
    )
    add_topic_choice(parser, 'convert')


def run_convert(options: Namespace) -> None:
    """Convert the bag, and print where it is."""
    from barc_sim.bags.convert import convert  # noqa: PLC0415 (slow: not for --help)

    output = options.output or Path(_FORMATS[options.to].format(options.bag.resolve().stem))
    convert(options.bag, output, options.to, options.topics, options.exclude)
    print(output)  # noqa: T201


def add_arguments_recover(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Rebuild index, summary and metadata.yaml of a bag whose run was killed.'
    parser.epilog = 'A file that was not readable to its end is also kept, as FILE.damaged.'
    parser.add_argument('bag', type=Path, metavar='BAG', help='directory of the bag')


def run_recover(options: Namespace) -> None:
    """Repair the bag and print what it holds."""
    from barc_sim.bags.convert import recover  # noqa: PLC0415 (slow: not for --help)

    for line in _recovered(*recover(options.bag)):
        print(escaped(line))  # noqa: T201


def _recovered(contents: Contents, kept: list[Path]) -> Iterator[str]:
    """Yield the lines of the summary: damages, kept files, messages by topic."""
    for name, damage in contents.damages.items():
        if damage.unreadable_chunks:
            yield f'{name}: {damage.unreadable_chunks} damaged chunks were left out'
        if damage.unfinished:
            yield f'{name}: was unfinished; {damage.unread} bytes at its end could not be read'
    for path in kept:
        yield f'kept as it was: {path}'
    for name, count in sorted(contents.counts.items()):
        yield f'{count:9} {name}'
    yield f'{contents.span.count:9} messages in {contents.span.duration / 1e9:.3f} s'
