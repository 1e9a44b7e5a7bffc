"""Waits for what has no listener in a thread of its own, with rclpy's own wait set."""

from __future__ import annotations

from contextlib import suppress
from threading import Thread
from typing import TYPE_CHECKING

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor

from barc_sim.ros.executor.entities import KINDS
from barc_sim.ros.executor.rclpy_private import StandIn

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context

    from barc_sim.ros.executor.entities import Entry


class WaitSetThread(SingleThreadedExecutor):
    """Waits for entries; the thread starts with the first one.

    It calls `is_ready` with an entry that is ready, which is waited for again after `resume`; and
    `on_failure` with an exception of a waitable, which ends it.
    """

    def __init__(
        self,
        context: Context,
        is_ready: Callable[[Entry], None],
        on_failure: Callable[[BaseException], None],
    ) -> None:
        super().__init__(context=context)
        self._is_ready = is_ready
        self._on_failure = on_failure
        self._waited: dict[Entry, StandIn] = {}
        self._thread = Thread(target=self._run, name='wait set', daemon=True)
        for kind in KINDS:  # it is waited for as if they were a node's
            setattr(self, kind, [])

    def add(self, entry: Entry) -> None:
        """Wait for an entry, too, also while its callback group is claimed."""
        group = ReentrantCallbackGroup()
        waited = StandIn(entry.entity, entry=entry, callback_group=group, _executor_event=False)
        self._waited[entry] = waited
        getattr(self, entry.kind).append(waited)
        self.wake()
        if not self._thread.ident:
            self._thread.start()

    def __contains__(self, entry: Entry) -> bool:
        """Whether an entry is waited for."""
        return entry in self._waited

    def resume(self, entry: Entry) -> None:
        """Wait for an entry again, as what was ready is taken."""
        vars(self._waited[entry])['_executor_event'] = False  # rclpy's: True from ready to taken
        self.wake()

    def remove(self, entry: Entry) -> None:
        """Wait for an entry no longer."""
        getattr(self, entry.kind).remove(self._waited.pop(entry))
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
            while True:
                for task, waited, _ in self._wait_for_ready_callbacks(None, [self]):
                    task.cancel()
                    self._is_ready(waited.entry)
        except (ShutdownException, ExternalShutdownException):
            pass
        except BaseException as error:  # noqa: BLE001 - the spinning thread raises it
            self._on_failure(error)
