"""Fast DDS's use of memory: its profiles, and what killed processes leave in /dev/shm."""

from __future__ import annotations

import fcntl
import os
import re
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import MutableMapping

_PROFILES = Path(__file__).with_suffix('.xml')
_VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
#: Without it, rmw overrides how histories use memory. ROS's QoS settings win over the profiles
#: either way.
_USE_PROFILES = 'RMW_FASTRTPS_USE_QOS_FROM_XML'

_SHARED_MEMORY = Path('/dev/shm')  # noqa: S108 (where Fast DDS has it)
_LOCK = re.compile(r'(fastrtps_[0-9a-f]{16})_el')


def use_profiles(environment: MutableMapping[str, str] = os.environ) -> None:
    """Set our profiles in `environment`, unless the user has set others there."""
    if not any(name in environment for name in (*_VARIABLES, _USE_PROFILES)):
        environment[_VARIABLES[0]] = str(_PROFILES)
        environment[_USE_PROFILES] = '1'


def sweep(folder: Path = _SHARED_MEMORY, least_age: float = 10.0) -> int:
    """Remove this user's shared-memory segments whose process is dead; return how many.

    Fast DDS gives each participant a segment `fastrtps_<16 hex digits>` of half a megabyte, and a
    file `..._el` that its process holds locked. A killed process leaves both, nobody uses them
    again, and after a hundred of them the small /dev/shm of a container is full. Fast DDS itself
    repairs what participants share, the ports.

    A lock younger than `least_age` [s] stays: its process may be about to take it.
    """
    removed = 0
    with suppress(OSError):
        names = [path.name for path in folder.iterdir()]
        for name in names:
            if (found := _LOCK.fullmatch(name)) and _is_old(folder / name, least_age):
                removed += _remove(folder / name, folder / found[1])
    return removed


def _is_old(lock: Path, least_age: float) -> bool:
    with suppress(OSError):
        status = lock.lstat()
        return status.st_uid == os.getuid() and time.time() - status.st_ctime > least_age
    return False


def _remove(lock: Path, segment: Path) -> bool:
    """Remove both under the lock, which is free once its process has ended."""
    with suppress(OSError), lock.open('rb') as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        segment.unlink(missing_ok=True)
        lock.unlink(missing_ok=True)
        return True
    return False
