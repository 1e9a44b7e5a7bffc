"""Draws the speed, grade and command of a recorded run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.cli.files import check_plain, saving, target
from barc_sim.cli.parser import add_bag_arguments
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser

FORMATS = ('png', 'pdf', 'svg')
DPI = 150


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Draw speed, grade and command of a run.'
    add_bag_arguments(parser)
    parser.add_argument('--save', metavar='FILE', help='save as .png, .pdf or .svg')
    parser.add_argument(
        '--show',
        action='store_true',
        help='open a window: the default with a display and without --save; without a display '
        'the default is to save BAG/speed.png',
    )


def run(options: Namespace) -> None:
    """Save the figure, or show it in a window."""
    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.figures import output, run_figures  # noqa: PLC0415

    path = target(options.save, FORMATS) if options.save is not None else None
    source = options.bag or reader.newest()
    bag = reader.load(source)
    log = bag.log(options.namespace)
    directory = source if source.is_dir() else source.parent
    title = directory.resolve().name
    window = output.window(run_figures.SIZE, title) if options.show or not path else None
    if options.show and not window:
        raise UserError(
            'cannot open a window for --show: there is no display, or no GUI toolkit such as '
            'tkinter; use --save FILE'
        )
    figure = run_figures.speed_figure(
        log, title=title, settings=run_figures.settings(bag.info), figure=window
    )
    if not window and not path:
        check_plain(directory)
        path = directory / 'speed.png'
    if path:
        with saving(path) as part:
            figure.savefig(part, dpi=DPI)
        print(path)  # noqa: T201
    if window:
        output.show()
