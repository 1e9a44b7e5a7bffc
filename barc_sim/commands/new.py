"""Command: write a folder with the lab's templates."""

from __future__ import annotations

import shlex
import sys
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence

PROG = 'barc new'
_FILES = ('README.md', 'bike_model.py', 'controller.py', 'relay.py')


def parse(argv: Sequence[str] | None = None) -> Namespace:
    """Return the options on the command line."""
    parser = Parser(
        prog=PROG,
        description='Write a folder with the templates of bike_model.py, controller.py, relay.py.',
        epilog='A file that is there already is never written over.',
    )
    parser.add_argument('folder', type=Path, metavar='DIR', help='the folder to make')
    return parser.parse_args(argv)


def write(folder: Path) -> None:
    """Write the templates into `folder`, which is made unless it is there.

    Raises
    ------
    UserError
        where it has one of the files already, or can't be written to.
    """
    template = resources.files('barc_sim.lab') / 'templates'
    texts = {name: (template / name).read_bytes() for name in _FILES}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = [name for name in _FILES if (folder / name).exists()]
        if there:
            raise UserError(
                f'{str(folder)!r} has {", ".join(there)} already: name another folder, or move '
                'what is there'
            )
        for name, text in texts.items():
            with (folder / name).open('xb') as file:
                file.write(text)
    except OSError as error:
        raise UserError(
            f'{str(folder)!r} cannot be written to ({error.strerror}): name another folder'
        ) from error


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = parse(argv)

    def run() -> None:
        write(options.folder)
        folder = shlex.quote(str(options.folder))
        print(f'{folder}: write bike_model.py, controller.py and relay.py; README.md says how')  # noqa: T201
        print(f'check   python -m barc_sim check {folder}')  # noqa: T201
        print(f'run     python -m barc_sim.run acc --lab {folder}')  # noqa: T201

    return call(PROG, run)


if __name__ == '__main__':
    sys.exit(main())
