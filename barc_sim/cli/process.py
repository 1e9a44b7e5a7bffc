"""What every process of barc_sim shares: errors as sentences, limits, ROS or not, signals.

`call` is where an error becomes a sentence. A UserError has its sentence already. What the machine
refuses (files, memory, threads) gets it here; every other error is a fault of ours, and keeps its
traceback.
"""

from __future__ import annotations

import errno
import io
import os
import shlex
import signal
import socket
import sys
import threading
import time
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from typing_extensions import Self


try:
    import resource
except ImportError:  # on Windows
    resource = None  # type: ignore[assignment]


USAGE_ERROR = 2
INTERRUPTED = 130
NO_BROWSER = 'BARC_SIM_NO_BROWSER'  #: in the environment: open no page, and offer none
#: The packages without which nothing of ROS works here.
ROS_PACKAGES = ('rclpy', 'barc_interfaces')
#: By package, the name to install it by, where that is another.
_DISTRIBUTIONS = {'PIL': 'pillow', 'yaml': 'pyyaml'}
_HOW = {
    'win32': 'install WSL 2 (wsl --install), and start ./scripts/run in its Ubuntu',
    'darwin': 'install RoboStack (pixi shell in the checkout), or use a container of ros:jazzy',
}
_HOW_ON_LINUX = (
    'start with ./scripts/run on x86-64; or, on Ubuntu 24.04, install ROS 2 Jazzy '
    '(sudo apt install ros-jazzy-ros-base) and source it; else use a container of ros:jazzy'
)
_MIN_MEMORY = 1 << 30  #: [B] of addresses; with less, Fast DDS can hang
_OF_OUTPUT = (errno.EPIPE, errno.ENOSPC, errno.EFBIG, errno.EIO, errno.EBADF)


def call(prog: str, main: Callable[[], int | None]) -> int:
    """Run `main` and return the command's exit code.

    A UserError becomes one line on stderr and code 2, so does what the machine refuses; Ctrl-C
    becomes code 130. A closed pipe (`| head`) ends the command silently. What stdout's encoding
    lacks is printed as `?`.
    """
    try:
        _open_streams()
        with _flushed():
            return main() or 0
    except KeyboardInterrupt:
        return INTERRUPTED
    except Exception as error:
        message = _sentence(error, prog)
        if message is None:
            raise
    if message:
        report(prog, message)
    return USAGE_ERROR if message else 0


def report(prog: str, message: str) -> None:
    """Print an error of the program `prog` on stderr, in one line."""
    print(error_line(prog, message), file=sys.stderr)  # noqa: T201


def warn(message: str) -> None:
    """Print a warning on stderr, in one line."""
    print(f'warning: {message}', file=sys.stderr, flush=True)  # noqa: T201


def error_line(prog: str, message: str) -> str:
    """Return the line for an error of the program `prog`."""
    return f'{prog}: error: {" ".join(message.splitlines())}'


def check_arguments(words: Sequence[str]) -> None:
    """Raise UserError for an argument that is no UTF-8: neither ROS nor a bag can hold it."""
    for word in words:
        if word.encode(errors='replace').decode() != word:
            raise UserError(
                f'the argument {word!r} is not UTF-8: rename the file, or type the name anew'
            )


def check_limits() -> None:
    """Let ROS open as many files as the system allows; UserError: the shell allows it no memory."""
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
    """Return whether the user sits at a screen of this machine, and allows a browser there."""
    screen = os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY')
    elsewhere = os.environ.get('SSH_CONNECTION') or os.environ.get(NO_BROWSER)
    return bool(screen) and not elsewhere


def has_ros() -> bool:
    """Return whether this Python has rclpy and the lab's messages."""
    return all(map(_is_installed, ROS_PACKAGES))


def needs_ros(what: str) -> UserError:
    """Return the error that `what` needs ROS, with what to install on this system."""
    return UserError(f'{what} needs ROS 2: {_HOW.get(sys.platform, _HOW_ON_LINUX)}')


def _is_installed(package: str) -> bool:
    try:
        spec = find_spec(package)
    except ImportError:
        return False
    # Without an origin it is no more than a folder of that name, as a checkout has.
    return spec is not None and spec.origin is not None


