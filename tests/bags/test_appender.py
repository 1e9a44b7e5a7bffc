"""A file that grows by whole blocks."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from barc_sim.bags import file as module
from barc_sim.bags.file import AtomicAppender

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'bag' / 'file'


@pytest.fixture
def appender(file: Path) -> Iterator[AtomicAppender]:
    file.parent.mkdir()
    appender = AtomicAppender(file)
    yield appender
    appender.close()


def test_a_block_is_written_at_commit(appender: AtomicAppender, file: Path) -> None:
    appender.write(b'abc')
    appender.write(b'de')
    assert (appender.position, file.read_bytes(), appender.waiting) == (5, b'', True)
    appender.commit()
    assert (appender.position, file.read_bytes(), appender.waiting) == (5, b'abcde', False)


def test_block_that_does_not_fit_changes_nothing_and_can_be_tried_again(
    appender: AtomicAppender, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    appender.write(b'abc')
    appender.commit()
    write = module.write_at
    room = [4]

    def short(descriptor: int, data: memoryview, offset: int) -> int:
        if not room[0]:
            raise OSError(28, 'No space left on device')
        written = write(descriptor, data[: room[0]], offset)
        room[0] -= written
        return written

    monkeypatch.setattr(module, 'write_at', short)
    appender.write(b'defghi')
    for _ in range(2):
        with pytest.raises(OSError, match='No space left'):
            appender.commit()
        assert file.read_bytes() == b'abc'
    room[0] = 100
    appender.write(b'jk')
    appender.commit()
    assert file.read_bytes() == b'abcdefghijk'


def test_a_removed_file_is_made_anew(appender: AtomicAppender, file: Path) -> None:
    appender.write(b'abc')
    appender.commit()
    assert appender.in_place
    shutil.rmtree(file.parent)
    assert not appender.in_place
    appender.restore()
    assert appender.in_place
    appender.write(b'de')
    appender.commit()
    assert file.read_bytes() == b'abcde'


def test_a_file_that_was_replaced_is_not_overwritten(appender: AtomicAppender, file: Path) -> None:
    file.unlink()
    file.write_bytes(b'foreign')
    assert not appender.in_place
    with pytest.raises(FileExistsError):
        appender.restore()
    assert file.read_bytes() == b'foreign'


def test_an_existing_file_is_refused(appender: AtomicAppender, file: Path) -> None:
    appender.write(b'abc')
    appender.commit()
    with pytest.raises(FileExistsError):
        AtomicAppender(file)
    assert file.read_bytes() == b'abc'
