"""The examples of a notebook in the docstring of `barc_sim`."""

from __future__ import annotations

import doctest
from typing import TYPE_CHECKING

import pytest
from made_bags import make

import barc_sim

if TYPE_CHECKING:
    from pathlib import Path


def test_the_examples_print_what_they_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip('pandas')
    (tmp_path / 'bags').mkdir()
    make(tmp_path / 'bags' / '2026-11-21_12-00-00', barc_sim.simulate())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('MPLBACKEND', 'Agg')
    results = doctest.testmod(barc_sim)
    assert results.attempted
    assert not results.failed
