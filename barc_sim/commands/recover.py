"""Command: make a whole bag of one whose run was killed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator, Sequence

    from barc_sim.bags.recovery import Recovered

PROG = 'barc recover'


def parse(argv: Sequence[str] | None = None) -> Namespace:
    """Return the options on the command line."""
    parser = Parser(
        prog=PROG,
        description='Rebuild index, summary and metadata.yaml of a bag whose run was killed.',
        epilog='A file of which more than the last chunk is damaged is kept, as FILE.damaged.',
    )
    parser.add_argument('bag', type=Path, metavar='BAG', help='directory of the bag')
    return parser.parse_args(argv)


def report(found: Recovered) -> Iterator[str]:
    """Yield the lines that say what there was."""
    for name, damage in found.damages.items():
        if damage.unreadable_chunks:
            yield f'{name}: {damage.unreadable_chunks} damaged chunks are left out'
        if damage.unfinished:
            yield f'{name}: was unfinished; {damage.unread} bytes at its end could not be read'
    for path in found.kept:
        yield f'kept as it was: {path}'
    for name, count in sorted(found.counts.items()):
        yield f'{count:9} {name}'
    span = found.span
    duration = (span.end - (span.start or 0)) / 1e9
    yield f'{span.count:9} messages in {duration:.3f} s'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = parse(argv)

    def run() -> None:
        from barc_sim.bags.recovery import recover  # noqa: PLC0415 (--help need not wait for it)

        for line in report(recover(options.bag)):
            print(line)  # noqa: T201

    return call(PROG, run)


if __name__ == '__main__':
    sys.exit(main())
