"""Submissions to grade."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.fixture
def folder(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes a folder of files, given by name."""

    def write(name: str = 'student', **files: str) -> Path:
        path = tmp_path / name
        path.mkdir()
        for stem, text in files.items():
            (path / f'{stem}.py').write_text(text)
        return path

    return write
