"""SIGINT, SIGTERM and SIGHUP as a request to stop, heard at once from any thread."""

from __future__ import annotations

import os
import signal
import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from typing_extensions import Self

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
#: [s] A second signal this soon is the first one's echo: `timeout`, for one, signals the process
#: and then its group, and a terminal's Ctrl-C may be passed on by a parent, too.
_ECHO = 0.5


class StopSignals:
    """While entered, a signal that would end the process calls back instead.

    A later one ends the process, should it hang. After the exit all of them are ignored: what is
    left to do is the interpreter's own end, which a signal would spoil.

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
        """Take over the signals, except a hang-up that is ignored already (`nohup`)."""
        self._reader, self._writer = os.pipe()
        os.set_blocking(self._writer, False)
        # Before the handlers, so that no signal falls between.
        signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
        self._taken = [
            number
            for number in _SIGNALS
            if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN
        ]
        for number in self._taken:
            signal.signal(number, lambda *_: None)
        threading.Thread(target=self._listen, name='stop signals', daemon=True).start()
        # Whoever started the process may have held them back until now, as scripts/run does.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, self._taken)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Ignore the signals from now on."""
        for number in self._taken:
            signal.signal(number, signal.SIG_IGN)
        signal.set_wakeup_fd(-1)
        os.close(self._writer)

    def _listen(self) -> None:
        with os.fdopen(self._reader, 'rb', buffering=0) as signals:
            while number := signals.read(1):
                if not self.requested.is_set():
                    asked = time.monotonic()
                    self._request()
                elif time.monotonic() - asked > _ECHO:
                    os._exit(128 + number[0])

    def _request(self) -> None:
        with self._lock:
            self.requested.set()
            callbacks, self._callbacks = self._callbacks, []
        for callback in callbacks:
            callback()
