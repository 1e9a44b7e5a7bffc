"""The grader's end of the pipes to a submission's process; each read and write has a deadline."""

from __future__ import annotations

import os
import select
import time
from contextlib import suppress

_CHUNK = 65_536


class Channel:
    """Sends bytes to a process and receives its replies and its printed output.

    Where the process does neither before a deadline, of `time.monotonic`, that is a TimeoutError;
    where it has closed the pipe, an EOFError.
    """

    def __init__(self, requests: int, replies: int, output: int, *, keep: int) -> None:
        """Own the descriptors of this end of the pipes."""
        #: The first `keep` bytes of the output, and one more byte if there is more.
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
        """Send `data` before `deadline`."""
        while data:
            self._wait(self._sending, self._requests, deadline)
            with suppress(BlockingIOError):
                try:
                    data = data[os.write(self._requests, data) :]
                except BrokenPipeError:
                    raise EOFError from None

    def receive(self, deadline: float) -> bytes:
        """Return at least one byte of what the process sends before `deadline`."""
        self._wait(self._receiving, self._replies, deadline)
        data = os.read(self._replies, _CHUNK)
        if not data:
            raise EOFError
        return data

    def close(self) -> None:
        """Read the output so far and close the pipes; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        self._read_output()
        for descriptor in (self._requests, self._replies, self._output):
            os.close(descriptor)

    def _wait(self, poll: select.poll, wanted: int, deadline: float) -> None:
        while True:
            seconds = deadline - time.monotonic()
            if seconds <= 0.0:
                raise TimeoutError
            ready = {descriptor for descriptor, _ in poll.poll(1000.0 * seconds)}
            if self._output in ready:
                self._read_output()
            if wanted in ready:
                return

    def _read_output(self) -> None:
        """Read at most one chunk, so that endless output does not block."""
        with suppress(BlockingIOError):
            data = os.read(self._output, _CHUNK)
            if not data:
                # Closed: poll would report it at once, again and again.
                for poll in (self._sending, self._receiving):
                    with suppress(KeyError):
                        poll.unregister(self._output)
            self.printed += data[: self._keep - len(self.printed)]
