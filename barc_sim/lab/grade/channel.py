"""The grader's end of the pipes to a submission's process: no read or write waits for ever."""

from __future__ import annotations

import os
import select
import time
from contextlib import suppress

_CHUNK = 65_536


class Channel:
    """Bytes to and from a process, while what it prints is taken in on the side.

    Attributes
    ----------
    printed
        What the process has printed, its first `keep` bytes and one more if there is more.
    """

    def __init__(self, requests: int, replies: int, output: int, *, keep: int) -> None:
        """Take over the descriptors of the pipes' ends on this side."""
        self.printed = b''
        self._keep = keep + 1
        self._closed = False
        self._requests, self._replies, self._output = requests, replies, output
        self._sending, self._receiving = select.poll(), select.poll()
        self._sending.register(requests, select.POLLOUT)
        self._receiving.register(replies, select.POLLIN)
        for poll in (self._sending, self._receiving):
            poll.register(output, select.POLLIN)
        for descriptor in (requests, replies, output):
            os.set_blocking(descriptor, False)

    def send(self, data: bytes, deadline: float) -> None:
        """Send `data` before `deadline`, of `time.monotonic`.

        Raises
        ------
        TimeoutError
            where the process has not taken it by then.
        EOFError
            where nobody is left to take it.
        """
        while data:
            self._wait(self._sending, self._requests, deadline)
            with suppress(BlockingIOError):
                try:
                    data = data[os.write(self._requests, data) :]
                except BrokenPipeError:
                    raise EOFError from None

    def receive(self, deadline: float) -> bytes:
        """Return what the process has sent, at least one byte of it.

        Raises
        ------
        TimeoutError
            where nothing has come before `deadline`, of `time.monotonic`.
        EOFError
            where nobody is left to send.
        """
        self._wait(self._receiving, self._replies, deadline)
        data = os.read(self._replies, _CHUNK)
        if not data:
            raise EOFError
        return data

    def close(self) -> None:
        """Take in what has been printed so far, and close the pipes; once more does nothing."""
        if self._closed:
            return
        self._closed = True
        self._take_output()
        for descriptor in (self._requests, self._replies, self._output):
            os.close(descriptor)

    def _wait(self, poll: select.poll, wanted: int, deadline: float) -> None:
        while True:
            seconds = deadline - time.monotonic()
            if seconds <= 0.0:
                raise TimeoutError
            ready = {descriptor for descriptor, _ in poll.poll(1000.0 * seconds)}
            if self._output in ready:
                self._take_output()
            if wanted in ready:
                return

    def _take_output(self) -> None:
        """Take in at most as much as a pipe holds: who prints without end is not waited for."""
        with suppress(BlockingIOError):
            data = os.read(self._output, _CHUNK)
            if not data:
                # Closed: poll would report that at once, over and over.
                for poll in (self._sending, self._receiving):
                    with suppress(KeyError):
                        poll.unregister(self._output)
            self.printed += data[: self._keep - len(self.printed)]
