"""What every process of barc_sim shares: limits of the system, the check for ROS, and signals."""

from __future__ import annotations

import os
import signal
import socket
import sys
import sysconfig
import threading
import time
from contextlib import contextmanager, suppress
from glob import escape
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from typing_extensions import Self


try:
    import resource
except ImportError:  # on Windows
    resource = None  # type: ignore[assignment]


NO_BROWSER = 'BARC_SIM_NO_BROWSER'  #: if set in the environment, open no page, and offer none
#: The packages without which nothing of ROS works here.
ROS_PACKAGES = ('rclpy', 'barc_interfaces')
_HOW = {
    'win32': 'install WSL 2 (wsl --install), and start ./scripts/run in its Ubuntu',
    'darwin': 'install RoboStack (pixi shell in the checkout), or use a container of ros:jazzy',
}
_HOW_ON_LINUX = (
    'start with ./scripts/run on x86-64; or, on Ubuntu 24.04, install ROS 2 Jazzy '
    '(sudo apt install ros-jazzy-ros-base) and source it; else use a container of ros:jazzy'
)
#: In a workspace. colcon does not look for a package inside another one.
_BUILD = 'colcon build --base-paths src src/barc_sim/barc_interfaces'
_MIN_MEMORY = 1 << 30  #: [B] of addresses; with less, Fast DDS can hang


def check_limits() -> None:
    """Let ROS open as many files as the system allows; UserError: the memory limit is too low."""
    if not resource:
        return

    _, maximum = resource.getrlimit(resource.RLIMIT_NOFILE)
    with suppress(ValueError, OSError):  # many cars need more than the usual 1024
        resource.setrlimit(resource.RLIMIT_NOFILE, (maximum, maximum))

    memory, _ = resource.getrlimit(resource.RLIMIT_AS)
    if memory != resource.RLIM_INFINITY and memory < _MIN_MEMORY:
        raise UserError(
            f'this shell allows {memory >> 20} MiB of memory, and ROS needs {_MIN_MEMORY >> 20}: '
            'raise the limit with ulimit -v'
        )


def is_at_desktop() -> bool:
    """Return whether the user works at a screen of this machine, and allows a browser there."""
    screen = os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY')
    has_no_browser = os.environ.get('SSH_CONNECTION') or os.environ.get(NO_BROWSER)
    return bool(screen) and not has_no_browser


def has_ros() -> bool:
    """Return whether this Python has rclpy and the lab's messages."""
    return all(map(_is_installed, ROS_PACKAGES))


def has_only_rclpy() -> bool:
    """Return whether this Python has rclpy, but not the lab's messages."""
    rclpy, messages = map(_is_installed, ROS_PACKAGES)
    return rclpy and not messages


def needs_ros(user: str) -> UserError:
    """Return the error that `user` needs ROS, with what to install or build on this system."""
    if has_only_rclpy():
        return UserError(
            f"{user} needs the messages of barc_interfaces, which are not built: run '{_BUILD}' in "
            'the workspace, and source it'
        )
    return UserError(f'{user} needs ROS 2: {_HOW.get(sys.platform, _HOW_ON_LINUX)}')


def require_ros(user: str) -> None:
    """Raise UserError if `user` cannot use ROS here; call it before anything imports rclpy."""
    if not has_ros():
        raise needs_ros(user)

    packages = Path(sysconfig.get_path('platlib'))
    library_folders: list[str] = []
    if (packages / 'rclpy' / '__init__.py').exists():
        _check_origin(packages)
    else:
        library_folders = os.environ.get('LD_LIBRARY_PATH', '').split(os.pathsep)
    _check_middleware(library_folders)


def _check_origin(packages: Path) -> None:
    """Raise UserError if another ROS hides the rclpy in `packages`: its libraries do not fit."""
    origin = Path(_origin('rclpy') or '').parents[1]
    if not origin.samefile(packages):
        raise UserError(
            f'PYTHONPATH puts the rclpy in {str(origin)!r} before that in {sys.prefix!r}: open a '
            'terminal that sources no other ROS, or unset PYTHONPATH'
        )


