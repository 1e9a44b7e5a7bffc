"""Bags whose runs were killed, made whole."""

from __future__ import annotations

import os
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

import mcap_doctor
import pytest
import yaml
from made_bags import VALUE
from rosbags.highlevel import AnyReader

from barc_sim.__main__ import main as barc
from barc_sim.bags import reader as bag
from barc_sim.bags.contents import Contents
from barc_sim.bags.messages import Message
from barc_sim.bags.recovery import recover as make_whole
from barc_sim.bags.writer import BagWriter
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable


ATTACHED = {'student/a.py': b'x = 1\n'}


def write(directory: Path, max_duration: float = inf) -> BagWriter:
    directory.mkdir()
    writer = BagWriter(directory, metadata={'command': 'acc'}, max_duration=max_duration)
    writer.attach(ATTACHED)
    for k in range(1000):
        writer.write([Message(VALUE, k.to_bytes(12, 'little'), 1000 + k, 900 + k, k)])
        if k % 100 == 99:
            writer.flush()
    return writer


def kill(writer: BagWriter) -> Path:
    """Leave the bag as a kill would; return it."""
    for file in writer._files:  # noqa: SLF001
        file.appender.close()
    return writer.directory


@pytest.fixture
def killed(tmp_path: Path) -> Path:
    """Return the bag of a run that was killed."""
    return kill(write(tmp_path / 'run'))


def _fifo(path: Path, outside: Path) -> None:  # noqa: ARG001
    os.mkfifo(path)


@pytest.mark.parametrize('make', [Path.symlink_to, _fifo], ids=['link', 'pipe'])
@pytest.mark.parametrize('name', ['.metadata.yaml', 'metadata.yaml', '.run_0.mcap.part', 'any'])
def test_a_bag_with_a_link_or_a_pipe_in_it_is_not_written(
    killed: Path, name: str, make: Callable[[Path, Path], None]
) -> None:
    outside = killed.parent / 'bashrc'
    outside.write_text('mine')
    make(killed / name, outside)
    before = sorted(killed.iterdir())
    with pytest.raises(UserError, match='where a bag has plain files only'):
        make_whole(killed)
    assert outside.read_text() == 'mine'
    assert sorted(killed.iterdir()) == before


def messages(directory: Path) -> list[Message]:
    return [*Contents(directory).messages()]


def test_a_killed_runs_bag_becomes_whole(killed: Path) -> None:
    before = messages(killed)
    found, _ = make_whole(killed)
    assert (found.counts, found.span.count, found.metadata) == (
        {'/value': 1000},
        1000,
        {'command': 'acc'},
    )
    assert messages(killed) == before
    mcap_doctor.check(killed / 'run_0.mcap')
    information = yaml.safe_load((killed / 'metadata.yaml').read_text())
    (topic,) = information['rosbag2_bagfile_information']['topics_with_message_count']
    assert topic['topic_metadata']['offered_qos_profiles'] == VALUE.offered_qos
    assert topic['topic_metadata']['type_description_hash'] == VALUE.type_hash
    assert bag.info(killed) == {'command': 'acc'}
    assert bag.load(killed).attachments == ATTACHED
    assert {file.name for file in killed.iterdir()} == {'run_0.mcap', 'metadata.yaml'}


@pytest.mark.parametrize('cut', [1, 100, 700])
def test_a_cut_off_end_costs_the_chunks_that_it_hits(killed: Path, cut: int) -> None:
    file = killed / 'run_0.mcap'
    file.write_bytes(file.read_bytes()[:-cut])
    before = messages(killed)
    assert 0 < len(before) <= 1000
    assert make_whole(killed)[0].span.count == len(before)
    assert messages(killed) == before
    mcap_doctor.check(file)


def test_a_damaged_chunk_is_left_out_and_the_file_is_kept(killed: Path) -> None:
    file = killed / 'run_0.mcap'
    content = bytearray(file.read_bytes())
    content[content.index(b'zstd', len(content) // 2) + 30] ^= 1
    file.write_bytes(content)
    found, kept = make_whole(killed)
    assert found.span.count == 900
    assert found.damages['run_0.mcap'].unreadable_chunks == 1
    assert [path.read_bytes() for path in kept] == [bytes(content)]
    mcap_doctor.check(file)
    with AnyReader([killed]) as reader:
        assert reader.message_count == 900


def test_a_file_with_a_damaged_length_is_kept(killed: Path) -> None:
    file = killed / 'run_0.mcap'
    content = bytearray(file.read_bytes())
    # The compression's name follows 8 bytes of a chunk's length and 32 of other numbers.
    content[content.index(b'zstd', len(content) // 2) - 40 + 3] ^= 0xFF
    file.write_bytes(content)
    found, kept = make_whole(killed)
    assert 0 < found.span.count < 1000
    assert [path.read_bytes() for path in kept] == [bytes(content)]


def test_a_whole_bag_stays_as_it_is(tmp_path: Path) -> None:
    write(tmp_path / 'run').close()
    before = {file.name: file.read_bytes() for file in (tmp_path / 'run').glob('*.mcap')}
    assert make_whole(tmp_path / 'run')[0].span.count == 1000
    assert before == {file.name: file.read_bytes() for file in (tmp_path / 'run').glob('*.mcap')}


def test_a_bag_of_several_files_becomes_whole(tmp_path: Path) -> None:
    make_whole(kill(write(tmp_path / 'run', 99e-9)))
    assert len([*(tmp_path / 'run').glob('*.mcap')]) == 10
    assert [message.number for message in messages(tmp_path / 'run')] == list(range(1000))
    with AnyReader([tmp_path / 'run']) as reader:
        assert reader.message_count == 1000


def test_a_bag_that_is_being_recorded_is_left_alone(tmp_path: Path) -> None:
    writer = write(tmp_path / 'run')
    with pytest.raises(UserError, match=r"run_0.mcap' is being recorded: end the recording first"):
        make_whole(tmp_path / 'run')
    writer.close()
    make_whole(tmp_path / 'run')


def test_full_disk_leaves_the_bag_unchanged(killed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> int:
        raise OSError(28, 'No space left on device')

    before = (killed / 'run_0.mcap').read_bytes()
    monkeypatch.setattr('barc_sim.bags.file.write_at', refuse)
    with pytest.raises(UserError, match=r'cannot be recovered \(No space left on device\)'):
        make_whole(killed)
    assert {file.name: file.read_bytes() for file in killed.iterdir()} == {'run_0.mcap': before}


def test_command_prints_what_was_recovered(
    killed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert barc(['recover', str(killed)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        'run_0.mcap: was unfinished; 0 bytes at its end could not be read',
        '     1000 /value',
        '     1000 messages in 0.000 s',
    ]
