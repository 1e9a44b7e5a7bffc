"""Makes a folder with the lab's templates."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import barc_path
from barc_sim.errors import UserError
from barc_sim.lab.handout import COMPOSE, FILES, templates

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        f'Make a folder with templates of {", ".join(FILES.values())} and {COMPOSE}.'
    )
    parser.epilog = 'An existing file is never overwritten.'
    parser.add_argument('folder', type=Path, metavar='DIR', help='the folder to make')


def write(folder: Path) -> None:
    """Write the templates into `folder`; make it if it does not exist.

    Raises
    ------
    UserError
        where one of the files exists already, or the folder cannot be written to.

    Examples
    --------
    >>> from pathlib import Path
    >>> write(Path('lab'))
    >>> sorted(path.name for path in Path('lab').iterdir())
    ['README.md', 'bike_model.py', 'compose.py', 'controller.py', 'relay.py']
    """
    files = templates()
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


def run(options: Namespace) -> None:
    """Make the folder and print what to do next.

    Raises
    ------
    UserError
        where the folder has such files already, or cannot be written to.
    """
    write(options.folder)
    barc, folder = barc_path(), shlex.quote(str(options.folder))
    print(f'{folder}: write {", ".join(FILES.values())}, {COMPOSE}, as README.md explains')  # noqa: T201
    print(f'check   {barc} check {folder}')  # noqa: T201
    print(f'run     {barc} acc --lab {folder}')  # noqa: T201
