"""An interrupt ends the waiting for workers, whatever they do."""

from __future__ import annotations

import threading
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import pytest

from barc_sim.parallel.interruptible import InterruptibleExecutor
from barc_sim.parallel.pieces import finished_pieces, result_of, workers_of

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.timeout(120)


@pytest.fixture
def barrier() -> Iterator[threading.Event]:
    """Return what calls of a test wait for; it is set at the end of the test."""
    event = threading.Event()
    yield event
    event.set()


@pytest.fixture
def executor(barrier: threading.Event) -> Iterator[InterruptibleExecutor]:
    """Return an executor of one thread, which ends with the test."""
    with ThreadPoolExecutor(1) as threads:
        yield InterruptibleExecutor(threads)
        barrier.set()


def test_results_and_exceptions_are_those_of_the_calls(executor: InterruptibleExecutor) -> None:
    assert executor.submit(divmod, 7, 2).result() == (3, 1)
    with pytest.raises(ZeroDivisionError):
        executor.submit(divmod, 1, 0).result()
    assert workers_of(executor) == 1


def test_workers_that_join_are_counted() -> None:
    with ThreadPoolExecutor(1) as threads:
        executor = InterruptibleExecutor(threads)
        threads._max_workers = 3  # noqa: SLF001 (as workers of a cluster join)
        assert workers_of(executor) == 3


def test_an_interrupt_ends_the_waiting_at_once(
    executor: InterruptibleExecutor, barrier: threading.Event
) -> None:
    finished = finished_pieces(executor, barrier.wait, [None] * 10)
    threading.Timer(0.1, executor.interrupt).start()
    _, future = next(finished)
    with pytest.raises(KeyboardInterrupt):
        result_of(future)
    assert not barrier.is_set()


def test_a_call_after_the_interrupt_is_interrupted(executor: InterruptibleExecutor) -> None:
    executor.interrupt()
    with pytest.raises(KeyboardInterrupt):
        executor.submit(abs, -1).result()


def test_a_cancelled_call_is_not_made(
    executor: InterruptibleExecutor, barrier: threading.Event
) -> None:
    calls: list[Any] = []
    first = executor.submit(barrier.wait)
    second: Future[None] = executor.submit(calls.append, 2)
    assert second.cancel()
    barrier.set()
    assert first.result()
    with pytest.raises(CancelledError):
        second.result()
    executor.submit(abs, -1).result()
    assert not calls


def test_a_call_that_ends_during_the_interrupt_keeps_its_first_result(
    executor: InterruptibleExecutor,
) -> None:
    future = executor.submit(abs, -1)
    assert future.result() == 1
    executor.interrupt()
    assert future.result() == 1
