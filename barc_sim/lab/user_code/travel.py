"""Brings a user's files to another process or machine, as bytes."""

from __future__ import annotations

import ast
import os
import shutil
import tempfile
from functools import cache
from multiprocessing.util import Finalize
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.lab.files import UserCodeError, compiled, read_source

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barc_sim.lab.files import Source
    from barc_sim.lab.user_code.folder import Folder

    #: The files of a folder: their names in it, and their bytes.
    Files = tuple[tuple[str, bytes], ...]


class SentCode(NamedTuple):
    """The files of user code, as they are sent."""

    folders: tuple[Files, ...]
    parts: tuple[SentPart, ...]
    budget: float  #: [s] of each call


class SentPart(NamedTuple):
    """The file of a part, such as the controller."""

    part: str
    folder: int  #: its number in `SentCode.folders`
    name: str  #: of the file in the folder


def needed_files(folder: Folder, paths: list[Path]) -> Files:
    """Return the files of `paths`, all of one folder, and those that they import in it.

    Imports inside of functions count, too. A file that is loaded has the bytes that were loaded.
    """
    files: dict[str, bytes] = {}
    waiting = [*paths, *(source.path for source in folder.sources.values())]
    while waiting:
        path = waiting.pop()
        name = str(path.relative_to(folder.path))
        if name in files:
            continue
        source = folder.sources.get(str(path)) or read_source(path, name)
        files[name] = source.data
        for module in _imported(source):
            waiting += folder.files_of(module)
    return tuple(sorted(files.items()))


def _imported(source: Source) -> Iterator[str]:
    """Yield the packages and modules that a file imports anywhere; a broken file imports none."""
    try:
        tree = compiled(source).tree
    except UserCodeError:
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.partition('.')[0]
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            for alias in node.names:
                yield alias.name.partition('.')[0]


def written(sent: SentCode) -> dict[str, Path]:
    """Write the files that were sent to folders of this process; return those of the parts.

    Equal files are written once. They are removed when the process ends.
    """
    places = [_written_folder(files, os.getpid()) for files in sent.folders]
    return {each.part: places[each.folder] / each.name for each in sent.parts}


@cache
def _written_folder(files: Files, _process: int) -> Path:
    """Write files to a new folder; a forked process does not use the folders of its parent."""
    folder = Path(tempfile.mkdtemp(prefix='barc_sim_'))
    # `atexit` does not call back in all processes of `multiprocessing`.
    Finalize(None, shutil.rmtree, (folder, True), exitpriority=0)
    for name, data in files:
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)
    return folder
