"""Each name that `import barc_sim` offers has an example in its docstring, which is right."""

from __future__ import annotations

import doctest
import importlib
from typing import TYPE_CHECKING

import pytest
from command_line import call

import barc_sim

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize('name', barc_sim.__all__)
def test_example_is_right(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.chdir(tmp_path)
    if name == 'read_bag':
        request.getfixturevalue('ros_domain')
        assert call('acc', '--realtime-factor', 'max', '--quiet').returncode == 0
    value = getattr(barc_sim, name)
    names = {**vars(importlib.import_module(value.__module__))}
    names |= {'Path': type(tmp_path)}
    test = doctest.DocTestParser().get_doctest(value.__doc__ or '', names, name, None, None)
    assert test.examples
    told: list[str] = []
    doctest.DocTestRunner().run(test, out=told.append)
    assert not told, ''.join(told)
