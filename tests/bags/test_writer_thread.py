"""The thread that writes: in order, in time, and again after a failure."""

from __future__ import annotations

import os
import shutil
import struct
import threading
import time
from typing import TYPE_CHECKING

import mcap_doctor
import pytest
from command_line import wait_for

from barc_sim.bags.appender import AtomicAppender
from barc_sim.bags.cache import OVERHEAD
from barc_sim.bags.contents import Contents
from barc_sim.bags.messages import BagMessage, Topic
from barc_sim.bags.writer import BagWriter
from barc_sim.bags.writer_thread import WriterThread

if TYPE_CHECKING:
    from collections.abc import Iterator
    from io import FileIO
    from pathlib import Path

TOPIC = Topic(
    name='/value', type='std_msgs/msg/Float64', definition='float64 data', type_hash='',
    offered_qos=[],
)  # fmt: skip
SECOND = 1_000_000_000
MESSAGE_SIZE = OVERHEAD + 12  # [B] in the cache


class Source(list[BagMessage]):
    """Waiting messages."""

    error: Exception | None = None

    def put(self, *numbers: int) -> None:
        """Add messages."""
        self.extend(BagMessage(TOPIC, bytes(12), 1000 + n, 900 + n, n) for n in numbers)

    def take(self) -> list[BagMessage]:
        """Return and remove the waiting messages, or raise the error."""
        if self.error:
            raise self.error
        taken = self.copy()
        del self[: len(taken)]
        return taken


@pytest.fixture
def source() -> Source:
    return Source()


@pytest.fixture
def failures() -> list[str]:
    return []


@pytest.fixture
def reserve(request: pytest.FixtureRequest) -> int:
    """Return the space to leave free [B]."""
    return getattr(request, 'param', 0)


@pytest.fixture
def idle(
    tmp_path: Path, source: Source, failures: list[str], reserve: int
) -> Iterator[WriterThread]:
    """Return a thread that is not started."""
    (tmp_path / 'run').mkdir()
    thread = WriterThread(BagWriter(tmp_path / 'run'), source.take, reserve, failures.append)
    yield thread
    thread.close()


@pytest.fixture
def warnings() -> list[str]:
    return []


@pytest.fixture
def cached(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    source: Source,
    failures: list[str],
    warnings: list[str],
) -> Iterator[WriterThread]:
    """Return a thread with a cache, or with the settings of the parameter."""
    (tmp_path / 'run').mkdir()
    thread = WriterThread(
        BagWriter(tmp_path / 'run'),
        source.take,
        0,
        failures.append,
        on_warning=warnings.append,
        **getattr(request, 'param', {'cache_size': 100 * MESSAGE_SIZE}),
    )
    yield thread
    thread.close()


@pytest.fixture
def thread(idle: WriterThread) -> WriterThread:
    idle.start()
    return idle


def recorded(tmp_path: Path) -> list[int]:
    return [message.number for message in Contents(tmp_path / 'run').messages()]


def test_messages_are_written_in_order_of_reception(
    thread: WriterThread, source: Source, tmp_path: Path
) -> None:
    source.put(3, 1, 2)
    wait_for(lambda: recorded(tmp_path) == [1, 2, 3])  # before it is closed
    thread.close()
    mcap_doctor.check(tmp_path / 'run' / 'run_0.mcap')


@pytest.mark.parametrize('messages', [3, 5000], ids=['less than a chunk', 'several chunks'])
def test_messages_that_the_disk_refuses_until_the_end_are_counted(
    idle: WriterThread,
    tmp_path: Path,
    source: Source,
    monkeypatch: pytest.MonkeyPatch,
    messages: int,
) -> None:
    writer = idle._writer  # noqa: SLF001
    source.put(1)
    idle.write_now()
    assert writer.on_disk == {'/value': 1}
    put = AtomicAppender.put
    room = [70_000 if messages > 3 else 0]

    def fill(file: FileIO, data: bytes) -> None:
        if len(data) > room[0]:
            raise OSError(28, 'No space left on device')
        room[0] -= len(data)
        put(file, data)

    monkeypatch.setattr(AtomicAppender, 'put', staticmethod(fill))
    for first in range(2, messages + 2, 500):
        source.put(*range(first, min(first + 500, messages + 2)))
        idle._chunk_due = 0.0  # noqa: SLF001 (as if time had passed)
        idle.write_now()
    idle.close()

    in_bag = len(recorded(tmp_path))
    assert writer.on_disk == {'/value': in_bag}
    assert idle.unwritten == {'/value': messages + 1 - in_bag}
    assert in_bag == 1 or messages > 3


