"""The worker processes of this machine: the end of one costs no result."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from concurrent.futures import BrokenExecutor
from pathlib import Path

import pytest
from command_line import wait_for

from barc_sim.parallel.pieces import finished_pieces, workers_of
from barc_sim.parallel.processes import processes

pytestmark = pytest.mark.timeout(120)


def end_once(path: str) -> str:
    """End this process at the first call for a path, return the path at the next."""
    try:
        Path(path).touch(exist_ok=False)
    except FileExistsError:
        return path
    os.kill(os.getpid(), signal.SIGKILL)
    return 'not reached'


def end_or_add(number: int) -> int:
    """End this process for the number 3, else add 1."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.01)
    return number + 1


def test_a_call_whose_process_ended_is_made_again(tmp_path: Path) -> None:
    paths = [str(tmp_path / f'{number}') for number in range(4)]
    with processes(2) as executor:
        results = [future.result() for _, future in finished_pieces(executor, end_once, paths)]
    assert sorted(results) == paths


def test_a_call_that_always_ends_its_process_takes_no_other_with_it() -> None:
    with processes(2) as executor:
        futures = dict(finished_pieces(executor, end_or_add, range(30)))

    assert len(futures) == 30
    assert isinstance(futures.pop(3).exception(), BrokenExecutor)
    assert {number: future.result() for number, future in futures.items()} == {
        number: number + 1 for number in range(30) if number != 3
    }


def test_an_idle_process_that_ends_is_replaced() -> None:
    with processes(1) as executor:
        first = executor.submit(os.getpid).result()
        os.kill(first, signal.SIGKILL)
        assert executor.submit(os.getpid).result() != first


def begin_and_sleep(path: str) -> None:
    """Make a file, and sleep."""
    Path(path).touch()
    time.sleep(200.0)


def test_a_call_that_runs_at_the_end_of_the_block_is_not_made_again(tmp_path: Path) -> None:
    with processes(1) as executor:
        future = executor.submit(begin_and_sleep, str(tmp_path / 'begun'))
        wait_for((tmp_path / 'begun').exists)

    assert isinstance(future.exception(60.0), BrokenExecutor)
    assert not multiprocessing.active_children()


def test_an_exception_is_passed_on() -> None:
    with processes(1) as executor, pytest.raises(ZeroDivisionError):
        executor.submit(divmod, 1, 0).result()


def test_the_number_of_jobs_is_that_of_the_workers() -> None:
    with processes(3) as executor:
        assert workers_of(executor) == 3
