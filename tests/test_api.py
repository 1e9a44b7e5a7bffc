"""The examples in the docstrings of what `barc_sim` exports."""

from __future__ import annotations

import doctest
from importlib import import_module
from typing import TYPE_CHECKING

import pytest
from made_bags import make

from barc_sim import simulate

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize('module', ['barc_sim', 'barc_sim.tuning.sweep'])
def test_the_examples_print_what_they_show(
    module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('pandas')
    (tmp_path / 'bags').mkdir()
    make(tmp_path / 'bags' / '2026-11-21_12-00-00', simulate())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('MPLBACKEND', 'Agg')
    found = doctest.testmod(import_module(module))
    assert found.attempted
    assert not found.failed
