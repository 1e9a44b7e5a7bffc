"""Builds the package rosbag2_interfaces for tests: PyPI does not have it."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

_SOURCE = Path(__file__).parent / 'ros' / 'rosbag2_interfaces'
_PROGRAMS = Path(sys.prefix) / 'bin'


def provide_rosbag2_interfaces(cache: Path) -> dict[str, str]:
    """Make rosbag2_interfaces importable; return the environment of another process that needs it.

    The package is built once, and stays in `cache`. Under a sourced ROS 2 it is installed, or the
    test is skipped.
    """
    if find_spec('rosbag2_interfaces'):
        return {}
    if not (_PROGRAMS / 'cmake').exists():
        pytest.skip('rosbag2_interfaces is not installed, and cannot be built')

    import fcntl  # noqa: PLC0415 (not on Windows)

    prefix = cache / _digest()
    with (cache / 'lock').open('w', encoding='utf-8') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not prefix.exists():
            _build(prefix)

    (packages,) = prefix.glob('lib/python3*/site-packages')
    sys.path.append(str(packages))
    for library in prefix.glob('lib/*.so'):  # rmw looks for them by name
        ctypes.CDLL(str(library))
    libraries = [str(prefix / 'lib'), os.environ.get('LD_LIBRARY_PATH', '')]
    return {
        'PYTHONPATH': os.pathsep.join([str(_SOURCE.parents[2]), str(packages)]),
        'LD_LIBRARY_PATH': os.pathsep.join(libraries),
    }


def _digest() -> str:
    """Return a name for what is built, from its source and this Python."""
    digest = hashlib.sha256(f'{sys.prefix} {sys.version}'.encode())
    for path in sorted(_SOURCE.rglob('*')):
        if path.is_file():
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _build(prefix: Path) -> None:
    """Build and install the package."""
    environment = os.environ | {'PATH': f'{_PROGRAMS}{os.pathsep}{os.environ["PATH"]}'}
    for name in ('PYTHONPATH', 'AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH'):
        environment.pop(name, None)
    part = prefix.with_suffix('.part')
    shutil.rmtree(part, ignore_errors=True)

    with TemporaryDirectory() as build:
        configure = [
            'cmake', '-G', 'Ninja', '-S', str(_SOURCE), '-B', build, '-DSKBUILD=1',
            f'-DCMAKE_PREFIX_PATH={sys.prefix}', f'-DCMAKE_INSTALL_PREFIX={part}',
            f'-DPython3_EXECUTABLE={sys.executable}',
        ]  # fmt: skip
        for command in (configure, ['cmake', '--build', build], ['cmake', '--install', build]):
            done = subprocess.run(
                command, env=environment, check=False, capture_output=True, text=True
            )
            assert done.returncode == 0, done.stdout + done.stderr
    part.rename(prefix)
