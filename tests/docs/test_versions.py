"""One version, wherever a release has to write it."""

from __future__ import annotations

import re
from pathlib import Path

import barc_sim

ROOT = Path(__file__).parents[2]


def test_all_files_have_the_same_version() -> None:
    for name, pattern in (
        ('setup.cfg', r'^version = (.+)$'),
        ('package.xml', r'<version>(.+)</version>'),
        ('CITATION.cff', r'^version: (.+)$'),
    ):
        found = re.search(pattern, (ROOT / name).read_text(encoding='utf-8'), re.MULTILINE)
        assert found, name
        assert found[1] == barc_sim.__version__, name
