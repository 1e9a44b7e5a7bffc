"""`plot` and `replay`: a recorded run as a figure, in a window, on a web page or as a video."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.files import check_plain, saving, target
from barc_sim.cli.parser import add_bag_arguments
from barc_sim.errors import UserError
from barc_sim.runs.options import add_address_options

if TYPE_CHECKING:
    from argparse import Namespace

    from matplotlib.figure import Figure

    from barc_sim.cli.parser import Parser
    from barc_sim.figures.output import RunView
    from barc_sim.simulation.log import Log

_FIGURES = ('png', 'pdf', 'svg')
_FIGURE_DPI = 150
_VIDEOS = ('mp4', 'gif')
MP4_DPI, MP4_FPS = 100, 50  # 1280 x 720, every state
GIF_DPI, GIF_FPS = 75, 25  # 960 x 540: a GIF is large, and its unit of time is 10 ms


def add_arguments_plot(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Draw speed, grade and command of a run; of a drive by hand, its path.'
    add_bag_arguments(parser)
    parser.add_argument('--save', metavar='FILE', help='save as .png, .pdf or .svg')
    parser.add_argument(
        '--show',
        action='store_true',
        help='open a window: the default with a display and without --save; without a display '
        'the default is to save BAG/speed.png',
    )


def run_plot(options: Namespace) -> None:
    """Save the figure, or show it in a window."""
    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.figures import output, run_figures, top_view  # noqa: PLC0415

    path = target(options.save, _FIGURES) if options.save is not None else None
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
    if top_view.suits(log):
        figure = run_figures.drive_figure(log, title=title, figure=window)
    else:
        settings = run_figures.settings(bag.info)
        figure = run_figures.speed_figure(log, title=title, settings=settings, figure=window)
    if not window and not path:
        check_plain(directory)
        path = directory / 'speed.png'
    if path:
        with saving(path) as part:
            figure.savefig(part, dpi=_FIGURE_DPI)
        print(path)  # noqa: T201
    if window:
        output.show()


def add_arguments_replay(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Play a run at real speed.'
    add_bag_arguments(parser)
    parser.add_argument(
        'other', nargs='?', type=Path, metavar='OTHER', help='with --web: a second run beside it'
    )
    target = parser.add_mutually_exclusive_group()
    target.add_argument(
        '--save',
        metavar='FILE',
        help='save as .mp4 or .gif; default: a window, or BAG/replay.mp4 without a display',
    )
    target.add_argument(
        '--web', action='store_true', help='serve a page to watch it in, with a time slider'
    )
    add_address_options(parser, can='watch')


def run_replay(options: Namespace) -> None:
    """Play the run."""
    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)

    if options.other and not options.web:
        raise UserError(
            f'a second run, {str(options.other)!r}, is shown by the web page only: add --web'
        )
    path = target(options.save, _VIDEOS) if options.save is not None else None
    source = options.bag or reader.newest()
    log = reader.read(source, options.namespace)
    directory = source if source.is_dir() else source.parent
    title = directory.resolve().name
    if options.web:
        from barc_sim.page import replay as page_replay  # noqa: PLC0415

        other = None
        if options.other:
            second = reader.read(options.other, options.namespace)
            other = second, options.other.resolve().name
        page_replay.serve(log, title, options.view_host, options.view_port, other)
        return
    if not path and _play_in_window(log, title):
        return
    if not path:
        from barc_sim.figures import output  # noqa: PLC0415

        check_plain(directory)
        path = directory / ('replay.mp4' if output.ffmpeg() else 'replay.gif')
    with saving(path) as part:
        save(log, part, title=title)
    print(path)  # noqa: T201


def _play_in_window(log: Log, title: str) -> bool:
    """Play until the user closes the window; return False without a display."""
    from barc_sim.figures import output  # noqa: PLC0415

    figure = output.window(output.SIZE, title)
    if figure is None:
        return False
    playing = output.animate(view_of(log, figure, title))
    output.show()
    del playing  # an animation stops when its last reference goes
    return True


def view_of(log: Log, figure: Figure, title: str) -> RunView:
    """Return the view for this run: from above if a driver steered."""
    from barc_sim.figures import side_view, top_view  # noqa: PLC0415

    kind = top_view.TopView if top_view.suits(log) else side_view.SideView
    return kind(log, figure, title=title)


def save(log: Log, path: Path, *, title: str = '') -> None:
    """Write the run at real speed to `path`, which ends in .mp4 or .gif.

    A progress bar appears if stderr is a terminal.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import track  # noqa: PLC0415

    from barc_sim.figures import output  # noqa: PLC0415

    gif = path.suffix.lower() == '.gif'
    dpi, fps = (GIF_DPI, GIF_FPS) if gif else (MP4_DPI, MP4_FPS)
    view = view_of(log, Figure(figsize=output.SIZE, dpi=dpi), title)
    times = track(
        output.frame_times(view.duration, fps),
        'Saving',
        console=Console(stderr=True),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    images = output.frames(view, times)
    if gif:
        output.write_gif(path, images, fps=fps)
    else:
        width, height = view.figure.canvas.get_width_height()
        output.write_mp4(path, images, size=(width, height), fps=fps)
