"""Command: write a run's plots, figures and code as one HTML page, to be handed in."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence

PROG = 'barc report'
FORMATS = ('html',)


def parse(argv: Sequence[str] | None = None) -> Namespace:
    """Return the options on the command line."""
    parser = Parser(
        prog=PROG,
        description='Write plots, metrics, gains, code, graph, versions and hashes of a run as one '
        'HTML file, which needs no network to be read.',
    )
    parser.add_argument(
        'bag', nargs='?', type=Path, metavar='BAG', help='default: the newest in ./bags'
    )
    parser.add_argument(
        '--namespace', metavar='NS', help='the car, where the bag has several, as in /car1'
    )
    parser.add_argument(
        '-o', '--save', metavar='FILE', help='where to write it (report.html in the bag)'
    )
    return parser.parse_args(argv)


def write(options: Namespace) -> None:
    """Do what the options ask for.

    Raises
    ------
    UserError
        where the bag cannot be read, or the page not be written.
    """
    from barc_sim.bags import reader  # noqa: PLC0415 (--help need not wait for NumPy)
    from barc_sim.figures import output  # noqa: PLC0415 (--help need not wait for matplotlib)
    from barc_sim.lab.report.facts import read  # noqa: PLC0415
    from barc_sim.lab.report.page import page  # noqa: PLC0415

    source = options.bag or reader.newest()
    directory = source if source.is_dir() else source.parent
    path = output.target(options.save or str(directory / 'report.html'), FORMATS)
    text = page(read(source, options.namespace))
    with output.replacing(path) as part:
        part.write_text(text, encoding='utf-8')
    print(path)  # noqa: T201


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = parse(argv)
    return call(PROG, lambda: write(options))


if __name__ == '__main__':
    sys.exit(main())
