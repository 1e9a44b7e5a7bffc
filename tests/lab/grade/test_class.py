"""A class: its roster, what is entered by hand, and the file for a gradebook."""

from __future__ import annotations

import csv
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

import pytest
from command_line import refused

from barc_sim.__main__ import main as barc
from barc_sim.commands import grade as command
from barc_sim.errors import UserError
from barc_sim.lab.confined.process import ProcessLimits
from barc_sim.lab.grade.classroom import Student, owner, read_roster
from barc_sim.lab.grade.grade import ByHand, Rubric, entered, load_rubric
from barc_sim.lab.submission import Submission

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

ROSTER = """name,id,section
"Chen, Li",123457,A
Li Chen Wang,123458,A
Zoë Ångström,zoe99,B
Ada Lovelace,123459,B
Ada Byron,123460,B
"""


@pytest.fixture
def students(tmp_path: Path) -> list[Student]:
    (tmp_path / 'roster.csv').write_text(ROSTER, encoding='utf-8')
    return read_roster(tmp_path / 'roster.csv')


@pytest.mark.parametrize(
    ('folder', 'name'),
    [
        ('chen_li_123457_998878_my_lab-2.zip', 'Chen, Li'),
        ('chenli_LATE_4711_998878_lab.zip', 'Chen, Li'),
        ('wanglichen_4711_123', 'Li Chen Wang'),
        ('li_chen_wang', 'Li Chen Wang'),
        ('angstrom-zoe', 'Zoë Ångström'),
        ('ZOE99', 'Zoë Ångström'),
        ('x_123459_123460', None),
        ('lovelace_ada_123459_123460', 'Ada Lovelace'),
        ('ada', None),
        ('lab', None),
    ],
)
def test_a_folder_belongs_to_a_student_by_id_or_name(
    students: list[Student], folder: str, name: str | None
) -> None:
    student = owner(folder, students)
    assert (student and student.name) == name


def test_rosters_of_canvas_and_gradescope_are_read(tmp_path: Path) -> None:
    file = tmp_path / 'r.csv'
    file.write_text(
        '\ufeffStudent,ID,SIS User ID,SIS Login ID,Section,Lab 1 (3)\n'
        '    Points Possible,,,,,10\n"Li, Chen",7,123457,cli,Lab A,9\n',
        encoding='utf-8',
    )
    (canvas,) = read_roster(file)
    assert (canvas.name, canvas.section, sorted(canvas.ids)) == (
        'Li, Chen', 'Lab A', ['123457', '7', 'cli'],
    )  # fmt: skip

    file.write_text('First Name,Last Name,SID,Email\nChen,Li,5,chen@x.org\n', encoding='utf-8')
    assert (read_roster(file)[0].name, read_roster(file)[0].id) == ('Chen Li', '5')


@pytest.mark.parametrize('encoding', ['utf-8-sig', 'cp1252', 'utf-16'])
@pytest.mark.parametrize('end', ['\n', '\r\n', '\r'])
@pytest.mark.parametrize('delimiter', [',', ';', '\t'])
def test_a_roster_is_read_as_spreadsheets_save_it(
    tmp_path: Path, encoding: str, end: str, delimiter: str
) -> None:
    rows = [['Name', 'ID', 'Section'], ['Zoë Ångström', '7', 'A'], ['Ada Byron']]
    text = ''.join(f'{delimiter.join(row)}{end}' for row in rows)
    (tmp_path / 'r.csv').write_bytes(text.encode(encoding))
    zoe, ada = read_roster(tmp_path / 'r.csv')
    assert (zoe.name, zoe.id, zoe.section) == ('Zoë Ångström', '7', 'A')
    assert (ada.name, ada.id, ada.section) == ('Ada Byron', '', '')


@pytest.mark.parametrize('text', ['a,b\n1,2\n', '', 'name,id\n"Ada,1\n', None])
def test_a_roster_without_names_is_refused(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / 'r.csv').write_text(text, encoding='utf-8')
    with pytest.raises(
        UserError, match=r"the roster '.*r.csv' (has no column name|cannot be read)"
    ):
        read_roster(tmp_path / 'r.csv')


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('points: {model.z: 3}', "'model.z' is unknown: expected one of model.x"),
        ('points: {model.x: much}', "model.x is 'much': expected points from 0 to 8, and"),
        ('points: {model.x: -1}', 'model.x is -1: expected points'),
        ('points: {model.x: 80 good}', "model.x is '80 good': expected points from 0 to 8"),
        ('points: {model.x: nan}', 'model.x is nan: expected points'),
        ('points: [', 'is not YAML: expected the node content'),
        ('- 1', 'it is [1]: expected lines'),
    ],
)
def test_a_wrong_entry_by_hand_is_a_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / 'by_hand.yaml').write_text(text, encoding='utf-8')
    with pytest.raises(UserError) as caught:
        entered(tmp_path, Rubric({'model.x': 8.0}))
    assert sentence in str(caught.value)


