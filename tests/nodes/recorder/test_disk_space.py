"""Space that recording leaves free."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from barc_sim.errors import UserError
from barc_sim.nodes.recorder import disk_space

if TYPE_CHECKING:
    from pathlib import Path


def test_too_little_space_at_the_start_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk_space, 'free', lambda _: 2**19)
    disk_space.check(tmp_path / 'new', 2**19)
    with pytest.raises(UserError, match=r'only 0.5 MiB are free, and 1 MiB are to stay free: make'):
        disk_space.check(tmp_path / 'new' / 'bags', 2**20)
    assert not (tmp_path / 'new').exists()
