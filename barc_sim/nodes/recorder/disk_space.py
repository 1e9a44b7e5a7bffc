"""Free space on a disk, and how much of it recording is to leave."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path


def free(folder: Path) -> int:
    """Return what a user may still write there [B]."""
    found = os.statvfs(folder)
    return found.f_bavail * found.f_frsize


def short(available: int, reserve: int) -> str:
    """Return what to say where free space is below the reserve, both [B]."""
    return (
        f'only {available / 2**20:.1f} MiB are free, and {reserve / 2**20:g} MiB are to stay free'
    )


def check(folder: Path, reserve: int) -> None:
    """Raise UserError where less than `reserve` [B] is free for a folder that may be still to make.

    Raises
    ------
    UserError
        There is too little space.
    """
    existing = next(
        path for path in (folder.absolute(), *folder.absolute().parents) if path.exists()
    )
    available = free(existing)
    if available < reserve:
        raise UserError(
            f'no bag can be made in {str(folder)!r}, as {short(available, reserve)}: '
            'make space, name another folder, or lower --min-free-space'
        )
