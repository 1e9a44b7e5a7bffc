"""Makes a Python on Linux lack what other systems lack, and ROS; a folder for PYTHONPATH.

Python runs this at its start, also in the processes that a command starts. Python's own library
keeps the modules that it imports by itself, as asyncio does.
"""

from __future__ import annotations

import builtins
import os
import pathlib
import select
import shutil
import signal
import sys
import sysconfig
import time
import warnings
from contextlib import suppress
from typing import Any

_ROS = {'barc_interfaces', 'rclpy', 'rosidl_runtime_py', 'rpyutils'}
_MODULES = {'fcntl', 'grp', 'pty', 'pwd', 'resource', 'termios', 'tty'}
_FOLDERS = ('/proc', '/sys')
_NAMES = {
    os: (
        *('eventfd', 'fork', 'forkpty', 'getpgrp', 'getuid', 'geteuid', 'killpg', 'mkfifo'),
        *('pidfd_open', 'posix_fallocate', 'sched_getaffinity', 'setsid', 'tcgetpgrp'),
        *('memfd_create', 'pread', 'pwrite', 'sched_setaffinity', 'setpriority', 'wait4'),
        *('O_DIRECTORY', 'O_NOFOLLOW', 'O_NONBLOCK', 'O_PATH'),
    ),
    select: ('epoll', 'poll'),
    signal: ('SIGHUP', 'SIGALRM', 'pause', 'pthread_kill', 'pthread_sigmask', 'setitimer'),
    time: ('clock_gettime', 'clock_gettime_ns', 'pthread_getcpuclockid'),
}
_import = builtins.__import__


class _NoRos:
    """Finds nothing of ROS."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> None:  # noqa: ANN401
        """Refuse what is of ROS, and pass on all else."""
        del path, target
        top = name.partition('.')[0]
        if top in _ROS or top.endswith(('_msgs', '_interfaces')):
            raise ModuleNotFoundError(f'No module named {name!r}', name=top)


def _import_elsewhere(name: str, names: Any = None, *rest: Any, **options: Any) -> Any:  # noqa: ANN401
    if name in _MODULES and names and str(names.get('__name__')).startswith('barc_sim'):
        raise ModuleNotFoundError(f'No module named {name!r}', name=name)
    return _import(name, names, *rest, **options)


def _refuse(event: str, arguments: tuple[Any, ...]) -> None:
    if event == 'open' and str(arguments[0]).startswith(_FOLDERS):
        raise FileNotFoundError(2, 'there is no such file on this system', arguments[0])
    if event in {'os.rename', 'os.remove'}:
        # Windows renames and removes no file that is open.
        for path in (each for each in arguments[:2] if isinstance(each, (str, os.PathLike))):
            if os.path.realpath(path) in _open_files():
                raise PermissionError(13, 'it is open', path)


def _open_files() -> set[str]:
    files = set()
    for link in pathlib.Path('/proc/self/fd').iterdir():
        with suppress(OSError):
            files.add(str(link.readlink()))
    return files


# With -X warn_default_encoding: the encoding of a text file must not be the system's.
warnings.filterwarnings('ignore', category=EncodingWarning)
warnings.filterwarnings('error', category=EncodingWarning, module='barc_sim')
sys.meta_path.insert(0, _NoRos())
sys.addaudithook(_refuse)
builtins.__import__ = _import_elsewhere
sysconfig.get_config_vars()  # which it reads from a file named after the platform
sys.platform = 'elsewhere'
# Python's own choices where these are lacking.
shutil._use_fd_functions = False  # noqa: SLF001
if hasattr(os, 'process_cpu_count'):
    os.process_cpu_count = os.cpu_count
for module, names in _NAMES.items():
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
