"""`plot` and `replay`: a recorded run as a figure, on a page in the browser, or as a video."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.files import check_plain, figure_path, saving, target
from barc_sim.cli.parser import add_bag_arguments, show
from barc_sim.errors import UserError, escaped
from barc_sim.runs.options import add_address_options

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser
    from barc_sim.figures.run_figures import RecordedRun

_VIDEOS = ('mp4', 'gif')


def add_arguments_plot(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Draw speed, grade and command of a run; of a drive by hand, its path; of laps of a track, '
        'the path, errors and steering. Several runs are compared in one figure, each with what it '
        'differs in, such as its gains.'
    )
    add_bag_arguments(parser, several=True)
    parser.add_argument('--save', metavar='FILE', help='save as .png, .pdf or .svg')
    parser.add_argument(
        '--show',
        action='store_true',
        help='open a window (the default without --save; if there is no display, BAG/speed.png is '
        'saved instead)',
    )


def run_plot(options: Namespace) -> None:
    """Save the figure, or show it in a window."""
    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.figures import run_figures, windows  # noqa: PLC0415
    from barc_sim.figures.files import save_figure  # noqa: PLC0415

    path = figure_path(options.save)
    sources = options.bags or [reader.newest()]
    runs = [_recorded_run(source, options.namespace) for source in sources]
    title = runs[0].name if len(runs) == 1 else f'{len(runs)} runs'
    window = windows.window(title) if options.show or not path else None
    if options.show and not window:
        raise UserError(
            'cannot open a window for --show: there is no display, or no GUI toolkit such as '
            'tkinter; use --save FILE'
        )
    if len(runs) == 1:
        figure = run_figures.run_figure(runs[0].log, runs[0].info, title, window)
    else:
        figure = run_figures.runs_figure(_with_unique_names(runs, sources), title, window)
    if not window and not path:
        if len(runs) > 1:
            raise UserError('there is no display to compare runs on: name a file with --save')
        source = sources[0]
        directory = source if source.is_dir() else source.parent
        check_plain(directory)
        path = directory / 'speed.png'
    if path:
        save_figure(path, figure)
    if window:
        windows.show()


def _recorded_run(source: Path, namespace: str | None) -> RecordedRun:
    """Read a run from its bag."""
    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.figures.run_figures import RecordedRun  # noqa: PLC0415

    bag = reader.load(source)
    log = bag.log(namespace)
    directory = source if source.is_dir() else source.parent
    return RecordedRun(
        name=escaped(directory.resolve().name),
        info=bag.info,
        car=namespace or bag.cars[0],
        log=log,
    )


def _with_unique_names(runs: list[RecordedRun], sources: list[Path]) -> list[RecordedRun]:
    """Return the runs; those whose bags have one name are named by their paths."""
    counts = Counter(run.name for run in runs)
    return [
        run._replace(name=escaped(str(source))) if counts[run.name] > 1 else run
        for run, source in zip(runs, sources, strict=True)
    ]


def add_arguments_replay(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Play a run at real speed, on a page in the browser, or save it as a video.'
    )
    add_bag_arguments(parser)
    parser.add_argument(
        'other', nargs='?', type=Path, metavar='OTHER', help='a second run, to compare on the page'
    )
    parser.add_argument('--save', metavar='FILE', help='save as .mp4 or .gif, and serve no page')
    add_address_options(parser, can='watch')


def run_replay(options: Namespace) -> None:
    """Play the run."""
    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)

    if options.other and options.save is not None:
        raise UserError(f'a video shows one run: leave out {str(options.other)!r}, or --save')
    path = target(options.save, _VIDEOS) if options.save is not None else None
    source = options.bag or reader.newest()
    log = reader.read(source, options.namespace)
    title = escaped((source if source.is_dir() else source.parent).resolve().name)
    if path:
        from barc_sim.figures.views import save_video  # noqa: PLC0415

        with saving(path) as part:
            save_video(log, part, title=title)
        show(path)
        return
    from barc_sim.page import run_page  # noqa: PLC0415

    ghost = None
    if options.other:
        ghost = run_page.GhostRun(
            log=reader.read(options.other, options.namespace),
            title=escaped(options.other.resolve().name),
        )
    run_page.serve(log, title, options.view_host, options.view_port, ghost)
