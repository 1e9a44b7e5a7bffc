"""The files of a grade, with any text that a submission has put into them."""

from __future__ import annotations

import csv
import io
import json
import re

import numpy as np
import pytest
from markupsafe import escape
from rich.console import Console

from barc_sim.lab.confined.process import Limits
from barc_sim.lab.grade import grade as report
from barc_sim.lab.grade import summary
from barc_sim.lab.grade.grade import Failure, Grade, Item, Report
from barc_sim.lab.grade.rubric import Rubric
from barc_sim.lab.grade.submissions import Submission
from barc_sim.lab.hills.loop import Comparison
from barc_sim.lab.hills.model import Trajectory
from barc_sim.simulation.closed_loop import closed_loop

HOSTILE = '<script>alert(1)</script> "\'&$x_{$ [red] \u202e \U0001f600 \u4e16'
LOG = closed_loop(distance=20.0)
TIMES = np.arange(50, dtype=np.float64) * 0.02
STATES = np.stack([TIMES, 2.0 * TIMES, TIMES, TIMES], axis=1)
RUBRIC = Rubric({'model.x': 3.0, 'loop.lab_road': 7.0}, 'The lab', 1)


def grade(text: str = 'fine', *, points: float = 1.25, drawn: bool = True) -> Grade:
    own = STATES + 0.0
    own[20:] = np.nan
    return Grade(
        name=text,
        title='The lab',
        seed=1,
        visibility='after_due_date',
        items=(
            Item('model.x', points, 3.0, text, Trajectory(TIMES, own, STATES) if drawn else None),
            Item('loop.lab_road', 7.0, 7.0, text, Comparison(LOG, LOG) if drawn else None),
        ),
        notes=(text,),
        printed=text,
        hashes=(('bike_model.py', '0' * 64),),
    )


def test_gradescope_is_told_each_criterion() -> None:
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


def test_the_html_report_says_what_is_hostile_and_does_not_do_it() -> None:
    text = report.page(grade(HOSTILE), b'')

    assert text.count(str(escape(HOSTILE))) == 6
    assert '<script' not in text
    assert '<img' not in text


def test_the_html_report_needs_no_network() -> None:
    text = report.page(grade(), b'PNG')

    assert 'src="data:image/png;base64,UE5H"' in text
    assert not re.search(r'(src|href)=(?!"data:)', text)
    assert not re.search(r'https?:', text)


def test_the_report_has_its_figure_where_there_is_one_to_draw(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for drawn in (True, False):
        monkeypatch.setattr(report, 'grade', lambda *_, d=drawn, **__: grade(HOSTILE, drawn=d))
        one, other = (
            report.report(Submission('ada'), RUBRIC, Limits(), sandbox=True) for _ in range(2)
        )
        assert one.files == other.files
        assert (b'data:image/png' in one.files['report.html']) == drawn


def report_of(name: str, points: float, remark: str = '') -> Report:
    both = {'model.x': points, 'loop.lab_road': 7.0}
    return Report(name, points + 7.0, 10.0, both, remark, {})


def test_the_class_is_listed_by_name() -> None:
    reports = [report_of('eve', 3.0), report_of('ada', 1.5, 'x is wrong')]
    failures = {'bob': Failure('no memory')}

    alike = {'ada': [('eve', 0.96), ('the reference', 0.7)]}
    rows = [*csv.reader(io.StringIO(summary.as_csv(reports, failures, RUBRIC, alike)))]

    assert rows == [
        ['name', 'score', 'max_score', 'model.x', 'loop.lab_road', 'alike', 'remark'],
        ['ada', '8.5', '10.0', '1.5', '7.0', 'eve 96%, the reference 70%', 'x is wrong'],
        ['bob', '', '10.0', '', '', '', 'not graded: no memory'],
        ['eve', '10.0', '10.0', '3.0', '7.0', '', ''],
    ]


@pytest.mark.parametrize('sign', '=+-@\uff1d\uff0b\uff0d\uff20')
@pytest.mark.parametrize('before', ['', ' ', '\t', '\r\n', ' "', 'a;', 'a; ', 'a,', 'a\t', 'a|"'])
def test_no_cell_is_a_formula_wherever_a_spreadsheet_splits_the_line(
    before: str, sign: str
) -> None:
    text = before + sign + 'SUM(A1)'

    line = summary.as_csv([report_of(text, 3.0, text)], {}, RUBRIC, {text: [(text, 1.0)]})

    cells = re.split(r'[,;\t|\n]', line)
    assert not [cell for cell in cells if cell.strip('"\' ').startswith(sign) and "'" not in cell]


def printed(*reports: Report) -> list[list[str]]:
    """Return the words in the table of a class."""
    console = Console(width=100, file=io.StringIO(), record=True)
    console.print(summary.as_table(reports, RUBRIC))
    lines = [line.split('  ') for line in console.export_text().splitlines()]
    return [[word.strip() for word in line if word.strip()] for line in lines]


def test_the_table_of_a_class_has_means_and_that_of_one_its_points() -> None:
    words = printed(report_of('ada', 1.0), report_of('eve', 3.0))

    assert ['Model: position x', '2.00', '3', '1 of 2'] in words
    assert ['Score', '9.00', '10', 'median 9, 8 to 10'] in words
    assert ['Model: position x', '1.00', '3'] in printed(report_of('a', 1.0))
    assert printed()  # of none


def overview(*reports: Report, **failures: Failure) -> str:
    console = Console(width=100, file=io.StringIO(), record=True)
    alike = {'ada': [('eve', 0.96)], 'eve': [('ada', 0.96)]}
    for table in summary.overview(reports, failures, RUBRIC, alike):
        console.print(table)
    return ' '.join(console.export_text().split())


def test_the_overview_has_distribution_mistakes_and_who_needs_a_look() -> None:
    missing = 'controller.py, line {}: I has no {}: add it'
    reports = [
        report_of('ada', 1.0)._replace(mistakes={'loop.lab_road': missing.format(7, 'dt')}),
        report_of('eve', 2.0)._replace(mistakes={'loop.lab_road': missing.format(9, 'dt')}),
        report_of('gus', -7.0, 'no PID')._replace(mistakes={'model.x': 'wrong in 3 states'}),
        report_of('hal', 3.0)._replace(notes=('a.csv has more than 1 MiB',)),
        report_of('[bold]', 3.0),
    ]

    text = overview(*reports, bob=Failure('no memory'))

    assert '0 to 1 1 █' in text
    assert '9 to 10 3 ███' in text
    assert '2 ' + "Cruise control: the lab's road I has no dt" in text
    assert '1 Model: position x wrong in … states' in text
    looks = text[text.index('Who needs a look') :]
    assert 'bob not graded: no memory' in looks
    assert 'gus no points: no PID' in looks
    assert 'ada alike: eve 96%' in looks
    assert 'hal a.csv has more than 1 MiB' in looks
    assert 'bold' not in looks


def test_the_overview_of_many_names_those_with_the_fewest_points() -> None:
    reports = [report_of(f's{k}', k / 10)._replace(notes=('a link',)) for k in range(30)]

    text = overview(*reports)

    assert 's0 a link' in text
    assert 'and 10 more see class.csv' in text
    assert 's29' not in text
