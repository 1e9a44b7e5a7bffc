"""What killed processes have left of DDS in /dev/shm.

Fast DDS gives each participant a segment `fastrtps_<16 hex digits>` of half a megabyte there, and a
file `..._el` that its process holds locked. A killed process leaves both, nobody uses them again,
and where /dev/shm is small, as in a container, it is full after a hundred. What participants
share, the ports, Fast DDS mends itself.
"""

from __future__ import annotations

import fcntl
import os
import re
import time
from contextlib import suppress
from pathlib import Path

_FOLDER = Path('/dev/shm')  # noqa: S108 (where Fast DDS has it)
_LOCK = re.compile(r'(fastrtps_[0-9a-f]{16})_el')
#: [s] A lock that is younger may be about to be taken by who has made it.
_YOUNG = 10.0


def sweep(folder: Path = _FOLDER) -> int:
    """Remove this user's segments whose owner is gone; return how many."""
    removed = 0
    with suppress(OSError):
        for lock in folder.iterdir():
            if (name := _LOCK.fullmatch(lock.name)) and _is_left(lock):
                removed += _remove(lock, folder / name[1])
    return removed


def _is_left(lock: Path) -> bool:
    with suppress(OSError):
        status = lock.lstat()
        return status.st_uid == os.getuid() and time.time() - status.st_ctime > _YOUNG
    return False


def _remove(lock: Path, segment: Path) -> bool:
    """Remove both while holding the lock, which only its owner's end has freed."""
    with suppress(OSError), lock.open('rb') as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        segment.unlink(missing_ok=True)
        lock.unlink(missing_ok=True)
        return True
    return False
