"""Makes the directory of a bag, `<root>/<date>_<time>`, where there is space; overwrites none."""

from __future__ import annotations

import os
import shutil
import time
from typing import TYPE_CHECKING

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

_TRIES = 10


def check_root(root: Path) -> None:
    """Raise UserError if no bag can be made in the folder `root`; nothing is written."""
    path = root.absolute()
    folder = next(folder for folder in (path, *path.parents) if folder.exists())
    if not folder.is_dir():
        reason = f'{str(folder)!r} is not a folder'
    elif not os.access(folder, os.W_OK | os.X_OK):
        reason = f'{str(folder)!r} is not writable'
    else:
        return
    raise UserError(f'no bag can be made in {str(root)!r}, as {reason}: name another folder')


def free_space(folder: Path) -> int:
    """Return the space that a user may still fill on the disk of `folder` [B]."""
    return shutil.disk_usage(folder).free


def short_of_space(free: int, reserve: int) -> str:
    """Return the clause for free space below the reserve, both [B].

    Examples
    --------
    >>> short_of_space(free=10 << 20, reserve=64 << 20)
    'only 10.0 MiB are free, and 64 MiB must stay free'
    """
    return f'only {free / 2**20:.1f} MiB are free, and {reserve / 2**20:g} MiB must stay free'


def check_space(folder: Path, reserve: int) -> None:
    """Raise UserError if less than `reserve` [B] is free for `folder`, which need not exist yet."""
    existing = next(
        path for path in (folder.absolute(), *folder.absolute().parents) if path.exists()
    )
    free = free_space(existing)
    if free < reserve:
        raise UserError(
            f'no bag can be made in {str(folder)!r}, as {short_of_space(free, reserve)}: '
            'make space, name another folder, or lower --min-free-space'
        )


def make_directory(path: Path) -> Path:
    """Make and return the directory `path`.

    Raises
    ------
    UserError
        It exists, or cannot be made.
    """
    check_root(path.parent)
    try:
        path.mkdir(parents=True)
    except FileExistsError:
        raise UserError(f'{str(path)!r} exists: name a new folder for the bag') from None
    except OSError as error:
        raise UserError(
            f'the bag {str(path)!r} cannot be made ({error.strerror}): name another folder'
        ) from error
    return path


def new_directory(root: Path) -> Path:
    """Make and return `<root>/<YYYY-MM-DD>_<HH-MM-SS>`, with a number at the end if that exists.

    Raises
    ------
    UserError
        The directory cannot be made.

    Examples
    --------
    >>> new_directory(Path('bags')).parent.name
    'bags'
    """
    check_root(root)
    name = time.strftime('%Y-%m-%d_%H-%M-%S')
    suffix, vanished = 1, 0
    while True:
        directory = root / (name if suffix == 1 else f'{name}_{suffix}')
        try:
            root.mkdir(parents=True, exist_ok=True)
            directory.mkdir()
        except FileExistsError:
            suffix += 1
        except OSError as error:
            # A run that began together with this one, and ended at once, may have removed the root.
            vanished += isinstance(error, FileNotFoundError)
            if not 0 < vanished < _TRIES:
                raise UserError(
                    f'no bag can be made in {str(root)!r} ({error.strerror}): name another folder'
                ) from error
        else:
            return directory
