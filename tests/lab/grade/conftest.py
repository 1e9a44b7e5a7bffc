"""Submissions to grade: right ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import CONTROLLER, MODEL

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.fixture(scope='session')
def model() -> str:
    """Return the text of a right `bike_model.py`."""
    return MODEL


@pytest.fixture(scope='session')
def controller() -> str:
    """Return the text of a right `controller.py`."""
    return CONTROLLER


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
