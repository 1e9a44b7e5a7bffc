"""Work in pieces on any executor: handed out as workers become free, taken as it is ready."""

from __future__ import annotations

import os
import threading
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim import Scenario, Stanley, sweep, sweep_to_parquet
from barc_sim.control.speed import PID
from barc_sim.errors import UserError
from barc_sim.parallel.pieces import PieceSizes, finished_pieces, result_of, workers_of

if TYPE_CHECKING:
    from collections.abc import Iterator

#: Runs of each kind of loop: compiled on a road, compiled on a track, and in Python.
SWEEPS: dict[str, dict[str, Any]] = {
    'road': {'kp': np.linspace(1.0, 60.0, 40), 'ki': [[0.0], [20.0]], 'distance': 30.0},
    'noise': {'kp': 30.0, 'noise': 0.1, 'seed': range(50), 'distance': 30.0},
    'laps': {'track': 'oval', 'laps': 1, 'lane': Stanley(), 'k': np.linspace(0.5, 8.0, 5)},
    'python': {'kp': np.linspace(1.0, 60.0, 5), 'distance': 20.0},
}


class SlowExecutor(Executor):
    """Finishes calls only when a test says so, in any order."""

    _max_workers = 2

    def __init__(self) -> None:
        self.calls: list[tuple[Any, Future[Any]]] = []

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> Future[Any]:  # noqa: ANN401, ARG002
        """Keep the call."""
        future: Future[Any] = Future()
        self.calls.append((arguments[0], future))
        return future

    def finish(self, number: int) -> None:
        """Finish a call, with its argument as the result."""
        argument, future = self.calls[number]
        future.set_result(argument)


def test_pieces_are_handed_out_only_as_workers_become_free() -> None:
    executor = SlowExecutor()
    taken: list[int] = []

    def pieces() -> Any:  # noqa: ANN401
        for number in range(10**9):
            taken.append(number)
            yield number

    finished = finished_pieces(executor, abs, pieces())
    threading.Timer(0.0, lambda: _finish_when_there(executor, 3)).start()
    piece, future = next(finished)

    assert (piece, future.result()) == (3, 3)
    assert len(taken) == 3 * executor._max_workers  # noqa: SLF001
    finished.close()
    assert all(call.cancelled() for _, call in executor.calls if call is not future)


