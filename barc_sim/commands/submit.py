"""Packs what a student hands in as one zip."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.files import saving, target
from barc_sim.errors import UserError, escaped
from barc_sim.runs.carrier import add_engine_option, uses_ros

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser

FORMATS = ('zip',)
_PATIENCE = 600.0  #: [s] for the drive over the course


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Pack what you hand in as one zip: code, gains, the bag of the course with its plot and '
        'report, bag and video of the drive by hand, the graph, your description. Each part that '
        'is missing is named in a line; the rest is packed.'
    )
    parser.epilog = 'barc grade takes the zip as it is.'
    parser.add_argument('folder', type=Path, metavar='LAB', help='your folder')
    parser.add_argument(
        '--save', metavar='FILE', help='the zip to write (the name of your folder, here)'
    )
    parser.add_argument(
        '--course',
        type=Path,
        metavar='BAG',
        help='your drive over the course (one is made with your files, without waiting)',
    )
    parser.add_argument(
        '--teleop',
        type=Path,
        metavar='BAG',
        help='your drive by hand (the newest of teleop in ./bags or LAB/bags)',
    )
    parser.add_argument(
        '--video',
        type=Path,
        metavar='FILE',
        help="of your drive by hand (the newest in LAB, or in that drive's bag)",
    )
    add_engine_option(parser)


def run(options: Namespace) -> None:
    """Write the zip, and print a line for each of its parts.

    Raises
    ------
    UserError
        where there is no such folder, no ROS for the engine, or the zip cannot be written.
    """
    from barc_sim.lab import submit  # noqa: PLC0415

    folder = options.folder
    if not folder.is_dir():
        raise UserError(
            f'there is no folder {str(folder)!r}: name the one with your files; '
            f'barc new {shlex.quote(str(folder))} writes one'
        )
    path = target(options.save or f'{folder.resolve().name}.zip', FORMATS)
    ros = uses_ros(options)
    bags = (Path('bags'), folder / 'bags')
    teleop = options.teleop or submit.newest_drive(bags, 'teleop')
    beside = [] if teleop is None else [teleop if teleop.is_dir() else teleop.parent]
    named = options.video
    if named and named.is_symlink():  # the user's own, unlike one in a folder
        named = Path(os.path.realpath(named))
    video = named or submit.newest_video([folder, *beside])
    with saving(path) as part, tempfile.TemporaryDirectory() as made:
        course, why = options.course, ''
        if course is None:
            course, why = _drive(folder, Path(made), 'ros' if ros else 'local')
        parts = [*submit.collect(folder, course, why, teleop, video)]
        submit.write(part, parts)
    for line in parts:
        print(escaped(str(line)))  # noqa: T201
    print(f'{path}  ({submit.size(path)})')  # noqa: T201


def _drive(folder: Path, bags: Path, engine: str) -> tuple[Path | None, str]:
    """Drive over the course with a folder's files; return the bag, and why it ended badly."""
    options = ['--lab', str(folder), '--realtime-factor', 'max', '--engine', engine]
    try:
        # In a process of its own, which the files can end.
        done = subprocess.run(  # noqa: S603 (our own command)
            [sys.executable, '-m', 'barc_sim', 'acc', '-q', '--bag-dir', str(bags), *options],
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
    return bag, lines[-1].removeprefix('barc acc: error: ')