def _check_middleware(folders: list[str]) -> None:
    """Raise UserError if neither this Python nor the `folders` have the middleware in use.

    ROS would end the process.
    """
    name = os.environ.get('RMW_IMPLEMENTATION')
    if not name:
        return

    pattern = f'lib{escape(name)}.*'
    for folder in [f'{sys.prefix}/lib', *filter(None, folders)]:
        if any(Path(folder).glob(pattern)):
            return
    raise UserError(f'RMW_IMPLEMENTATION is {name!r}, which is not installed in this ROS: unset it')


def _is_installed(package: str) -> bool:
    return _origin(package) is not None


def _origin(package: str) -> str | None:
    """Return the file of a package; None if it is not installed."""
    try:
        spec = find_spec(package)
    except ImportError:
        return None
    # Without an origin it is only a folder with that name, as in a checkout.
    return spec.origin if spec else None


# Windows has no SIGHUP.
_SIGHUP = getattr(signal, 'SIGHUP', None)
#: [s] A second signal within this time repeats the first and is ignored: `timeout` signals the
#: process and then its group, and a parent can pass a terminal's Ctrl-C on.
_ECHO = 0.5
_SIGNALS = tuple(filter(None, (signal.SIGINT, signal.SIGTERM, _SIGHUP)))


@contextmanager
def interruptible() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt, for a command that has something to end in order.

    Before and after it, Ctrl-C ends a process that `barc_sim.run` has started at once: Python's
    imports and its own end would print a traceback.
    """
    if signal.getsignal(signal.SIGINT) is not signal.SIG_DFL:
        yield
        return

    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)


class StopSignals:
    """Within its block, a signal that would end the process calls the callbacks instead.

    A second signal ends the process, in case it hangs. After the block the signals are ignored,
    because they would disturb the interpreter's own end.

    A handler in Python runs only between two bytecodes of the main thread, which can wait in DDS
    for long. So a separate thread reads the signals from a wake-up file descriptor.
    """

    def __init__(self) -> None:
        self.requested = threading.Event()
        self._callbacks: list[Callable[[], object]] = []
        self._lock = threading.Lock()

    def then(self, callback: Callable[[], object]) -> None:
        """Call `callback` from another thread on a signal; at once if one has come already."""
        with self._lock:
            if not self.requested.is_set():
                self._callbacks.append(callback)
                return
        callback()

    def __enter__(self) -> Self:
        """Handle the signals, except SIGHUP if it is ignored already (`nohup`)."""
        # Sockets: on Windows nothing else can be a wake-up file descriptor.
        self._reader, self._writer = socket.socketpair()
        self._writer.setblocking(False)
        # Before the handlers, so that no signal is lost.
        signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)

        self._signals = [
            number
            for number in _SIGNALS
            if number != _SIGHUP or signal.getsignal(number) != signal.SIG_IGN
        ]
        for number in self._signals:
            signal.signal(number, _ignore)
        threading.Thread(target=self._read_signals, name='stop signals', daemon=True).start()

        # The parent may have blocked them until now, as scripts/run does.
        if hasattr(signal, 'pthread_sigmask'):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, self._signals)
        return self

    def __exit__(self, *_: object) -> None:
        """Ignore the signals from now on."""
        for number in self._signals:
            signal.signal(number, signal.SIG_IGN)
        signal.set_wakeup_fd(-1)
        self._writer.close()

    def _read_signals(self) -> None:
        with self._reader as signals:
            while number := signals.recv(1):
                if not self.requested.is_set():
                    first = time.monotonic()
                    self._request()
                elif time.monotonic() - first > _ECHO:
                    os._exit(128 + number[0])

    def _request(self) -> None:
        with self._lock:
            self.requested.set()
            callbacks = self._callbacks
            self._callbacks = []

        for callback in callbacks:
            callback()


def _ignore(*_: object) -> None:
    """Do nothing for a signal: its number is read from the wake-up file descriptor."""
