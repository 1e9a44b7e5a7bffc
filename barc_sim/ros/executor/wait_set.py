"""The thread that waits for entities without a listener, in a wait set of rclpy's."""

from __future__ import annotations

from contextlib import suppress
from threading import Thread
from typing import TYPE_CHECKING

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor

from barc_sim.ros.executor.entities import KINDS
from barc_sim.ros.executor.rclpy_private import WaitedEntity

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context

    from barc_sim.ros.executor.entities import Entry


class WaitSetThread(SingleThreadedExecutor):
    """Waits for entities without a listener, in rclpy's own wait set.

    It starts with the first entry. It calls `signal` with each entry that is ready, and waits for
    that entry again after `resume`. An exception of a waitable ends it, with a call of `fail`.
    """

    def __init__(
        self,
        context: Context,
        signal: Callable[[Entry], None],
        fail: Callable[[BaseException], None],
    ) -> None:
        super().__init__(context=context)
        self._signal = signal
        self._fail = fail
        self._thread = Thread(target=self._run, daemon=True)
        for kind in KINDS:  # rclpy waits for these entities as for those of a node
            setattr(self, kind, [])

    def add(self, entry: Entry) -> None:
        """Wait for an entry from now on, even while its callback group is claimed."""
        entry.waited = WaitedEntity(
            entry.entity,
            entry=entry,
            callback_group=ReentrantCallbackGroup(),
            _executor_event=False,
        )
        getattr(self, entry.kind).append(entry.waited)
        self.wake()
        if not self._thread.ident:
            self._thread.start()

    def resume(self, entry: Entry) -> None:
        """Wait for an entry again, after its take."""
        entry.waited.wait_again()
        self.wake()

    def remove(self, entry: Entry) -> None:
        """Stop waiting for an entry."""
        getattr(self, entry.kind).remove(entry.waited)
        self.wake()

    def close(self) -> None:
        """End the thread."""
        self._is_shutdown = True
        self.wake()
        if self._thread.ident:
            self._thread.join()
        with suppress(InvalidHandle):  # destroyed already, at the interpreter's end
            self.shutdown()
        self._sigint_gc = None

    def _run(self) -> None:
        try:
            with suppress(ShutdownException, ExternalShutdownException):
                while True:
                    self._signal_ready()
        except BaseException as error:  # noqa: BLE001 - the spinning thread raises it
            self._fail(error)

    def _signal_ready(self) -> None:
        """Wait once, and signal the entries that are ready."""
        for task, waited, _ in self._wait_for_ready_callbacks(None, [self]):
            if not task.cancelled():  # rclpy returns those of the last wait, too
                task.cancel()
                self._signal(waited.entry)
