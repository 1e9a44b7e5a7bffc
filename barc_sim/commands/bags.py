"""`info`, `convert` and `recover`: what is in a bag, as tables, and whole again."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from barc_sim.cli.parser import add_bag
from barc_sim.errors import escaped
from barc_sim.runs.options import add_topic_choice

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator

    from barc_sim.bags.contents import Contents
    from barc_sim.cli.parser import Parser


def add_arguments_info(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Print what is in an MCAP bag of any recorder, as `ros2 bag info` does.'
    parser.epilog = 'It reads every message, so that it counts what can be read.'
    add_bag(parser)
    parser.add_argument('--json', action='store_true', help='print JSON')


def run_info(options: Namespace) -> None:
    """Read the bag, and print what is in it."""
    import json  # noqa: PLC0415 (not for --help)

    from barc_sim.bags.contents import describe  # noqa: PLC0415 (slow: not for --help)

    found = describe(_bag(options))
    for line in [json.dumps(found, indent=2)] if options.json else _described(found):
        print(escaped(line))  # noqa: T201


def _bag(options: Namespace) -> Path:
    from barc_sim.bags.reader import newest  # noqa: PLC0415 (slow: not for --help)

    return options.bag or newest()


def _described(found: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of a description, much as `ros2 bag info` has them."""
    start = datetime.fromtimestamp(found['start'], timezone.utc).astimezone()
    yield f'Files:     {", ".join(found["files"])}'
    yield f'Bag size:  {sum(found["files"].values()) / 1024:.1f} KiB'
    yield f'Duration:  {found["duration"]:.9f} s'
    yield f'Start:     {start:%b %d %Y %H:%M:%S.%f} ({found["start"]:.9f})'
    yield f'Messages:  {found["messages"]}'
    for topic in found['topics']:
        yield f'{topic["messages"]:9} {topic["name"]} [{topic["type"]}]'
    yield from _damages(found['damages'])
    for name, text in (*found['losses'].items(), *found['metadata'].items()):
        if name not in ('parameters', 'graph'):  # long
            yield f'{name}: {" ".join(text.split())}'


def _damages(found: dict[str, dict[str, int]]) -> Iterator[str]:
    for name, damage in found.items():
        if chunks := damage['unreadable_chunks']:
            yield f'{name}: damaged chunks left out: {chunks}'
        if damage['unfinished']:
            yield f'{name} is unfinished or damaged: {damage["unread"]} bytes at its end are unread'


def add_arguments_convert(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Convert an MCAP bag of any recorder to tables, a CSV file for each topic.'
    parser.epilog = 'For bags of ROS 1 and of sqlite3, there is `rosbags-convert`.'
    add_bag(parser)
    parser.add_argument(
        '-o', '--output', type=Path, metavar='DIR', help='new folder (BAG_csv, here)'
    )
    add_topic_choice(parser, 'convert')


def run_convert(options: Namespace) -> None:
    """Convert the bag, and print where it is."""
    from barc_sim.bags.convert import convert  # noqa: PLC0415 (slow: not for --help)

    bag = _bag(options)
    output = options.output or Path(f'{bag.resolve().stem}_csv')
    convert(bag, output, options.topics, options.exclude)
    print(output)  # noqa: T201


def add_arguments_recover(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Copy what can be read of a bag whose run was killed, with index, summary and '
        'metadata.yaml, for tools that need them.'
    )
    add_bag(parser)
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        metavar='DIR',
        help='directory of the new bag (BAG_recovered, beside BAG)',
    )


def run_recover(options: Namespace) -> None:
    """Write the new bag and print what it holds."""
    from barc_sim.bags.convert import recover  # noqa: PLC0415 (slow: not for --help)

    bag = _bag(options)
    whole = bag.resolve()
    output = options.output or whole.with_name(f'{whole.stem}_recovered')
    for line in _recovered(recover(bag, output)):
        print(escaped(line))  # noqa: T201
    print(output)  # noqa: T201


def _recovered(contents: Contents) -> Iterator[str]:
    """Yield the lines of the summary: damages, messages by topic."""
    yield from _damages({name: vars(damage) for name, damage in contents.damages.items()})
    for name, count in sorted(contents.counts.items()):
        yield f'{count:9} {name}'
    yield f'{contents.span.count:9} messages in {contents.span.duration / 1e9:.3f} s'