def _open_streams() -> None:
    """Replace the standard streams that a shell has closed."""
    for name, mode in (('stdin', 'r'), ('stdout', 'w'), ('stderr', 'w')):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding='utf-8'))  # noqa: SIM115


@contextmanager
def _flushed() -> Iterator[None]:
    """Let any text be printed, and flush stdout at the end, where a failure can be caught."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors='replace')
    try:
        yield
    finally:
        sys.stdout.flush()


def _sentence(error: Exception, prog: str) -> str | None:
    """Return an error's sentence; '' for a closed pipe, None for a fault of ours."""
    sentence = None
    if isinstance(error, UserError):
        sentence = str(error)
    elif isinstance(error, MemoryError):
        sentence = 'there is not enough memory: end other programs, or raise the limit (ulimit -v)'
    elif isinstance(error, ModuleNotFoundError):
        sentence = _missing(error, prog)
    elif isinstance(error, OSError):
        sentence = _refused(error)
    elif str(error).startswith('Key backend: '):  # Matplotlib's, if imported
        name = os.environ.get('MPLBACKEND')
        sentence = f'MPLBACKEND is {name!r}, which Matplotlib does not have: unset it'
    elif type(error).__name__ == 'RCLError':  # importing it would import ROS
        sentence = f'ROS failed: {str(error).partition(", at ")[0]}'
    return sentence


def _refused(error: OSError) -> str:
    """Return the sentence for what the system refuses: a file, or the output."""
    if error.filename is not None:
        name = os.fsdecode(error.filename) if error.filename else ''
        return f'{name!r} cannot be used ({error.strerror}): name another'
    if error.errno not in _OF_OUTPUT:
        return f'the system refuses to continue: {error.strerror or error}'
    # Python flushes stdout once more at exit: redirect that to nowhere.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):
        return ''
    return f'the output cannot be written: {error.strerror}'


def _missing(error: ModuleNotFoundError, prog: str) -> str | None:
    """Return the sentence for a package that is not installed; None for a module of ours."""
    package = (error.name or '').partition('.')[0]
    if package in ROS_PACKAGES:
        return str(needs_ros(prog))
    if package in ('', 'barc_sim'):
        return None
    name = _DISTRIBUTIONS.get(package, package)
    return (
        f'the package {package!r} is not installed in this Python: run '
        f'{shlex.join([sys.executable, "-m", "pip", "install", name])}'
    )


# Windows has no SIGHUP.
_SIGHUP = getattr(signal, 'SIGHUP', None)
#: [s] A second signal within this time repeats the first and is ignored: `timeout` signals the
#: process and then its group, and a parent can pass a terminal's Ctrl-C on.
_ECHO = 0.5
_SIGNALS = tuple(filter(None, (signal.SIGINT, signal.SIGTERM, _SIGHUP)))


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay Ctrl-C until the block has ended, in the main thread, which alone it interrupts."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if came:
        raise KeyboardInterrupt


class StopSignals:
    """While entered, a signal that would end the process calls back instead.

    A second signal ends the process, in case it hangs. After the exit the signals are ignored,
    because they would disturb the interpreter's own end.

    A handler in Python runs only between two bytecodes of the main thread, which can be waiting
    in DDS for long: the signals are read from a wake-up file descriptor by a thread of their own.
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
        # Sockets: Windows wakes nothing else.
        self._reader, self._writer = socket.socketpair()
        self._writer.setblocking(False)
        # Before the handlers, so that no signal is lost.
        signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        self._taken = [
            number
            for number in _SIGNALS
            if number != _SIGHUP or signal.getsignal(number) != signal.SIG_IGN
        ]
        for number in self._taken:
            signal.signal(number, lambda *_: None)
        threading.Thread(target=self._read_signals, name='stop signals', daemon=True).start()
        # The parent may have blocked them until now, as scripts/run does.
        if hasattr(signal, 'pthread_sigmask'):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, self._taken)
        return self

    def __exit__(self, *_: object) -> None:
        """Ignore the signals from now on."""
        for number in self._taken:
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
            callbacks, self._callbacks = self._callbacks, []
        for callback in callbacks:
            callback()