MODEL = 'def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):\n    return [{}, y, psi, v]\n'
FIRST, AGAIN, BOB = 'chen_li_123457_998_lab', 'chen_li_123457_999_lab-2', 'bob'


@pytest.mark.usefixtures('confinement')
def test_grading_again_keeps_the_points_by_hand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, 'executor_of', lambda *_: ThreadPoolExecutor())  # starts at once
    submissions, out = tmp_path / 'in', tmp_path / 'out'
    rubric = tmp_path / 'rubric.yaml'
    rubric.write_text('title: Lab\ncriteria: {model.y: 2}\ntask_3: {relay.rate: 3}\n')
    (tmp_path / 'roster.csv').write_text(ROSTER, encoding='utf-8')
    for name in (FIRST, AGAIN, BOB):
        (submissions / name).mkdir(parents=True)
        (submissions / name / 'bike_model.py').write_text(MODEL.format('x'))

    def grade() -> dict[str, dict[str, str]]:
        options = ['--rubric', str(rubric), '--out', str(out), '--jobs', '1']
        options += ['--roster', str(tmp_path / 'roster.csv')]
        assert barc(['grade', str(submissions), *options]) == 0
        rows = csv.DictReader((out / 'class.csv').read_text(encoding='utf-8').splitlines())
        return {row['name'] or row['student']: row for row in rows}

    rows = grade()
    assert (rows[FIRST]['student'], rows[FIRST]['score']) == ('Chen, Li', '0.0')
    assert 'not in the roster' in rows[BOB]['remark']
    assert rows['Ada Byron']['remark'] == 'nothing handed in'

    (out / FIRST / 'by_hand.yaml').write_text(
        'comment: well driven\npoints:\n  model.y: 1.5 a slip\n  relay.rate: 3\n'
    )
    rows = grade()
    assert [rows[FIRST][name] for name in ('model.y', 'relay.rate', 'max_score', 'comment')] == [
        '1.5', '3.0', '5.0', 'well driven',
    ]  # fmt: skip
    assert 'a slip; by hand (computed: 0)' in (out / FIRST / 'report.html').read_text()
    assert rows[AGAIN]['score'] == '0.0'
    assert rows[FIRST]['remark'].startswith('handed in more than once')

    canvas = [*csv.reader((out / 'canvas.csv').read_text(encoding='utf-8').splitlines())]
    assert canvas[0][-2:] == ['Lab', 'Lab: Task 3']
    assert canvas[1][-2:] == ['2.0', '3.0']
    assert [row for row in canvas if row[0] == 'Chen, Li'] == [
        ['Chen, Li', '', '123457', '', 'A', '', ''],  # handed in twice: a person chooses one
    ]
    assert ['Ada Byron', '', '123460', '', 'B', '', ''] in canvas

    page = (out / 'class.html').read_text(encoding='utf-8')
    assert f'href="{AGAIN}/report.html"' in page
    assert str(out / 'class.html') in capsys.readouterr().out

    before = (out / 'class.csv').read_bytes()
    assert barc(['grade', str(submissions / BOB), '--rubric', str(rubric), '--out', str(out)]) == 0
    assert (out / 'class.csv').read_bytes() == before  # of the class, and not of one


def test_no_file_is_written_beside_the_submissions(folder: Callable[..., Path]) -> None:
    path = folder('ada', bike_model=MODEL)
    for submissions in (path, path.parent):
        assert 'has the submissions: name another folder' in refused(
            'grade', str(submissions), '--out', str(submissions)
        )
    assert [file.name for file in path.rglob('*')] == ['bike_model.py']


def test_a_fault_of_the_grader_does_not_stop_the_others(
    folder: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def grade(job: command.GradingJob) -> str:
        if job.path.name == 's1':
            raise MemoryError('too little')
        return job.path.name

    monkeypatch.setattr(command, '_grade', grade)
    rubric = load_rubric()
    jobs = [
        command.GradingJob(path, Submission(path.name), ByHand(), rubric, ProcessLimits())
        for path in (folder(f's{i}') for i in range(3))
    ]
    with ThreadPoolExecutor(2) as pool:
        outcomes = command.grade_all(pool, Future(), jobs)
        outcome_of = {path.name: outcome for path, outcome in outcomes}

    assert outcome_of == {
        's0': 's0',
        's1': 'MemoryError: too little',
        's2': 's2',
    }
