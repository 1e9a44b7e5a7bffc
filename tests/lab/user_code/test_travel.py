"""User code on its way to another process: the same files, the same bits, the same errors."""

from __future__ import annotations

import os
import pickle
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from user_files import CONTROLLER

from barc_sim import sweep
from barc_sim.lab.files import UserCodeError
from barc_sim.lab.user_code.adapters import UserController, controller_of
from barc_sim.lab.user_code.code import UserCode
from barc_sim.parallel.processes import processes

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.timeout(120)

KP = [5.0, 12.0, 30.0]
#: A controller that imports a module when it is loaded, another one in a function, and a package.
FILES = {
    'controller.py': (
        'import gains\n'
        'from laws.proportional import law\n'
        'class PID:\n'
        '    def __init__(self, kp, ki, kd): self.kp = kp\n'
        '    def acc_calculate(self, r, v):\n'
        '        import late\n'
        '        return law(self.kp * late.FACTOR, r - v)\n'
        'pid = PID(kp=gains.KP, ki=0.0, kd=0.0)\n'
    ),
    'gains.py': 'KP = 17.0\n',
    'late.py': 'FACTOR = 0.5\n',
    'laws/__init__.py': '',
    'laws/proportional.py': 'from .inner import product\nlaw = product\n',
    'laws/inner.py': 'def product(a, b): return a * b\n',
    'unrelated.py': 'raise RuntimeError\n',
}


def written_to(folder: Path, files: dict[str, str]) -> UserController:
    """Write files to a folder; return the controller in it."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return controller_of(folder / 'controller.py')


def arrived(controller: UserController) -> UserController:
    """Return the controller as it arrives in another process."""
    value: UserController = pickle.loads(pickle.dumps(controller))  # noqa: S301 (our own)
    value.reset()
    return value


def files_of(controller: UserController) -> list[Path]:
    """Return the files of a controller that has arrived, in the process that calls this."""
    folder = controller._code.paths['controller'].parent  # noqa: SLF001 (to see what is there)
    return sorted(path.relative_to(folder) for path in folder.rglob('*.py'))


def folder_of(controller: UserController) -> tuple[int, Path]:
    """Return this process, and the folder of a controller that has arrived in it."""
    path = controller._code.paths['controller']  # noqa: SLF001 (to see what is there)
    assert path.is_file()
    return os.getpid(), path.parent


@pytest.fixture(scope='module')
def pool() -> Iterator[ProcessPoolExecutor]:
    """Return a process that the tests share."""
    with ProcessPoolExecutor(1) as executor:
        yield executor


def test_a_sweep_of_a_users_controller_has_the_same_bits_in_processes(
    tmp_path: Path, pool: ProcessPoolExecutor
) -> None:
    controller = written_to(tmp_path, FILES)
    shared = sweep(kp=KP, controller=controller, distance=20.0, executor=pool)
    assert shared.tobytes() == sweep(kp=KP, controller=controller, distance=20.0).tobytes()
    assert len({*shared.rms_error}) == len(KP)


def test_what_it_imports_travels_and_nothing_else(tmp_path: Path) -> None:
    controller = written_to(tmp_path, FILES)
    expected = sorted(Path(name) for name in FILES if name != 'unrelated.py')
    assert files_of(arrived(controller)) == expected


def test_it_travels_as_it_was_loaded_though_the_file_has_changed(tmp_path: Path) -> None:
    controller = written_to(tmp_path, {'controller.py': CONTROLLER})
    (tmp_path / 'controller.py').write_text('no Python')
    there = arrived(controller)
    assert there.acc_calculate(8.0, 7.0, 0.02) == controller.acc_calculate(8.0, 7.0, 0.02)


def test_gains_and_limits_travel(tmp_path: Path) -> None:
    controller = written_to(tmp_path, FILES)
    controller.kp = 3.0
    controller.output_max = 1.0
    there = arrived(controller)
    assert (there.kp, there.output_max) == (3.0, 1.0)
    assert there.acc_calculate(8.0, 0.0, 0.02) == 1.0


def test_equal_files_are_written_once_and_removed_with_the_process(tmp_path: Path) -> None:
    controller = written_to(tmp_path, {'controller.py': CONTROLLER})
    with ProcessPoolExecutor(1) as executor:
        process, folder = executor.submit(folder_of, controller).result()
        controller.kp = 1.0
        again = executor.submit(folder_of, controller).result()
        (tmp_path / 'controller.py').write_text(CONTROLLER + '\n# changed\n')
        _, other = executor.submit(folder_of, controller_of(tmp_path / 'controller.py')).result()

    assert again == (process, folder)
    assert other != folder
    assert process != os.getpid()
    assert not folder.exists()
    assert not other.exists()


def test_parts_of_two_folders_keep_their_own_helpers(tmp_path: Path) -> None:
    files = {}
    for part, name in (('controller', 'controller.py'), ('identify', 'identify.py')):
        folder = tmp_path / part
        folder.mkdir()
        (folder / 'helper.py').write_text(f'PART = {part!r}\n')
        (folder / name).write_text('import helper\ndef command(t): return 1.0\nclass PID: pass\n')
        files[part] = folder / name
    code: UserCode = pickle.loads(pickle.dumps(UserCode(files)))  # noqa: S301 (our own)
    for part, path in code.paths.items():
        assert repr(part) in (path.parent / 'helper.py').read_text()


@pytest.mark.parametrize(
    ('files', 'changed'),
    [
        ({'controller.py': CONTROLLER.replace('kp *', 'kq *')}, {}),
        (FILES, {'late.py': 'raise ZeroDivisionError\n'}),
        (FILES, {'late.py': 'FACTOR = = 1\n'}),
    ],
)
def test_an_error_on_a_worker_is_the_sentence_that_it_is_here(
    files: dict[str, str], changed: dict[str, str], tmp_path: Path, pool: ProcessPoolExecutor
) -> None:
    controller = written_to(tmp_path, files | changed)
    options: dict[str, Any] = {'kp': KP, 'controller': controller, 'distance': 20.0}
    with pytest.raises(UserCodeError) as here:
        sweep(**options)
    with pytest.raises(UserCodeError) as there:
        sweep(**options, executor=pool)
    assert str(there.value) == str(here.value)
    assert there.value.kind == here.value.kind


def test_a_controller_that_cannot_be_loaded_on_a_worker_ends_no_process(tmp_path: Path) -> None:
    (tmp_path / 'data.txt').write_text('12.0')
    text = FILES['controller.py'].replace('import gains', 'from pathlib import Path')
    text = text.replace('gains.KP', "float((Path(__file__).parent / 'data.txt').read_text())")
    controller = written_to(tmp_path, FILES | {'controller.py': text})
    with processes(1) as executor, pytest.raises(UserCodeError, match='No such file or directory'):
        sweep(kp=KP, controller=controller, distance=20.0, executor=executor)
