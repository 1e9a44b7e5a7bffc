"""The files that a submission's process needs: standard library, NumPy, shared libraries."""

from __future__ import annotations

import importlib.util
import os
import sys
import sysconfig
from functools import cache
from pathlib import Path
from typing import NamedTuple

_OTHER_PACKAGES = {'site-packages', 'dist-packages'}


class Readable(NamedTuple):
    """Paths for a Landlock ruleset."""

    readable: tuple[Path, ...]
    listable: tuple[Path, ...]
    writable: tuple[Path, ...] = (Path(os.devnull),)


@cache
def python() -> Readable:
    """Return what Python and NumPy read, and nothing of other packages, such as barc_sim itself.

    The folder of the standard library can contain other packages, so its parts are listed one by
    one. Imports must also read the names in that folder.
    """
    library = Path(os.__file__).parent
    parts = [path for path in library.iterdir() if path.name not in _OTHER_PACKAGES]
    extensions = Path(str(sysconfig.get_config_var('DESTSHARED') or library / 'lib-dynload'))
    return Readable(
        readable=(*parts, extensions, *_numpy(), *_shared_libraries()), listable=(library,)
    )


def numpy_folder() -> Path:
    """Return the folder of NumPy's package."""
    spec = importlib.util.find_spec('numpy')
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError('NumPy is not installed')
    return Path(spec.origin).resolve().parent


def _numpy() -> tuple[Path, ...]:
    folder = numpy_folder()
    # Beside it, where NumPy came as a wheel, the libraries that it needs.
    return folder, folder.with_name('numpy.libs')


def _shared_libraries() -> list[Path]:
    """Return the shared libraries, file by file: on some systems their folders hold packages."""
    folders = {Path(sys.base_prefix, 'lib')}
    with Path('/proc/self/maps').open(encoding='utf-8', errors='replace') as maps:
        for line in maps:
            path = Path(line.split(maxsplit=5)[-1].rstrip())
            if path.name.startswith(('libc.', 'libc-', 'libm.', 'libstdc++.')):
                folders.add(path.parent)
    found = [path for folder in sorted(folders) for path in folder.glob('*.so*')]
    return [Path('/etc/ld.so.cache'), *found]
