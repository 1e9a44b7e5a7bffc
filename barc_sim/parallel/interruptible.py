"""Ends a command that waits for its workers, in order, when a signal asks for it."""

from __future__ import annotations

import threading
from concurrent.futures import Executor, Future
from typing import TYPE_CHECKING, Any

from barc_sim.parallel.pieces import workers_of

if TYPE_CHECKING:
    from collections.abc import Callable


class InterruptibleExecutor(Executor):
    """Passes calls on to an executor; after an interrupt, all results are KeyboardInterrupts.

    So whoever waits for a result goes on at once, at a place where it expects exceptions, while the
    call may still run.

    Parameters
    ----------
    executor
        Makes the calls.
    """

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._lock = threading.Lock()
        self._calls: dict[Future[Any], Future[Any]] = {}  # the executor's own, by ours
        self._is_interrupted = False

    @property
    def _max_workers(self) -> int:
        """The number of workers now; `pieces.workers_of` reads it."""
        return workers_of(self._executor)

    def submit(  # type: ignore[override]  # mypy: of a ParamSpec
        self,
        function: Callable[..., Any],
        /,
        *arguments: Any,  # noqa: ANN401
    ) -> Future[Any]:
        """Have the executor call `function`; return the future of its result."""
        result: Future[Any] = Future()
        with self._lock:
            if self._is_interrupted:
                result.set_exception(KeyboardInterrupt())
                return result
            call = self._executor.submit(function, *arguments)
            self._calls[result] = call

        result.add_done_callback(self._on_done)
        call.add_done_callback(lambda call: self._pass_on(call, result))
        return result

    def interrupt(self) -> None:
        """End all waiting, from any thread."""
        with self._lock:
            self._is_interrupted = True
            results = [*self._calls]
        for result in results:
            self._finish(result, KeyboardInterrupt())

    def _pass_on(self, call: Future[Any], result: Future[Any]) -> None:
        """Pass the result of a call on."""
        if call.cancelled():
            result.cancel()
            return
        error = call.exception()
        self._finish(result, error, None if error else call.result())

    def _finish(
        self,
        result: Future[Any],
        error: BaseException | None,
        value: Any = None,  # noqa: ANN401 (of any function)
    ) -> None:
        """Set a result, unless it has one already, or nobody waits for it."""
        with self._lock:
            is_waiting = self._calls.pop(result, None) is not None
        if not is_waiting or not result.set_running_or_notify_cancel():
            return
        if error is None:
            result.set_result(value)
        else:
            result.set_exception(error)

    def _on_done(self, result: Future[Any]) -> None:
        """Cancel the call whose result was cancelled."""
        if not result.cancelled():
            return
        with self._lock:
            call = self._calls.pop(result, None)
        if call:
            call.cancel()
