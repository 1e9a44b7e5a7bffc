"""The command: a class with all that can go wrong in it, graded at once."""

from __future__ import annotations

import csv
import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from bombs import BOMBS
from user_files import CONTROLLER, MODEL, user_text

from barc_sim.__main__ import main as barc
from barc_sim.commands import grade
from barc_sim.errors import UserError
from barc_sim.lab.confined.process import ProcessLimits, check_confinement
from barc_sim.lab.files import BY_HAND
from barc_sim.lab.grade.grade import Grade, Rubric

if TYPE_CHECKING:
    from collections.abc import Iterator
    from concurrent.futures import Executor
    from typing import Any

    Graded = tuple[Path, Path, int]

# The first test's set-up grades a class: for a minute on a busy machine.
pytestmark = pytest.mark.timeout(300)

CLASS = {'class.csv', 'class.html'}
#: Of the default rubric.
MODEL_POINTS, ALL_POINTS = 50.0, 100.0

#: Before a right model: what is tried, and does not work, leaves it right.
ATTACKS = {
    'patch_barc_sim': user_text('attack_patch.py'),
    'kill_parent': user_text('attack_kill.py'),
    'exit_handler': user_text('attack_exit.py'),
    'print_much': user_text('attack_print.py'),
}


@pytest.fixture(scope='module')
def graded(tmp_path_factory: pytest.TempPathFactory) -> Graded:
    """Grade a class; return its folder, that of the reports, and the exit code."""
    try:
        check_confinement(ProcessLimits())
    except UserError as error:
        pytest.skip(str(error))
    folder = tmp_path_factory.mktemp('class')
    (folder / 'submissions').mkdir()

    def add(name: str, **files: str) -> None:
        (folder / 'submissions' / name).mkdir()
        for stem, text in files.items():
            (folder / 'submissions' / name / f'{stem}.py').write_text(text)

    add('reference', bike_model=MODEL, controller=CONTROLLER)
    add('nothing')
    add('class.csv')
    for name, code in ATTACKS.items():
        add(name, bike_model=f'{code}\n{MODEL}')
    (folder / 'submissions' / 'nothing' / 'bike_model.py').symlink_to('../reference/bike_model.py')
    with zipfile.ZipFile(folder / 'submissions' / 'packed.zip', 'w') as archive:
        archive.writestr('lab/controller.py', CONTROLLER)
    (folder / 'submissions' / 'borrowed').symlink_to('reference')
    (folder / 'submissions' / 'eve.rar').write_bytes(b'Rar!')
    packed = (folder / 'submissions' / 'packed.zip').read_bytes()
    (folder / 'submissions' / 'later.zip').write_bytes(packed.replace(b'\x14', b'\xff'))
    out = folder / 'grades'
    exit_code = barc(['grade', str(folder / 'submissions'), '--out', str(out), '--jobs', '1'])
    return folder / 'submissions', out, exit_code


