"""The bag of a run that does not begin."""

from __future__ import annotations

from argparse import Namespace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from barc_sim.runs.bag import RunBag

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize('others', [True, False], ids=['with another run', 'alone'])
def test_a_discarded_bag_takes_a_new_folder_with_it_but_not_anothers_bag(
    tmp_path: Path, others: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / 'bags'
    monkeypatch.setattr('barc_sim.runs.bag.recording', lambda _: None)
    monkeypatch.setattr('barc_sim.runs.bag.user_code_metadata', lambda _: {})
    monkeypatch.setattr('barc_sim.runs.bag.attachments', lambda _: {})
    engine: Any = SimpleNamespace(recorder=lambda *_: SimpleNamespace(path=root / 'mine'))
    bag = RunBag(Namespace(bag_dir=root), engine, engine)
    (root / 'mine').mkdir(parents=True)
    if others:
        (root / 'theirs').mkdir()

    bag.discard()

    assert sorted(tmp_path.rglob('*')) == ([root, root / 'theirs'] if others else [])
