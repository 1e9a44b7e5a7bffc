"""`new`, `report` and `submit`: a lab's templates, a run as a page, and a submission as a zip."""

from __future__ import annotations

import os
import shlex
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.files import check_plain, saving, target
from barc_sim.cli.parser import add_bag_arguments, barc_path, show
from barc_sim.cli.python import python_command
from barc_sim.errors import UserError
from barc_sim.lab.files import HANDOUTS, HILLS, Handout, files_in, find_files, handout_of

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser

PAGES = ('html',)
ARCHIVES = ('zip',)
_PATIENCE = 600.0  #: [s] for the drive over the course
_MEBIBYTE = 2**20


def add_arguments_new(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        f'Make a folder with the templates of a lab: {HILLS.written}, unless --lab names another.'
    )
    parser.epilog = 'An existing file is never overwritten.'
    parser.add_argument('folder', type=Path, metavar='DIR', help='the folder to make')
    parser.add_argument(
        '--lab',
        choices=HANDOUTS,
        default='hills',
        help='; '.join(f'{name}: {each.written}' for name, each in HANDOUTS.items())
        + ' (%(default)s)',
    )


def write_templates(folder: Path, handout: Handout = HILLS) -> None:
    """Write the templates of a lab into `folder`; make it if it does not exist.

    Examples
    --------
    >>> from pathlib import Path
    >>> write_templates(Path('lab'))
    >>> sorted(path.name for path in Path('lab').iterdir())
    ['README.md', 'bike_model.py', 'compose.py', 'controller.py', 'relay.py']
    """
    files = handout.templates()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = [name for name in files if os.path.lexists(folder / name)]
        if there:
            raise UserError(
                f'{str(folder)!r} already has {", ".join(there)}: name another folder, or move '
                'the old files'
            )
        for name, text in files.items():
            with (folder / name).open('xb') as file:
                file.write(text)
    except OSError as error:
        raise UserError(
            f'{str(folder)!r} cannot be written to ({error.strerror}): name another folder'
        ) from error


def run_new(options: Namespace) -> None:
    """Make the folder and print what to do next."""
    handout = HANDOUTS[options.lab]
    write_templates(options.folder, handout)

    barc = barc_path()
    folder = shlex.quote(str(options.folder))
    print(f'{folder}: write {handout.written}, as README.md explains')  # noqa: T201
    print(f'check   {barc} check {folder}')  # noqa: T201
    print(f'run     {barc} {handout.drive} {folder}')  # noqa: T201


def add_arguments_report(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Write plots, metrics, gains, code, graph and versions of a run as one HTML file '
        'that can be read without a network.'
    )
    add_bag_arguments(parser)
    parser.add_argument(
        '-o', '--save', metavar='FILE', help='the HTML file (report.html in the bag)'
    )


def run_report(options: Namespace) -> None:
    """Write the page and print its path."""
    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.lab.run_report import page, read  # noqa: PLC0415

    source = options.bag or reader.newest()
    directory = source if source.is_dir() else source.parent
    path = target(options.save or str(directory / 'report.html'), PAGES)
    text = page(read(source, options.namespace))
    if options.save is None:
        check_plain(directory)
    with saving(path) as part:
        part.write_text(text, encoding='utf-8')
    show(path)


def add_arguments_submit(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Pack what you hand in as one zip: code, the bags of the course and of the drive by hand '
        'with their reports (gains, plots and graph), the video, your description. A line names '
        'each missing part; the rest is packed. The command drives the course with your files at '
        'full speed.'
    )
    parser.epilog = '`barc grade` reads the zip as it is.'
    parser.add_argument('folder', type=Path, metavar='LAB', help='the folder with your files')
    parser.add_argument(
        '--save', metavar='FILE', help='the zip to write (LAB.zip in the working directory)'
    )
    parser.add_argument(
        '--teleop',
        type=Path,
        metavar='BAG',
        help='your drive by hand (the newest bag of `barc teleop` in ./bags or LAB/bags)',
    )


def run_submit(options: Namespace) -> None:
    """Write the zip, and print a line for each of its parts."""
    folder = options.folder
    find_files(folder)  # or a UserError
    path = target(options.save or f'{folder.resolve().name}.zip', ARCHIVES)
    from barc_sim.lab import submit  # noqa: PLC0415 (slow: not to refuse)

    teleop = options.teleop or submit.newest_drive((Path('bags'), folder / 'bags'))
    with saving(path) as file, tempfile.TemporaryDirectory() as bags:
        course, why = _drive(folder, Path(bags))
        parts = list(submit.collect(folder, course, why, teleop))
        submit.write(file, parts)

    for part in parts:
        show(part)
    for fault in submit.unread(path, parts):
        show(fault)
    print(f'{path}  ({path.stat().st_size / _MEBIBYTE:.1f} MiB)')  # noqa: T201


def _drive(folder: Path, bags: Path) -> tuple[Path | None, str]:
    """Drive over the course with a folder's files; return the bag, and why it failed, if it did."""
    words = handout_of(files_in(folder)).drive.split()
    words += [str(folder.absolute()), '--realtime-factor', 'max', '--engine', 'local']
    words += ['-q', '--bag-dir', str(bags)]
    try:
        # In a process of its own, which the files can end.
        done = subprocess.run(  # noqa: S603 (our own command)
            python_command('barc_sim', *words),
            cwd=bags,
            env=os.environ | {'PYTHONIOENCODING': 'utf-8'},
            capture_output=True,
            encoding='utf-8',
            errors='replace',
            timeout=_PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None, f'the drive was ended after {_PATIENCE:g} s: does your code sleep?'

    bag = next((file.parent for file in bags.glob('*/*.mcap')), None)
    if done.returncode == 0:
        return bag, ''
    lines = done.stderr.strip().splitlines() or [f'the drive ended with {done.returncode}']
    return bag, f'the drive failed: {lines[-1].removeprefix("barc acc: error: ")}'
