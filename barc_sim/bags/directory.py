"""The directory of a new bag, and the space on its disk."""

from __future__ import annotations

import os
import shutil
import time
from typing import TYPE_CHECKING

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

MEBIBYTE = 2**20  #: [B]
_TRIES = 1000


def _existing(folder: Path) -> Path:
    """Return the folder, or the nearest folder above it that exists."""
    path = folder.absolute()
    return next(ancestor for ancestor in (path, *path.parents) if ancestor.exists())


def check_root(root: Path) -> None:
    """Raise UserError if no bag can be made in the folder `root`; nothing is written."""
    folder = _existing(root)
    reason = ''
    if not folder.is_dir():
        reason = f'{str(folder)!r} is not a folder'
    elif not os.access(folder, os.W_OK | os.X_OK):
        reason = f'{str(folder)!r} is not writable'
    if reason:
        raise UserError(f'no bag can be made in {str(root)!r}, as {reason}: name another folder')


def short_of_space(folder: Path, reserve: int) -> str | None:
    """Return why the disk of `folder` is too full, None if `reserve` [B] is free."""
    free = shutil.disk_usage(folder).free
    if free >= reserve:
        return None
    return f'only {free / MEBIBYTE:.1f} MiB are free, and {reserve / MEBIBYTE:g} MiB must stay free'


def check_space(folder: Path, reserve: int) -> None:
    """Raise UserError if less than `reserve` [B] is free for `folder`, which need not exist yet."""
    shortage = short_of_space(_existing(folder), reserve)
    if shortage:
        raise UserError(
            f'no bag can be made in {str(folder)!r}, as {shortage}: '
            'make space, name another folder, or lower --min-free-space'
        )


def make_directory(path: Path | None, root: Path) -> Path:
    """Make the directory of a bag and return it.

    Parameters
    ----------
    path
        The directory to make; None: a new one with a name `<date>_<time>`.
    root
        The folder for the latter.

    Raises
    ------
    UserError
        It cannot be made.
    """
    check_root(path.parent if path else root)
    for directory in [path] if path else _dated_paths(root):
        try:
            directory.mkdir(parents=True)
        except OSError as error:  # noqa: PERF203
            failure = error
            if not isinstance(error, FileExistsError):
                break
        else:
            return directory
    raise UserError(
        f'the bag {str(directory)!r} cannot be made ({failure.strerror}): name another folder'
    ) from failure


def _dated_paths(root: Path) -> Iterator[Path]:
    """Yield the paths to try for a bag without a name."""
    date = time.strftime('%Y-%m-%d_%H-%M-%S')
    yield root / date
    for number in range(2, _TRIES):
        yield root / f'{date}_{number}'
