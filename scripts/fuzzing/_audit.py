"""Notes the files that Python uses."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

_OPENING = {'open', 'os.listdir', 'os.scandir', 'subprocess.Popen'}
_CHANGING = {'mkdir', 'rename', 'remove', 'rmdir', 'link', 'symlink', 'truncate', 'chmod', 'utime'}
#: Events of Python's audit hooks.
_EVENTS = _OPENING | {f'os.{name}' for name in _CHANGING}


def note_files(notes: Path) -> None:
    """Write the paths of all files that Python uses from now on into `notes`."""
    file = os.open(notes, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
    here = Path.cwd()

    def note(event: str, arguments: tuple[Any, ...]) -> None:
        if event not in _EVENTS:
            return
        for word in _words(event, arguments):
            if isinstance(word, (str, bytes, os.PathLike)):
                path = os.path.join(here, os.fsdecode(word))  # noqa: PTH118 (no Path in a hook)
                os.write(file, os.fsencode(path) + b'\0')

    sys.addaudithook(note)


def _words(event: str, arguments: tuple[Any, ...]) -> Sequence[object]:
    """Return the arguments of an event that can be paths."""
    if event == 'open':
        return arguments[:1]
    if event == 'subprocess.Popen':
        return [word for word in arguments[1] if os.sep in word]
    return arguments[:2]
