"""Command: play a run from its bag again, in a window, in a web page or into a video."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call
from barc_sim.runs.view_options import add_address_options

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from barc_sim.figures.animation import View
    from barc_sim.simulation.log import Log

PROG = 'barc replay'
FORMATS = ('mp4', 'gif')
MP4_DPI, MP4_FPS = 100, 50  # 1280 x 720, every state
GIF_DPI, GIF_FPS = 75, 25  # 960 x 540: a GIF is large, and counts in hundredths of a second


def parse(argv: Sequence[str] | None = None) -> Namespace:
    """Return the options on the command line."""
    parser = Parser(prog=PROG, description='Play a run at real speed.')
    parser.add_argument(
        'bag', nargs='?', type=Path, metavar='BAG', help='default: the newest in ./bags'
    )
    parser.add_argument(
        '--namespace', metavar='NS', help='the car, where the bag has several, as in /car1'
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        '--save',
        metavar='FILE',
        help='save as .mp4 or .gif; without it a window opens, or BAG/replay.mp4 is saved where '
        'there is no display',
    )
    how.add_argument(
        '--web', action='store_true', help='serve a page to watch it in, with a time slider'
    )
    add_address_options(parser)
    return parser.parse_args(argv)


def play(options: Namespace) -> None:
    """Do what the options ask for.

    Raises
    ------
    UserError
        where the bag cannot be read, the video not be saved as asked, or the page not be served.
    """
    from barc_sim.bags import reader  # noqa: PLC0415 (--help need not wait for NumPy)
    from barc_sim.figures import output  # noqa: PLC0415 (--help need not wait for NumPy)

    path = output.target(options.save, FORMATS) if options.save is not None else None
    source = options.bag or reader.newest()
    log = reader.read(source, options.namespace)
    directory = source if source.is_dir() else source.parent
    title = directory.resolve().name
    if options.web:
        from barc_sim.page import replay as page_replay  # noqa: PLC0415

        page_replay.serve(log, title, options.view_host, options.view_port)
        return
    if not path and _play_in_window(log, title):
        return
    path = path or directory / 'replay.mp4'
    with output.replacing(path) as part:
        save(log, part, title=title)
    print(path)  # noqa: T201


def _play_in_window(log: Log, title: str) -> bool:
    """Play until the user closes the window; return whether there could be one."""
    from barc_sim.figures import animation, output, side_view  # noqa: PLC0415

    figure = output.window(side_view.SIZE, title)
    if figure is None:
        return False
    playing = animation.animate(view_of(log, figure, title))
    output.show()
    del playing  # it played for as long as it was kept
    return True


def view_of(log: Log, figure: Figure, title: str) -> View:
    """Return the view that suits the run: from above where it was driven by hand."""
    from barc_sim.figures import side_view, top_view  # noqa: PLC0415

    kind = top_view.TopView if top_view.suits(log) else side_view.SideView
    return kind(log, figure, title=title)


def save(log: Log, path: Path, *, title: str = '') -> None:
    """Write the run as a video to `path`, which ends in .mp4 or .gif, at real speed.

    Where stderr is a terminal, a bar shows how far it is.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import track  # noqa: PLC0415

    from barc_sim.figures import animation, side_view, video  # noqa: PLC0415

    gif = path.suffix.lower() == '.gif'
    dpi, fps = (GIF_DPI, GIF_FPS) if gif else (MP4_DPI, MP4_FPS)
    view = view_of(log, Figure(figsize=side_view.SIZE, dpi=dpi), title)
    times = track(
        animation.frame_times(view.duration, fps),
        'Saving',
        console=Console(stderr=True),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    images = animation.frames(view, times)
    if gif:
        video.write_gif(path, images, fps=fps)
    else:
        width, height = view.figure.canvas.get_width_height()
        video.write_mp4(path, images, size=(width, height), fps=fps)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = parse(argv)
    return call(PROG, lambda: play(options))


if __name__ == '__main__':
    sys.exit(main())
