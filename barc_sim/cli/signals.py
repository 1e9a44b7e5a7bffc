"""SIGINT, SIGTERM and SIGHUP as a request to stop that reaches any thread at once."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from typing_extensions import Self

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
