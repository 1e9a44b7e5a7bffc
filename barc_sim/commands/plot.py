"""Command: draw a run's speed, grade and command from its bag."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call
from barc_sim.control.types import GAINS
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Mapping, Sequence

PROG = 'barc plot'
FORMATS = ('png', 'pdf', 'svg')
DPI = 150


def parse(argv: Sequence[str] | None = None) -> Namespace:
    """Return the options on the command line."""
    parser = Parser(prog=PROG, description='Draw speed, grade and command of a run.')
    parser.add_argument(
        'bag', nargs='?', type=Path, metavar='BAG', help='default: the newest in ./bags'
    )
    parser.add_argument(
        '--namespace', metavar='NS', help='the car, where the bag has several, as in /car1'
    )
    parser.add_argument('--save', metavar='FILE', help='save as .png, .pdf or .svg')
    parser.add_argument(
        '--show',
        action='store_true',
        help='open a window, the default with a display and no --save; without a display the '
        'default is to save BAG/speed.png',
    )
    return parser.parse_args(argv)


def draw(options: Namespace) -> None:
    """Do what the options ask for.

    Raises
    ------
    UserError
        where the bag cannot be read, or the figure not be shown or saved as asked.
    """
    from barc_sim.bags import reader  # noqa: PLC0415 (--help need not wait for NumPy)
    from barc_sim.figures import output, run_figures  # noqa: PLC0415

    path = output.target(options.save, FORMATS) if options.save is not None else None
    source = options.bag or reader.newest()
    log = reader.read(source, options.namespace)
    directory = source if source.is_dir() else source.parent
    title = directory.resolve().name
    window = output.window(run_figures.SIZE, title) if options.show or not path else None
    if options.show and not window:
        raise UserError(
            'cannot open a window for --show: there is no display, or no GUI toolkit such as '
            'tkinter; use --save FILE'
        )
    figure = run_figures.speed_figure(
        log, title=title, settings=settings(reader.info(source)), figure=window
    )
    if not window:
        path = path or directory / 'speed.png'
    if path:
        with output.replacing(path) as part:
            figure.savefig(part, dpi=DPI)
        print(path)  # noqa: T201
    if window:
        output.show()


def settings(info: Mapping[str, str]) -> str:
    """Return in a line what a run's metadata tells of its road and gains."""
    return ' · '.join(f'{key} {info[key]}' for key in ('road', *GAINS) if key in info)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = parse(argv)
    return call(PROG, lambda: draw(options))


if __name__ == '__main__':
    sys.exit(main())
