"""A user's folder of modules, apart from all others, and a time budget for calls."""

from __future__ import annotations

import gc
import sys
import threading
import time
from contextlib import nullcontext
from typing import TYPE_CHECKING

import pytest
from user_files import user_text

from barc_sim.lab.user_code.folder import AbsentModuleError, Folder, OutOfTime, TimeBudget

if TYPE_CHECKING:
    from pathlib import Path


def folder(path: Path, **files: str) -> Folder:
    path.mkdir(exist_ok=True)
    for name, text in files.items():
        (path / f'{name}.py').write_text(text)
    return Folder(path, budget=1.0)


def test_a_helper_that_is_imported_late_is_the_folders_own(tmp_path: Path) -> None:
    text = 'def name():\n    import helpers\n    return helpers.name()\n'
    late = 'def name():\n    from more import name\n    return name\n'
    folders = [
        folder(tmp_path / name, main=text, helpers=late, more=f'name = {name!r}')
        for name in ('one', 'other')
    ]
    modules = [each.load(each.path / 'main.py') for each in folders]
    assert [module.name() for module in modules] == ['one', 'other']


@pytest.mark.parametrize('helpers', ['', '1 / 0'])
def test_loading_leaves_no_module_or_path_behind(tmp_path: Path, helpers: str) -> None:
    before, path, finders = set(sys.modules), list(sys.path), list(sys.meta_path)
    loader = folder(tmp_path, main='import helpers', helpers=helpers)
    with pytest.raises(ZeroDivisionError) if helpers else nullcontext():
        loader.load(loader.path / 'main.py')
    assert set(sys.modules) == before
    assert (sys.path, sys.meta_path) == (path, finders)
    assert sorted(file.name for file in tmp_path.iterdir()) == ['helpers.py', 'main.py']


def test_a_module_of_the_same_name_elsewhere_stays_unchanged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = object()
    monkeypatch.setitem(sys.modules, 'helpers', elsewhere)
    loader = folder(tmp_path, main='import helpers', helpers='mine = True')
    assert loader.load(loader.path / 'main.py').helpers.mine
    assert sys.modules['helpers'] is elsewhere


def test_modules_can_import_each_other(tmp_path: Path) -> None:
    loader = folder(
        tmp_path, main='import helpers', helpers='import main\ndef f(): return main.helpers'
    )
    module = loader.load(loader.path / 'main.py')
    assert module.helpers.f() is module.helpers


def test_a_package_is_imported_as_python_does(tmp_path: Path) -> None:
    files = {
        'a/__init__': 'from .b import B',
        'a/b': 'from top import T\nfrom .c.d import D\nB = T + D',
        'a/c/d': 'D = 20',
        'top': 'T = 1',
    }
    for name in ('a/c', 'e'):
        (tmp_path / name).mkdir(parents=True)
    loader = folder(
        tmp_path,
        main='import a.b, a.c.d as d\nfrom a import B, b, c\nfrom e import f\nimport a.c',
        **files,
        **{'e/f': 'import a'},
    )
    module = loader.load(loader.path / 'main.py')

    assert (module.B, module.b.B, module.a.c.d.D, module.c.d) == (21, 21, 20, module.d)
    assert module.f.a is module.a
    assert [*sys.modules] == [name for name in sys.modules if name not in {'a', 'e', 'a.b'}]


def test_a_standard_module_is_not_hidden_by_a_file_of_its_name(tmp_path: Path) -> None:
    loader = folder(tmp_path, main='import random', random='mine = True')
    assert not hasattr(loader.load(loader.path / 'main.py').random, 'mine')


def test_a_dataclass_with_annotations_as_text_can_be_made(tmp_path: Path) -> None:
    text = (
        'from __future__ import annotations\nfrom dataclasses import dataclass\n'
        '@dataclass\nclass A:\n    x: int = 1\n'
    )
    loader = folder(tmp_path, main=text)
    assert loader.load(loader.path / 'main.py').A().x == 1


ROS_1 = user_text('ros_1_program.py')


def test_the_labs_files_for_ros_1_are_loaded_as_they_are(tmp_path: Path) -> None:
    loader = folder(tmp_path, controller=ROS_1, bike_model='bikeFE = 1')
    module = loader.load(loader.path / 'controller.py')

    assert module.bikeFE == 1
    assert loader.tolerated == [
        'controller.py imports rospy: ROS is not needed',
        'controller.py imports barc.msg: ROS is not needed',
        'controller.py imports labs.msg: ROS is not needed',
        'controller.py imports std_msgs.msg: ROS is not needed',
        'controller.py imports input_map: it is not installed here',
    ]
    with pytest.raises(AbsentModuleError, match=r'^rospy\.get_time\(\), but ROS 1 is not'):
        module.clock()


def test_in_the_process_of_a_submission_only_numpy_is_here(tmp_path: Path) -> None:
    folder(tmp_path, main='import numpy, yaml\ndef f(): return 1 + yaml.load("1")')
    loader = Folder(tmp_path, is_judged=True)
    module = loader.load(tmp_path / 'main.py')
    assert module.numpy.pi > 3.0
    assert loader.tolerated == ['main.py imports yaml: it is not installed here']
    with pytest.raises(AbsentModuleError, match="there is no module 'yaml' here, only NumPy"):
        module.f()


def test_an_import_falls_back_to_its_replacement_where_its_module_is_missing(
    tmp_path: Path,
) -> None:
    text = 'try:\n    import yaml\nexcept ImportError:\n    yaml = 3\n'
    folder(tmp_path, main=text)
    loader = Folder(tmp_path, is_judged=True)
    assert loader.load(tmp_path / 'main.py').yaml == 3
    assert loader.tolerated == []


@pytest.mark.parametrize('text', ["__import__('yaml')", "exec('import yaml', {})"])
def test_a_call_that_imports_a_missing_module_names_it(tmp_path: Path, text: str) -> None:
    folder(tmp_path, main=text)
    with pytest.raises(ModuleNotFoundError, match="there is no module 'yaml' here"):
        Folder(tmp_path, is_judged=True).load(tmp_path / 'main.py')


def forever() -> None:
    while True:
        pass


def test_a_call_is_ended_in_whichever_thread_it_is_made() -> None:
    faults = []

    def make() -> None:
        try:
            TimeBudget(0.1).call(forever)
        except OutOfTime:
            faults.append(threading.current_thread())

    thread = threading.Thread(target=make)
    thread.start()
    thread.join(20.0)
    assert faults == [thread]


def test_many_short_calls_are_not_one_long() -> None:
    budget = TimeBudget(0.1)
    end = time.monotonic() + 0.4
    while time.monotonic() < end:
        budget.call(divmod, 1, 1)


def test_a_budget_serves_again_after_a_call_was_ended() -> None:
    budget = TimeBudget(0.1)
    for _ in range(3):
        with pytest.raises(OutOfTime):
            budget.call(forever)
    assert budget.call(divmod, 7, 2) == (3, 1)


def test_the_thread_ends_with_its_budget() -> None:
    budget = TimeBudget(1.0)
    thread = next(t for t in reversed(threading.enumerate()) if t.name == 'time budget')
    del budget
    gc.collect()
    thread.join(20.0)
    assert not thread.is_alive()
