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
_BYTE = '([0-9a-f]{2})'
# Vendor, host, then the process's number, its lowest byte first.
_DATA_SHARING = re.compile(
    rf'fast_datasharing_01\.0f\.[0-9a-f]{{2}}\.[0-9a-f]{{2}}\.{_BYTE}\.{_BYTE}\.'
)


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

    Each writer has a file `fast_datasharing_<GUID>`, too, without a lock. The GUID has the lower
    half of its process's number: the file stays while any process has such a number, or while a
    container that shares the folder, and hides its processes, uses Fast DDS.
    """
    removed = 0
    with suppress(OSError):
        names = [path.name for path in folder.iterdir()]
        for name in names:
            if (found := _LOCK.fullmatch(name)) and _is_old(folder / name, least_age):
                removed += _remove(folder / name, folder / found[1])
        locks = [folder / name for name in names if _LOCK.fullmatch(name)]
        shared = [(n, *found.groups()) for n in names if (found := _DATA_SHARING.match(n))]
        if shared and not _held_by_hidden_processes(locks):
            processes = [path.name for path in Path('/proc').iterdir()]
            living = {int(number) & 0xFFFF for number in processes if number.isdecimal()}
            for name, low, high in shared:
                if int(high + low, 16) not in living and _is_old(folder / name, least_age):
                    folder.joinpath(name).unlink(missing_ok=True)
                    removed += 1
    return removed


def _held_by_hidden_processes(locks: list[Path]) -> bool:
    """Return whether a lock is held, and by no process of which the system shows us the locks."""
    shown = {
        int(line.split()[5].rpartition(':')[2])
        for line in Path('/proc/locks').read_text(encoding='ascii').splitlines()
        if '->' not in line
    }
    for lock in locks:
        with suppress(FileNotFoundError), lock.open('rb') as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                if os.fstat(file.fileno()).st_ino not in shown:
                    return True
    return False


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
