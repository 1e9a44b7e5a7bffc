"""README fits a screen of patience: at most 120 lines, and every file that it names is there."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = (ROOT / 'README.md').read_text(encoding='utf-8')


def test_it_is_short() -> None:
    assert len(README.splitlines()) <= 120


def test_pictures_and_files_that_it_names_are_there() -> None:
    for path in re.findall(r'\]\(([\w/.-]+)', README):
        assert (ROOT / path).exists(), path