def results(out: Path, name: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((out / name / 'results.json').read_text())
    return content


def test_every_submission_has_a_report(graded: Graded) -> None:
    submissions, out, code = graded
    names = {path.name for path in submissions.iterdir()} - {'class.csv'} | {'class.csv.submission'}

    assert code == 0
    assert {path.name for path in out.iterdir()} == {*names, *CLASS}
    for name in names:
        assert {file.name for file in (out / name).iterdir()} == {
            'results.json',
            'report.html',
            'by_hand.yaml',
        }

    rows = [*csv.DictReader(io.StringIO((out / 'class.csv').read_text()))]
    assert {row['name']: float(row['score']) for row in rows} == {
        name: results(out, name)['score'] for name in names
    }

    remarks = {row['name']: row['remark'] for row in rows}
    assert 'a single .rar file cannot be graded' in remarks['eve.rar']


def test_the_reference_gets_full_marks(graded: Graded) -> None:
    assert results(graded[1], 'reference')['score'] == ALL_POINTS


@pytest.mark.parametrize('name', ATTACKS)
def test_an_attack_changes_no_score(graded: Graded, name: str) -> None:
    assert results(graded[1], name)['score'] == MODEL_POINTS


def test_printed_html_is_shown_and_not_run(graded: Graded) -> None:
    page = (graded[1] / 'print_much' / 'report.html').read_text()

    assert '&lt;script&gt;alert(1)' in page
    assert '<script' not in page
    assert '[and more]' in page


#: Sleeps in each call: below the limit of one call, and of processor time.
_SLEEPY = 'import time\ntime.sleep(15)\n' + MODEL


@contextmanager
def grading(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Grade a class whose first submission is done, and whose second sleeps."""
    for name, files in (('0', {'controller': CONTROLLER}), ('1', {'bike_model': _SLEEPY})):
        (tmp_path / 'submissions' / name).mkdir(parents=True)
        for stem, text in files.items():
            (tmp_path / 'submissions' / name / f'{stem}.py').write_text(text)
    (tmp_path / 'tmp').mkdir()
    command = [sys.executable, '-m', 'barc_sim', 'grade', str(tmp_path / 'submissions')]
    with subprocess.Popen(
        [*command, '--out', str(tmp_path / 'grades'), '--jobs', '1'],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | {'TMPDIR': str(tmp_path / 'tmp')},
    ) as process:
        while process.poll() is None and not children(tmp_path / 'tmp'):
            time.sleep(0.02)
        try:
            yield process
        finally:
            process.kill()


def children(folder: Path) -> list[int]:
    """Return the processes that run the second submission, which is in `folder`."""
    pids = []
    for entry in Path('/proc').iterdir():
        with suppress(OSError):
            cwd = entry.joinpath('cwd').readlink() if entry.name.isdecimal() else None
            if cwd is not None and cwd.is_relative_to(folder) and (cwd / 'bike_model.py').exists():
                pids.append(int(entry.name))
    return pids


def workers(parent: int) -> list[int]:
    """Return the processes of the session of `parent`."""
    numbers = []
    for entry in Path('/proc').iterdir():
        with suppress(OSError, ValueError):
            if os.getsid(int(entry.name)) == parent and int(entry.name) != parent:
                numbers.append(int(entry.name))
    return numbers


def wait_until_gone(process: int, folder: Path) -> None:
    deadline = time.monotonic() + 100.0
    while (workers(process) or children(folder)) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not workers(process)
    assert not children(folder)


@pytest.mark.slow
def test_ctrl_c_ends_a_submission_that_sleeps(tmp_path: Path) -> None:
    with grading(tmp_path) as process:
        began = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=200)
        seconds = time.monotonic() - began

        wait_until_gone(process.pid, tmp_path / 'tmp')

    assert process.returncode == 130, errors
    assert errors.startswith('barc grade: interrupted: 1 of 2 are graded; the files of the')
    assert seconds < 15.0  # for which the submission sleeps
    assert not (tmp_path / 'grades' / 'class.csv').exists()
    assert not [*(tmp_path / 'tmp').iterdir()]


@pytest.mark.slow
def test_workers_end_with_the_grader_however_it_ends(tmp_path: Path) -> None:
    with grading(tmp_path) as process:
        process.kill()
        process.wait()

        wait_until_gone(process.pid, tmp_path / 'tmp')
    assert not [*(tmp_path / 'tmp').iterdir()]


@pytest.mark.usefixtures('graded')  # where code can be confined
def test_ctrl_c_between_two_files_of_a_submission_waits_for_the_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = grade._write  # noqa: SLF001 (at that very moment)

    def interrupted(out: Path, path: Path, data: bytes) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        write(out, path, data)

    monkeypatch.setattr(grade, '_write', interrupted)
    over = threading.Event()

    @contextmanager
    def executor_of(*_: object) -> Iterator[Executor]:
        with ThreadPoolExecutor(1) as pool:
            yield pool
            over.set()

    monkeypatch.setattr(grade, 'executor_of', executor_of)

    def graded(job: grade.GradingJob) -> Grade:
        if job.path.name == 'bob':
            over.wait(60.0)  # the files of ada are written meanwhile
        files = {'report.html': b'1', 'results.json': b'2'}
        return Grade(job.path.name, Rubric({'model.x': 1.0}), (), files=files)

    monkeypatch.setattr(grade, '_grade', graded)
    for name in ('ada', 'bob'):
        (tmp_path / 'in' / name).mkdir(parents=True)
        (tmp_path / 'in' / name / 'bike_model.py').touch()
    assert barc(['grade', str(tmp_path / 'in'), '--out', str(tmp_path / 'out')]) == 130
    files = {'by_hand.yaml', 'report.html', 'results.json'}
    assert {file.name for file in (tmp_path / 'out' / 'ada').iterdir()} == files
    assert [file.name for file in (tmp_path / 'out').iterdir()] == ['ada']  # no part of a class


#: Each pair would share a folder if a name were only made plain.
_NAMES = [
    *(b'class.csv', b'class.csv.submission', b'class.csv.submission.submission'),
    *(b'ren\xe9', rb'ren\udce9', rb'ren\\udce9', b'ren\xc3\xa9', b'ren\xe8'),
    *(b'\xe9' * 250, b'\xe9' * 249 + b'\xe8', b'x' * 255, b'\\' * 254, b'\\' * 255),
]


@pytest.fixture
def quick_grading(monkeypatch: pytest.MonkeyPatch) -> None:
    """Grade in this process, and fail for a submission whose name begins with `class`."""

    @contextmanager
    def executor_of(*_: object) -> Iterator[Executor]:
        with ThreadPoolExecutor(1) as pool:
            yield pool

    def graded(job: grade.GradingJob) -> Grade:
        if job.path.name.startswith('class'):
            raise UserError('it is late')
        return Grade(job.path.name, Rubric({'model.x': 1.0}), (), files={'report.html': b'1'})

    monkeypatch.setattr(grade, 'executor_of', executor_of)
    monkeypatch.setattr(grade, '_grade', graded)


@pytest.mark.usefixtures('graded', 'quick_grading')  # where code can be confined
def test_each_submission_has_a_folder_of_its_own_and_messages_name_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in _NAMES:
        (tmp_path / 'in' / os.fsdecode(name)).mkdir(parents=True)
    out = tmp_path / 'out'
    for _ in range(2):  # again, beside the files of the first time
        assert barc(['grade', str(tmp_path / 'in'), '--out', str(out)]) == 1
        reports = [path for path in out.iterdir() if (path / 'report.html').exists()]
        assert len(reports) == len(_NAMES) - 3

        rows = [*csv.DictReader(io.StringIO((out / 'class.csv').read_text()))]
        assert len({row['name'] for row in rows}) == len(rows) == len(_NAMES)

        assert capsys.readouterr().err.splitlines() == [
            f'barc grade: class.csv{end} could not be graded: it is late'
            for end in ('', '.submission', '.submission.submission')
        ]


def test_a_name_that_looks_like_a_shortened_one_is_shortened_itself(tmp_path: Path) -> None:
    long = grade._folder(tmp_path, Path('x' * 300))  # noqa: SLF001 (longer than this system allows)
    forged = grade._folder(tmp_path, Path(long.name))  # noqa: SLF001
    assert forged != long
    assert forged.name.startswith(long.name[:50])


def test_entries_made_during_grading_are_kept(tmp_path: Path) -> None:
    entered = tmp_path / 'ada' / BY_HAND
    result = Grade('ada', Rubric({}), (), files={'report.html': b'1'})

    def outcomes() -> Iterator[tuple[Path, Grade | str]]:
        entered.parent.mkdir()
        entered.write_text('comment: well driven')
        yield Path('ada'), result

    grade._collect(outcomes(), tmp_path, {Path('ada'): entered.parent}, b'points:')  # noqa: SLF001 (meanwhile)
    assert entered.read_text() == 'comment: well driven'
    assert (entered.parent / 'report.html').exists()


#: Honest submissions, right and wrong ones.
_HONEST = {
    **{f'right_{k}': {'bike_model': MODEL, 'controller': CONTROLLER} for k in range(5)},
    **{f'model_{k}': {'bike_model': MODEL} for k in range(4)},
    'wrong_sign': {'bike_model': MODEL.replace('ts * (a', 'ts * (-a'), 'controller': CONTROLLER},
    'slow': {'controller': CONTROLLER.replace('error =', 'sum(range(300)); error =')},
    'prints': {'controller': CONTROLLER.replace('error =', 'print(dt); error =')},
    'syntax_error': {'bike_model': 'def bikeFE(:', 'controller': CONTROLLER},
    'template': {'bike_model': 'def bikeFE(x, y):\n    raise NotImplementedError'},
    'half': {'controller': CONTROLLER.replace('self.ki', '0.5 * self.ki')},
}
_TAKES_ALL = '_all = [bytearray(1 << 24) for _ in range(50)]\n'
_HOSTILE_CODE = {
    'loops': {'bike_model': 'while True: pass', 'controller': 'while True: pass'},
    'sleeps': {'bike_model': 'import time\ntime.sleep(1000)'},
    'eats': {'bike_model': _TAKES_ALL + MODEL, 'controller': 'x = [0] * 10**12'},
    'crashes': {'bike_model': 'import ctypes\nctypes.string_at(0)'},
    '=cmd|calc!A1': {'bike_model': ATTACKS['kill_parent'] + MODEL},
    'class.csv': {'bike_model': 'import os\nos._exit(0)'},
    '\x1b[2J\nright_0,100': {'controller': user_text('attack_write.py')},
}


@pytest.mark.slow
@pytest.mark.timeout(1200)  # 45 gradings
@pytest.mark.usefixtures('graded')  # where code can be confined
def test_honest_submissions_get_the_same_points_in_a_class_as_alone(tmp_path: Path) -> None:
    folder, out = tmp_path / 'class', tmp_path / 'grades'
    for name, files in (_HONEST | _HOSTILE_CODE).items():
        (folder / name).mkdir(parents=True)
        for stem, text in files.items():
            (folder / name / f'{stem}.py').write_text(text)
    for name, (make_bomb, _) in BOMBS.items():
        (folder / f'{name}.zip').write_bytes(make_bomb())
    os.mkfifo(folder / 'pipe.zip')
    (folder / 'links').symlink_to('/')
    (folder / 'device.zip').symlink_to('/dev/zero')
    (folder / 'empty').mkdir()
    assert len([*folder.iterdir()]) == 2 * len(_HONEST) == 30

    code = barc(['grade', str(folder), '--out', str(out), '--jobs', '2', '--time-limit', '30'])

    rows = [*csv.DictReader(io.StringIO((out / 'class.csv').read_text()))]
    assert (code, len(rows)) == (0, 30)
    for name in _HONEST:
        alone = tmp_path / 'alone' / name
        assert barc(['grade', str(folder / name), '--out', str(alone), '--time-limit', '30']) == 0
        for file in ('results.json', 'report.html'):
            assert (alone / file).read_bytes() == (out / name / file).read_bytes()
