"""Writes plots, metrics and code of a run as one HTML page to hand in."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.cli.files import check_plain, saving, target
from barc_sim.cli.parser import add_bag_arguments

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser

FORMATS = ('html',)


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Write plots, metrics, gains, code, graph, versions and hashes of a run as one HTML file '
        'that can be read without a network.'
    )
    add_bag_arguments(parser)
    parser.add_argument(
        '-o', '--save', metavar='FILE', help='the file to write (report.html in the bag)'
    )


def run(options: Namespace) -> None:
    """Write the page and print its path.

    Raises
    ------
    UserError
        where the bag cannot be read, or the page cannot be written.
    """
    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.lab.report import page, read  # noqa: PLC0415

    source = options.bag or reader.newest()
    directory = source if source.is_dir() else source.parent
    path = target(options.save or str(directory / 'report.html'), FORMATS)
    text = page(read(source, options.namespace))
    if options.save is None:
        check_plain(directory)
    with saving(path) as part:
        part.write_text(text, encoding='utf-8')
    print(path)  # noqa: T201
