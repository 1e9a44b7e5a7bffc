"""The thread that writes: in order, in time, and again when it was refused."""

from __future__ import annotations

import os
import shutil
import time
from typing import TYPE_CHECKING

import mcap_doctor
import pytest
from mcap.records import Message as Record

from barc_sim.bags.metadata import Topic
from barc_sim.bags.records import records
from barc_sim.bags.writer import BagWriter
from barc_sim.nodes.recorder import disk_space
from barc_sim.nodes.recorder.writer_thread import Pump
from barc_sim.ros.topic_subscriptions import Message

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

TOPIC = Topic(
    name='/value', type='std_msgs/msg/Float64', definition='float64 data', type_hash='',
    offered_qos=[],
)  # fmt: skip


class Source(list[Message]):
    """Messages that wait."""

    def put(self, *numbers: int) -> None:
        """Let messages wait."""
        self.extend(Message(TOPIC, bytes(12), 1000 + n, 900 + n, n) for n in numbers)

    def take(self) -> list[Message]:
        """Return what waits."""
        taken = self.copy()
        del self[: len(taken)]
        return taken


@pytest.fixture
def source() -> Source:
    return Source()


@pytest.fixture
def said() -> list[str | None]:
    return []


@pytest.fixture
def pump(tmp_path: Path, source: Source, said: list[str | None]) -> Iterator[Pump]:
    (tmp_path / 'run').mkdir()
    pump = Pump(BagWriter(tmp_path / 'run'), source.take, 0, said.append)
    pump.start()
    yield pump
    pump.close()


def kept(tmp_path: Path) -> list[int]:
    file = tmp_path / 'run' / 'run_0.mcap'
    return [record.sequence for record in records(file) if isinstance(record, Record)]


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_what_waits_is_written_in_order_of_its_reception(
    pump: Pump, source: Source, tmp_path: Path
) -> None:
    source.put(3, 1, 2)
    pump.close()
    assert kept(tmp_path) == [1, 2, 3]
    mcap_doctor.check(tmp_path / 'run' / 'run_0.mcap')


@pytest.mark.usefixtures('pump')
def test_it_reaches_the_file_without_being_closed(source: Source, tmp_path: Path) -> None:
    source.put(1)
    wait_for(lambda: kept(tmp_path) == [1])


def test_what_comes_during_a_pause_is_left_out(pump: Pump, source: Source, tmp_path: Path) -> None:
    pump.paused = True
    source.put(1)
    wait_for(lambda: not source)
    pump.paused = False
    source.put(2)
    pump.close()
    assert kept(tmp_path) == [2]


def test_last_words_are_asked_for_after_the_last_message_was_taken(
    pump: Pump, source: Source
) -> None:
    waiting: list[int] = []

    def last_words() -> dict[str, str]:
        waiting.append(len(source))
        return {'lost': '0'}

    source.put(1)
    pump.close(last_words)
    assert waiting == [0]


def test_what_was_refused_is_written_as_soon_as_it_can_be(
    pump: Pump,
    source: Source,
    said: list[str | None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object) -> int:
        raise OSError(5, 'Input/output error')

    source.put(1)
    wait_for(lambda: kept(tmp_path) == [1])
    with monkeypatch.context() as patch:
        patch.setattr(os, 'pwrite', refuse)
        source.put(2)
        wait_for(lambda: bool(said))
        source.put(3)
        assert pump.failure == f"writing to '{tmp_path / 'run'}' failed: Input/output error"
    wait_for(lambda: kept(tmp_path) == [1, 2, 3])
    assert said == [pump.failure, None]
    pump.close()
    mcap_doctor.check(tmp_path / 'run' / 'run_0.mcap')


def test_what_could_not_be_finished_stays_readable(
    pump: Pump, source: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> int:
        raise OSError(28, 'No space left on device')

    source.put(1, 2)
    wait_for(lambda: kept(tmp_path) == [1, 2])
    monkeypatch.setattr(os, 'pwrite', refuse)
    source.put(3)
    pump.close()
    assert kept(tmp_path) == [1, 2]
    assert pump.failure
    assert pump.failure.endswith('No space left on device')


def test_a_bag_that_is_removed_is_written_anew(
    pump: Pump, source: Source, said: list[str | None], tmp_path: Path
) -> None:
    source.put(1, 2)
    wait_for(lambda: kept(tmp_path) == [1, 2])
    shutil.rmtree(tmp_path / 'run')
    wait_for(lambda: bool(said))
    source.put(3)
    pump.close()
    assert kept(tmp_path) == [1, 2, 3]
    assert pump.failure
    assert 'it was removed under the recording, and is written anew' in pump.failure
    mcap_doctor.check(tmp_path / 'run' / 'run_0.mcap')


def test_little_space_is_noticed_while_there_is_enough_to_finish(
    pump: Pump,
    source: Source,
    said: list[str | None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pump, '_reserve', 2**20)
    monkeypatch.setattr(disk_space, 'free', lambda _: 2**19)
    wait_for(lambda: bool(said))
    source.put(1)
    assert said[0]
    assert said[0].endswith('only 0.5 MiB are free, and 1 MiB are to stay free')
    pump.close()
    assert kept(tmp_path) == [1]
    mcap_doctor.check(tmp_path / 'run' / 'run_0.mcap')


def test_a_source_that_fails_is_said_once_and_the_bag_is_finished(
    pump: Pump,
    source: Source,
    said: list[str | None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail() -> list[Message]:
        raise RuntimeError('rcl has failed')

    source.put(1)
    wait_for(lambda: kept(tmp_path) == [1])
    monkeypatch.setattr(pump, '_source', fail)
    wait_for(lambda: bool(said))
    pump.close()
    assert said == [f"writing to '{tmp_path / 'run'}' failed: RuntimeError('rcl has failed')"]
    mcap_doctor.check(tmp_path / 'run' / 'run_0.mcap')
