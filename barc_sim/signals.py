"""SIGINT, SIGTERM and SIGHUP as a request to stop, heard at once from any thread."""

from __future__ import annotations

import os
import signal
import socket
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType
    from typing import Any

    from typing_extensions import Self

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StopSignals:
    """While entered, a signal that would end the process calls back instead; a second one ends it.

    A handler in Python runs only between two bytecodes of the main thread, which may be waiting
    in DDS for long: the signals are read from a wake-up file descriptor by a thread of their own.
    """

    def __init__(self) -> None:
        """Not yet asked to stop."""
        self.requested = threading.Event()
        self._callbacks: list[Callable[[], object]] = []
        self._lock = threading.Lock()

    def then(self, callback: Callable[[], object]) -> None:
        """Call `callback` from another thread when asked to stop; at once where that was so."""
        with self._lock:
            if not self.requested.is_set():
                self._callbacks.append(callback)
                return
        callback()

    def __enter__(self) -> Self:
        """Take over the signals."""
        self._reader, self._writer = socket.socketpair()
        self._writer.setblocking(False)
        self._previous: dict[signal.Signals, Any] = {
            number: signal.signal(number, lambda *_: None) for number in _SIGNALS
        }
        signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        threading.Thread(target=self._listen, name='stop signals', daemon=True).start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Give the signals back."""
        signal.set_wakeup_fd(-1)
        for number, handler in self._previous.items():
            signal.signal(number, handler)
        self._writer.close()

    def _listen(self) -> None:
        with self._reader:
            while number := self._reader.recv(1):
                if self.requested.is_set():
                    os._exit(128 + number[0])
                with self._lock:
                    self.requested.set()
                    callbacks, self._callbacks = self._callbacks, []
                for callback in callbacks:
                    callback()