def test_more_pieces_are_handed_out_when_workers_join(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('barc_sim.parallel.pieces._COUNT_PERIOD', 0.0)
    executor = SlowExecutor()
    finished = finished_pieces(executor, abs, range(10**9))
    threading.Timer(0.0, lambda: _finish_when_there(executor, 0)).start()
    next(finished)
    assert len(executor.calls) == 3 * 2

    executor._max_workers = 5  # noqa: SLF001 (as `workers_of` reads it)
    executor.finish(1)
    next(finished)
    next_count = 3 * 5 + 1  # the first one has finished
    assert len(executor.calls) == next_count


def test_no_pieces_are_handed_out_while_workers_have_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('barc_sim.parallel.pieces._COUNT_PERIOD', 0.0)
    executor = SlowExecutor()
    finished = finished_pieces(executor, abs, range(10**9))
    threading.Timer(0.0, lambda: _finish_when_there(executor, 0)).start()
    next(finished)

    executor._max_workers = 1  # noqa: SLF001 (as `workers_of` reads it)
    executor.finish(1)
    piece, _ = next(finished)
    assert piece == 1
    assert len(executor.calls) == 3 * 2


def _finish_when_there(executor: SlowExecutor, number: int) -> None:
    while len(executor.calls) <= number:
        threading.Event().wait(0.01)
    executor.finish(number)


def test_ordered_pieces_come_in_their_order_whichever_is_ready_first() -> None:
    barrier = threading.Event()

    def work(number: int) -> int:
        if number == 0:
            barrier.wait(60.0)
        else:
            barrier.set()
        return number

    with ThreadPoolExecutor(2) as executor:
        finished = finished_pieces(executor, work, range(20), ordered=True)
        assert [future.result() for _, future in finished] == [*range(20)]


def test_it_ends_when_it_is_stopped() -> None:
    executor = SlowExecutor()
    stopped: Future[None] = Future()
    threading.Timer(0.1, stopped.set_result, (None,)).start()
    assert [*finished_pieces(executor, abs, range(5), stopped)] == []


def test_a_piece_grows_to_the_runs_of_a_second() -> None:
    sizes = PieceSizes(10**9, workers=2)
    numbers = []
    for runs in sizes.ranges():
        numbers.append(len(runs))
        if len(numbers) == 12:
            break
        sizes.measured(runs, duration=len(runs) / 20_000.0)
    assert numbers[:4] == [1, 16, 256, 4096]
    assert set(numbers[4:]) == {20_000}


def test_pieces_cover_each_run_once_and_leave_several_for_each_worker() -> None:
    sizes = PieceSizes(100, workers=4)
    pieces = []
    for runs in sizes.ranges():
        pieces.append(runs)
        sizes.measured(runs, duration=1e-6)
    assert [number for runs in pieces for number in runs] == [*range(100)]
    assert max(map(len, pieces)) == 100 // (4 * 4)


@pytest.fixture(scope='module')
def pool() -> Iterator[ProcessPoolExecutor]:
    """Return two processes, which the tests share as they compile the loops first."""
    with ProcessPoolExecutor(2) as executor:
        yield executor


@pytest.mark.parametrize('name', SWEEPS)
def test_a_sweep_in_processes_has_the_same_bits(name: str, pool: ProcessPoolExecutor) -> None:
    options = SWEEPS[name]
    if name == 'python':
        options = options | {'reference': speed_of_user}
    shared = sweep(**options, executor=pool)
    alone = sweep(**options)

    assert shared.dtype == alone.dtype
    assert shared.shape == alone.shape
    assert shared.tobytes() == alone.tobytes()


def speed_of_user(t: float, distance: float) -> float:  # noqa: ARG001 (a Signal)
    """Return the speed to hold [m/s]."""
    return 8.0


def test_a_sweep_of_a_scenario_and_of_nothing_is_shared_too() -> None:
    scenario = Scenario(distance=20.0, disturbance=-100.0)
    with ThreadPoolExecutor(2) as executor:
        shared = sweep(kp=[10.0, 20.0], scenario=scenario, executor=executor)
        empty = sweep(kp=[], executor=executor)
    assert shared.tobytes() == sweep(kp=[10.0, 20.0], scenario=scenario).tobytes()
    assert len(empty) == 0


def test_work_that_cannot_travel_is_refused_in_a_sentence() -> None:
    class Local(PID):
        pass

    with (
        ProcessPoolExecutor(1) as executor,
        pytest.raises(UserError, match='define its functions and classes in a module'),
    ):
        sweep(kp=[1.0, 2.0], controller=Local(), executor=executor)


def test_the_end_of_a_users_pool_is_said_in_a_sentence() -> None:
    with ProcessPoolExecutor(1) as executor:
        future = executor.submit(os._exit, 3)
        with pytest.raises(UserError, match='give an executor that repeats its work'):
            result_of(future)


def test_an_error_of_the_work_is_its_own() -> None:
    with ThreadPoolExecutor(1) as executor, pytest.raises(ZeroDivisionError):
        result_of(executor.submit(divmod, 1, 0))
    with ThreadPoolExecutor(1) as executor, pytest.raises(TypeError):
        result_of(executor.submit(len, 1))


def test_the_workers_of_common_executors_are_known() -> None:
    with ThreadPoolExecutor(3) as threads, ProcessPoolExecutor(2) as processes:
        assert workers_of(threads) == 3
        assert workers_of(processes) == 2


def test_a_parquet_file_has_the_rows_of_the_sweep_and_the_same_bytes_however_it_was_shared(
    tmp_path: Any,  # noqa: ANN401
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    parquet = pytest.importorskip('pyarrow.parquet')
    monkeypatch.setattr('barc_sim.tuning.sweep._ROWS', 7)
    monkeypatch.setattr('barc_sim.tuning.sweep._PART', 9)
    options = SWEEPS['noise']

    with ThreadPoolExecutor(2) as executor:
        count = sweep_to_parquet(tmp_path / 'shared.parquet', **options, executor=executor)
    sweep_to_parquet(tmp_path / 'alone.parquet', **options)

    frame = parquet.read_table(tmp_path / 'shared.parquet').to_pandas()
    assert count == len(frame) == 50
    assert frame.equals(sweep(**options).to_frame())
    alone = (tmp_path / 'alone.parquet').read_bytes()
    assert (tmp_path / 'shared.parquet').read_bytes() == alone
    assert parquet.ParquetFile(tmp_path / 'alone.parquet').num_row_groups == 8


def test_a_parquet_file_of_no_runs_has_its_columns(tmp_path: Any) -> None:  # noqa: ANN401
    parquet = pytest.importorskip('pyarrow.parquet')
    assert sweep_to_parquet(tmp_path / 'none.parquet', kp=[]) == 0
    assert 'rms_error' in parquet.read_table(tmp_path / 'none.parquet').column_names
