"""A file that grows by whole pieces."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from barc_sim.bags import pieces as module
from barc_sim.bags.pieces import Pieces

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'bag' / 'file'


@pytest.fixture
def pieces(file: Path) -> Iterator[Pieces]:
    file.parent.mkdir()
    pieces = Pieces(file)
    yield pieces
    pieces.close()


def test_piece_is_counted_at_once_and_written_at_commit(pieces: Pieces, file: Path) -> None:
    pieces.write(b'abc')
    pieces.write(b'de')
    assert (pieces.tell(), file.read_bytes(), pieces.waiting) == (5, b'', True)
    pieces.commit()
    assert (pieces.tell(), file.read_bytes(), pieces.waiting) == (5, b'abcde', False)


def test_piece_that_does_not_fit_changes_nothing_and_can_be_tried_again(
    pieces: Pieces, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pieces.write(b'abc')
    pieces.commit()
    write = module.write_at
    room = [4]

    def short(descriptor: int, data: memoryview, offset: int) -> int:
        if not room[0]:
            raise OSError(28, 'No space left on device')
        written = write(descriptor, data[: room[0]], offset)
        room[0] -= written
        return written

    monkeypatch.setattr(module, 'write_at', short)
    pieces.write(b'defghi')
    for _ in range(2):
        with pytest.raises(OSError, match='No space left'):
            pieces.commit()
        assert file.read_bytes() == b'abc'
    room[0] = 100
    pieces.write(b'jk')
    pieces.commit()
    assert file.read_bytes() == b'abcdefghijk'


def test_a_file_that_was_removed_with_its_folder_is_made_anew(pieces: Pieces, file: Path) -> None:
    pieces.write(b'abc')
    pieces.commit()
    assert pieces.in_place
    shutil.rmtree(file.parent)
    assert not pieces.in_place
    pieces.restore()
    assert pieces.in_place
    pieces.write(b'de')
    pieces.commit()
    assert file.read_bytes() == b'abcde'


def test_a_file_that_was_replaced_is_not_overwritten(pieces: Pieces, file: Path) -> None:
    file.unlink()
    file.write_bytes(b'foreign')
    assert not pieces.in_place
    with pytest.raises(FileExistsError):
        pieces.restore()
    assert file.read_bytes() == b'foreign'


def test_an_existing_file_is_refused(pieces: Pieces, file: Path) -> None:
    pieces.write(b'abc')
    pieces.commit()
    with pytest.raises(FileExistsError):
        Pieces(file)
    assert file.read_bytes() == b'abc'