def test_refused_messages_are_written_once_the_disk_accepts_them(
    thread: WriterThread,
    source: Source,
    failures: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(5, 'Input/output error')

    source.put(1)
    wait_for(lambda: recorded(tmp_path) == [1])
    with monkeypatch.context() as patch:
        patch.setattr(AtomicAppender, 'put', refuse)
        source.put(2)
        wait_for(lambda: bool(failures))
        source.put(3)
        assert failures == [f"writing to '{tmp_path / 'run'}' failed: Input/output error"]
    wait_for(lambda: recorded(tmp_path) == [1, 2, 3])
    assert len(failures) == 1
    thread.close()
    mcap_doctor.check(tmp_path / 'run' / 'run_0.mcap')


def test_messages_of_a_removed_bag_are_lost(
    thread: WriterThread, source: Source, failures: list[str], tmp_path: Path
) -> None:
    source.put(1, 2)
    wait_for(lambda: recorded(tmp_path) == [1, 2])
    shutil.rmtree(tmp_path / 'run')
    wait_for(lambda: bool(failures))
    source.put(3)
    thread.close()
    assert failures == [f"writing to '{tmp_path / 'run'}' failed: it was removed while recording"]
    assert thread.unwritten == {'/value': 3}


@pytest.mark.parametrize('share', [0.0, 0.5, 0.9, 2.0])
def test_messages_that_another_process_truncates_count_as_lost_and_the_rest_is_read(
    idle: WriterThread, source: Source, failures: list[str], tmp_path: Path, share: float
) -> None:
    file = tmp_path / 'run' / 'run_0.mcap'
    for first in range(0, 1000, 100):
        source.put(*range(first, first + 100))
        idle._chunk_due = 0.0  # noqa: SLF001 (as if time had passed)
        idle.write_now()
    os.truncate(file, int(share * file.stat().st_size))
    source.put(1000, 1001)
    idle.close()

    assert failures == [
        f"writing to '{tmp_path / 'run'}' failed: another process has changed its file"
    ]
    left = len(recorded(tmp_path)) if share else 0
    assert left == (1000 if share > 1 else left)
    assert idle._writer.on_disk == ({'/value': left} if left else {})  # noqa: SLF001
    assert idle.unwritten == {'/value': 1002 - left}


@pytest.mark.parametrize('reserve', [2**70], indirect=True)
def test_shortage_of_space_is_reported_while_there_is_enough_to_finish(
    thread: WriterThread, source: Source, failures: list[str], tmp_path: Path
) -> None:
    wait_for(lambda: bool(failures))
    source.put(1)
    assert failures[0].endswith('MiB are free, and 1.1259e+15 MiB must stay free')
    thread.close()
    assert recorded(tmp_path) == [1]
    mcap_doctor.check(tmp_path / 'run' / 'run_0.mcap')


def test_failing_source_is_reported_once_and_the_bag_is_finished(
    thread: WriterThread, source: Source, failures: list[str], tmp_path: Path
) -> None:
    source.put(1)
    wait_for(lambda: recorded(tmp_path) == [1])
    source.error = RuntimeError('rcl has failed')
    wait_for(lambda: bool(failures))
    thread.close()
    assert failures == [f"writing to '{tmp_path / 'run'}' failed: RuntimeError('rcl has failed')"]
    mcap_doctor.check(tmp_path / 'run' / 'run_0.mcap')


class Disk:
    """A disk that stalls until it is released."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.is_stalled = threading.Event()
        self.released = threading.Event()
        put = AtomicAppender.put

        def stall(file: FileIO, data: bytes) -> None:
            self.is_stalled.set()
            self.released.wait(30.0)
            put(file, data)

        monkeypatch.setattr(AtomicAppender, 'put', staticmethod(stall))


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Disk]:
    """Return a disk that stalls from now on, until it is released or the test ends."""
    disk = Disk(monkeypatch)
    yield disk
    disk.released.set()


def test_messages_wait_in_the_cache_while_the_disk_stalls(
    cached: WriterThread, disk: Disk, source: Source, tmp_path: Path
) -> None:
    cached.start()
    source.put(0)
    assert disk.is_stalled.wait(30.0)
    for number in range(1, 5):
        source.put(number)
        wait_for(lambda: not source)
    disk.released.set()
    wait_for(lambda: recorded(tmp_path) == [*range(5)])
    assert not cached.unwritten


def test_what_the_cache_cannot_take_is_lost_by_the_recorder(
    cached: WriterThread,
    disk: Disk,
    source: Source,
    failures: list[str],
    warnings: list[str],
    tmp_path: Path,
) -> None:
    cached.start()
    source.put(0)
    assert disk.is_stalled.wait(30.0)
    source.put(*range(1, 101))
    wait_for(lambda: not source)
    source.put(*range(101, 201))
    wait_for(lambda: cached.unwritten == {'/value': 100})
    disk.released.set()
    wait_for(lambda: recorded(tmp_path) == [*range(101)])
    source.put(*range(201, 211))
    cached.close()
    assert recorded(tmp_path) == [*range(101), *range(201, 211)]
    assert cached.unwritten == {'/value': 100}
    assert not failures
    (warning,) = warnings
    assert warning.startswith('messages are lost, as the cache of ')
    assert ' bytes is full: ' in warning


@pytest.mark.parametrize('cached', [{'cache_size': 10 * MESSAGE_SIZE}], indirect=True)
def test_a_fast_disk_loses_nothing_that_is_larger_than_the_cache(
    cached: WriterThread, source: Source, tmp_path: Path
) -> None:
    cached.start()
    source.put(*range(1000))
    wait_for(lambda: recorded(tmp_path) == [*range(1000)])
    assert not cached.unwritten


def test_without_a_cache_messages_wait_in_the_source(
    thread: WriterThread, source: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = Disk(monkeypatch)
    source.put(0)
    assert disk.is_stalled.wait(30.0)
    source.put(1)
    wait_for(lambda: not source)  # one poll more
    source.put(*range(2, 1000))
    disk.released.set()
    wait_for(lambda: recorded(tmp_path) == [*range(1000)])
    assert not thread.unwritten


@pytest.mark.parametrize(
    'cached', [{'cache_size': 10 * MESSAGE_SIZE, 'snapshot_mode': True}], indirect=True
)
def test_a_snapshot_has_the_latest_messages_and_the_next_one_goes_on_after_it(
    cached: WriterThread, source: Source, tmp_path: Path
) -> None:
    cached.start()
    for first in range(0, 100, 7):
        source.put(*range(first, first + 7))
    wait_for(lambda: not source)
    assert cached.snapshot()
    wait_for(lambda: recorded(tmp_path) == [*range(95, 105)])

    source.put(*range(105, 110))
    assert cached.snapshot()
    source.put(*range(110, 120))
    cached.close()
    assert recorded(tmp_path) == [*range(95, 110)]
    assert not cached.unwritten
    assert len([*(tmp_path / 'run').glob('*.mcap')]) == 1


def test_without_snapshot_mode_there_is_no_snapshot(cached: WriterThread) -> None:
    assert not cached.snapshot()


def test_nothing_is_taken_for_a_snapshot_during_a_pause(
    tmp_path: Path, source: Source, failures: list[str]
) -> None:
    (tmp_path / 'run').mkdir()
    writer = BagWriter(tmp_path / 'run')
    thread = WriterThread(
        writer, source.take, 0, failures.append, cache_size=10_000, snapshot_mode=True
    )
    source.put(1)
    thread.write_now()
    thread.paused = True
    source.put(2)
    thread.snapshot()
    thread.close()
    assert recorded(tmp_path) == [1]


def test_a_split_by_call_puts_the_waiting_messages_into_the_old_file(
    cached: WriterThread, source: Source, tmp_path: Path
) -> None:
    cached.start()
    source.put(1, 2)
    cached.split()
    source.put(3)
    cached.split()
    cached.close()
    files = sorted((tmp_path / 'run').glob('*.mcap'))
    assert [file.name for file in files] == ['run_0.mcap', 'run_1.mcap', 'run_2.mcap']
    assert [[m.number for m in Contents(file).messages()] for file in files] == [[1, 2], [3], []]


def test_message_received_during_a_poll_waits_for_the_next_so_that_a_bag_is_in_order(
    idle: WriterThread, tmp_path: Path, source: Source
) -> None:
    received = time.time_ns() + SECOND // 2
    source.append(message(received))
    idle.write_now()
    source.append(message(received - 1))
    idle.close()
    assert times_of(tmp_path) == [received - 1, received]


def test_messages_are_written_although_the_clock_of_the_system_was_set_back(
    idle: WriterThread, tmp_path: Path, source: Source
) -> None:
    received = time.time_ns() + 3600 * SECOND
    source.append(message(received))
    idle._chunk_due = 0.0  # noqa: SLF001 (as if time had passed)
    idle.write_now()
    assert times_of(tmp_path) == [received]


def message(received: int) -> BagMessage:
    return BagMessage(TOPIC, b'', received, received, 1)


def clock(received: int, sec: int, nanosec: int = 0) -> BagMessage:
    topic = Topic(name='/clock', type='a/msg/B', definition='', type_hash='', offered_qos=())
    data = bytes([0, 1, 0, 0]) + struct.pack('<iI', sec, nanosec)
    return BagMessage(topic, data, received, received, 1)


def times_of(tmp_path: Path) -> list[int]:
    return [each.received for each in Contents(tmp_path / 'run').messages()]


def test_messages_have_the_time_of_the_latest_clock_before_them(
    idle: WriterThread, tmp_path: Path, source: Source
) -> None:
    idle.use_sim_time = True
    messages = [message(1), clock(2, 7), message(3), clock(4, 8, 5), message(9)]
    for waiting in (messages[:3], messages[3:]):
        source.extend(waiting)
        idle.write_now()
    idle.close()
    assert times_of(tmp_path) == [1, 7 * SECOND, 7 * SECOND, 8 * SECOND + 5, 8 * SECOND + 5]


def test_messages_before_the_first_clock_are_left_out_and_counted(
    idle: WriterThread, tmp_path: Path, source: Source
) -> None:
    idle.use_sim_time = idle.waits_for_clock = True
    for waiting in ([message(1), message(2)], [message(3), clock(4, 7), message(5)]):
        source.extend(waiting)
        idle.write_now()
    idle.close()
    assert times_of(tmp_path) == [7 * SECOND, 7 * SECOND]
    assert idle.before_clock == 3


def test_a_clock_that_is_not_recorded_still_gives_the_time(
    idle: WriterThread, tmp_path: Path, source: Source
) -> None:
    idle.use_sim_time = True
    idle.writes_clock = False
    source.extend([clock(1, 7), message(2)])
    idle.close()
    assert times_of(tmp_path) == [7 * SECOND]


def test_time_goes_on_during_a_pause(idle: WriterThread, tmp_path: Path, source: Source) -> None:
    idle.use_sim_time = idle.paused = True
    source.append(clock(1, 7))
    idle.write_now()
    idle.paused = False
    source.append(message(2))
    idle.close()
    assert times_of(tmp_path) == [7 * SECOND]


def test_message_received_since_a_poll_began_waits_for_the_clock_of_the_next(
    idle: WriterThread, tmp_path: Path, source: Source
) -> None:
    idle.use_sim_time = True
    received = time.time_ns() + SECOND // 2
    source.append(message(received))
    idle.write_now()
    source.append(clock(received - 1, 7))
    idle.close()
    assert times_of(tmp_path) == [7 * SECOND, 7 * SECOND]
