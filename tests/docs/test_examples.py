"""The examples in docstrings are right: of what `import barc_sim` offers, and of every room."""

from __future__ import annotations

import doctest
import gc
import shutil
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import walk_packages
from typing import TYPE_CHECKING

import pytest
from made_bags import make

import barc_sim

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType

#: Those whose examples need no ROS, and those whose examples do.
ROOMS = (
    'errors', 'cli', 'vehicle', 'control', 'simulation', 'tuning', 'learning', 'bags',
    'figures', 'commands', 'nodes',
)  # fmt: skip
NEED_ROS = ('nodes',)
#: Examples that need an optional package.
NEED_DAQP = {
    'barc_sim.control.planning.racing_line',
    'barc_sim.control.mpc.MPC',
    'barc_sim.control.mpc.SpeedMPC',
}


@pytest.fixture(scope='module')
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a bag, as that of runs."""
    folder = tmp_path_factory.mktemp('runs') / 'bags'
    folder.mkdir()
    make(folder / '2026-11-21_12-00-00', barc_sim.simulate())
    return folder


def _modules(room: str) -> Iterator[ModuleType]:
    module = import_module(f'barc_sim.{room}')
    yield module
    for info in walk_packages(getattr(module, '__path__', []), f'{module.__name__}.'):
        if 'templates' not in info.name:
            yield import_module(info.name)


@pytest.mark.parametrize('name', barc_sim.__all__)
def test_each_exported_name_has_an_example(name: str) -> None:
    assert '>>> ' in getattr(barc_sim, name).__doc__


@pytest.mark.parametrize('room', ROOMS)
def test_the_examples_of_a_room_are_right(
    room: str,
    bags: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    monkeypatch.setenv('MPLBACKEND', 'agg')
    monkeypatch.setattr(sys, 'path', [*sys.path])  # the confined process shortens its own

    if room == 'learning':
        pytest.importorskip('gymnasium', reason='needs the extra gym')
    if room in NEED_ROS:
        pytest.importorskip('rclpy')
        request.getfixturevalue('ros_domain')

    finder = doctest.DocTestFinder()
    tests = [test for each in _modules(room) for test in finder.find(each) if test.examples]
    assert tests

    for test in tests:
        if test.name in NEED_DAQP and not find_spec('daqp'):
            continue
        folder = tmp_path / test.name  # of its own
        folder.mkdir()
        monkeypatch.chdir(folder)
        if "'bags'" in (test.docstring or ''):
            shutil.copytree(bags, 'bags')

        output: list[str] = []
        test.globs['Path'] = Path
        doctest.DocTestRunner().run(test, out=output.append)
        assert not output, ''.join(output)

        if room in NEED_ROS:  # an example needs not destroy its nodes
            import_module('rclpy').try_shutdown()
            gc.collect()
