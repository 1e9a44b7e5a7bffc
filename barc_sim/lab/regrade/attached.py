"""User code that is attached to a bag, at work in a confined process."""

from __future__ import annotations

import tempfile
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from barc_sim.errors import UserError
from barc_sim.lab.grade.code import ConfinedCode
from barc_sim.lab.user_code.loading import FILES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barc_sim.lab.regrade.recorded import Recorded


@contextmanager
def attached(recorded: Recorded, part: str, *, sandbox: bool = True) -> Iterator[ConfinedCode]:
    """Have a part of the attached code, and no other, ready to be called.

    Raises
    ------
    UserError
        where there is something wrong with the files, or nothing here can confine them.
    """
    with tempfile.TemporaryDirectory(prefix='barc_sim_') as name:
        folder = Path(name)
        _unpack(recorded, part, folder)
        with ConfinedCode(folder, sandbox=sandbox) as code:
            yield code


def _unpack(recorded: Recorded, part: str, folder: Path) -> None:
    """Write a part's file, by its usual name, and those beside it."""
    own = PurePosixPath(recorded.files[part])
    for name, data in recorded.sources.items():
        path = PurePosixPath(name)
        if path.is_absolute() or '..' in path.parts or '\0' in name:
            raise UserError(f'the bag has a file {name!r} attached, which no run attaches')
        if path.is_relative_to(own.parent):
            target = folder / path.relative_to(own.parent)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
    (folder / FILES[part]).write_bytes(recorded.sources[recorded.files[part]])
