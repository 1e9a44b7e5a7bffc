"""What killed processes leave in /dev/shm: only what nobody holds is cleared away."""

from __future__ import annotations

import fcntl
from typing import TYPE_CHECKING

import pytest

from barc_sim.ros import shared_memory
from barc_sim.ros.shared_memory import sweep

if TYPE_CHECKING:
    from pathlib import Path

NAME = 'fastrtps_0123456789abcdef'


@pytest.fixture
def segment(tmp_path: Path) -> Path:
    """Return a segment with its lock beside it."""
    for name in (NAME, f'{NAME}_el'):
        (tmp_path / name).write_bytes(b'')
    return tmp_path / NAME


def test_a_segment_whose_owner_is_gone_is_removed_with_its_lock(
    segment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shared_memory, '_YOUNG', -1.0)
    assert sweep(segment.parent) == 1
    assert not list(segment.parent.iterdir())


def test_a_segment_whose_lock_is_held_stays(segment: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_memory, '_YOUNG', -1.0)
    lock = segment.with_name(f'{NAME}_el')
    with lock.open('rb') as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert sweep(segment.parent) == 0
    assert segment.exists()
    assert lock.exists()


def test_a_segment_that_may_still_be_being_made_stays(segment: Path) -> None:
    assert sweep(segment.parent) == 0
    assert segment.exists()


@pytest.mark.parametrize('name', ['fastrtps_port7411', 'fastrtps_port7411_el', 'sem.else', 'else'])
def test_nothing_else_is_touched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(shared_memory, '_YOUNG', -1.0)
    (tmp_path / name).write_bytes(b'')
    assert sweep(tmp_path) == 0
    assert (tmp_path / name).exists()


def test_without_the_folder_there_is_nothing_to_do(tmp_path: Path) -> None:
    assert sweep(tmp_path / 'none') == 0
