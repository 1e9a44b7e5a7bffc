"""The files of a grade, with any text that a submission has put into them."""

from __future__ import annotations

import csv
import io
import json
import re

import pytest
from markupsafe import escape
from matplotlib.figure import Figure

from barc_sim.lab.grade import classroom
from barc_sim.lab.grade import grade as report
from barc_sim.lab.grade.grade import Grade, Item, Rubric
from barc_sim.lab.judge import Evidence, Settings

HOSTILE = '<script>alert(1)</script> "\'&$x_{$ [red] \u202e \U0001f600 \u4e16'
RUBRIC = Rubric(
    {'model.x': 3.0, 'loop.lab_road': 7.0, 'relay.rate': 5.0},
    Settings(seed=1),
    'The lab',
    'after_due_date',
    optional=frozenset({'relay.rate'}),
)


def grade(text: str = 'fine', *, points: float = 1.25, has_figure: bool = True) -> Grade:
    runs = Evidence('', (), (), lambda _: Figure())
    return Grade(
        name=text,
        rubric=RUBRIC,
        items=(
            Item('model.x', points, 3.0, text),
            Item('loop.lab_road', 7.0, 7.0, text, evidence=runs if has_figure else None),
        ),
        notes=(text,),
        printed=text,
        hashes={'bike_model.py': '0' * 64},
    )


def test_gradescopes_results_have_each_criterion() -> None:
    content = json.loads(report.gradescope(grade()))

    assert content['score'] == 8.25
    assert content['stdout_visibility'] == 'hidden'

    first, second = content['tests']
    assert first == {
        'name': 'Model: position x',
        'number': 'model.x',
        'score': 1.25,
        'max_score': 3.0,
        'status': 'failed',
        'output': 'fine',
        'output_format': 'text',
        'visibility': 'after_due_date',
    }
    assert second['status'] == 'passed'


def test_the_html_report_shows_hostile_text_without_running_it() -> None:
    text = report.report_page(grade(HOSTILE, has_figure=False))

    assert text.count(str(escape(HOSTILE))) == 6
    assert '<script' not in text
    assert '<img' not in text


def test_the_html_report_keeps_the_seed_from_the_students() -> None:
    assert 'seed' not in report.report_page(grade())
    assert json.loads(report.gradescope(grade()))['extra_data']['seed'] == 1


def test_the_html_report_needs_no_network() -> None:
    text = report.report_page(grade())

    assert 'src="data:image/png;base64,' in text
    assert not re.search(r'(src|href)=(?!"data:)', text)
    assert not re.search(r'https?:', text)


def grade_of(name: str, points: float, message: str = 'wrong', third: float | None = None) -> Grade:
    items = [Item('model.x', points, 3.0, message), Item('loop.lab_road', 7.0, 7.0, '')]
    items += [] if third is None else [Item('relay.rate', third, 5.0, '', open=third < 0.0)]
    return Grade(name, RUBRIC, tuple(items))


def listed(*grades: Grade, **failures: str) -> list[classroom.ClassEntry]:
    return classroom.entries({each.name: each for each in grades}, failures, [])


def test_the_class_is_listed_by_name() -> None:
    page = listed(grade_of('eve', 3.0), grade_of('ada', 1.5, 'x is wrong'), bob='no memory')
    rows = [*csv.reader(io.StringIO(classroom.as_csv(page, RUBRIC)))]

    criteria = ['model.x', 'loop.lab_road', 'relay.rate']
    rest = ['open', 'comment', 'remark']
    assert rows == [
        ['name', 'score', 'max_score', *criteria, *rest],
        ['ada', '8.5', '10.0', '1.5', '7.0', '', '', '', 'Model: position x: x is wrong'],
        ['bob', '', '', '', '', '', '', '', 'not graded: no memory'],
        ['eve', '10.0', '10.0', '3.0', '7.0', '', '', '', ''],
    ]


@pytest.mark.parametrize('sign', '=+-@')
@pytest.mark.parametrize('before', ['', ' "', 'a; ', 'a,', 'a\t', 'a|"'])
def test_no_cell_is_a_formula_wherever_a_spreadsheet_splits_the_line(
    before: str, sign: str
) -> None:
    text = before + sign + 'SUM(A1)'

    line = classroom.as_csv(listed(grade_of(text, 2.0, text)._replace(comment=text)), RUBRIC)

    cells = re.split(r'[,;\t|\n]', line)
    assert not [cell for cell in cells if cell.strip('"\' ').startswith(sign) and "'" not in cell]


def test_the_mean_of_task_3_is_separate() -> None:
    ada, eve = grade_of('ada', 1.0), grade_of('eve', 3.0, third=4.0)
    gus = grade_of('gus', 0.0, third=-1.0)

    assert classroom.summary([ada, eve, gus], RUBRIC) == [
        'Score   8.33 of 10  (median 8, 7 to 10)',
        'Task 3  4.00 of 5  (median 4, 4 to 4)',
    ]
    assert classroom.summary([ada], RUBRIC) == ['Score   8.00 of 10']
    assert classroom.summary([], RUBRIC) == []


def test_a_mistake_keeps_the_brackets_of_its_formula() -> None:
    text = 'controller.py, line 7: I is wrong: it is ki * (sum of e * dt)'
    page = listed(grade_of('ada', 1.0, text))
    assert 'I is wrong: it is ki * (sum of e * dt)' in classroom.class_page(page, RUBRIC)


def test_a_failing_call_is_a_mistake_whatever_was_passed_in() -> None:
    text = 'bike_model.py, line 7: bikeFE(x=-1.5, y=0) raised NameError'
    page = classroom.class_page(listed(grade_of('ada', 1.0, text)), RUBRIC)
    assert '<br>bikeFE raised NameError' in page


def test_mistakes_that_differ_in_a_number_are_one_with_the_first_number() -> None:
    ada = grade_of('ada', 1.0, 'g is 9.81: it has 9.8')
    eve = grade_of('eve', 1.0, 'g is 10: it has 9.8')
    page = classroom.class_page(listed(ada, eve), RUBRIC)
    assert re.search(r'>2</td><td><span[^>]*>Model: position x</span><br>g is 9.81: it has', page)


def test_the_page_has_mistakes_and_who_needs_a_look_and_does_nothing_hostile() -> None:
    missing = 'controller.py, line {}: x has no {}: add it'
    grades = [
        grade_of('ada', 1.0, missing.format(7, 'dt')),
        grade_of('eve', 2.0, missing.format(9, 'dt')),
        grade_of('gus', -7.0, 'wrong in 3 states'),
        grade_of('hal', 3.0)._replace(notes=('a.csv has more than 1 MiB',)),
        grade_of(HOSTILE, 2.5, HOSTILE, -1.0)._replace(comment=HOSTILE),
    ]
    students = listed(*grades, bob='no memory')
    text = classroom.class_page(students, RUBRIC)

    assert text.count(str(escape(HOSTILE))) == 3
    assert text.count('<script') == 1
    assert re.search(r'>2</td><td><span[^>]*>Model: position x</span><br>x has', text)
    looks = {each.folder: each.looks for each in students if each.looks}
    assert looks == {
        'bob': ('not graded: no memory',),
        'hal': ('a.csv has more than 1 MiB',),
        HOSTILE: ('judge by eye: Relay: commands a second',),
    }
