"""The command's table, its JSON and its figure."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest
from command_line import printed

from barc_sim.__main__ import main as barc
from barc_sim.figures import output
from barc_sim.simulation import convergence
from barc_sim.simulation.convergence import STEPS, Study

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

ERRORS = (1e-1, 5e-2, 2.4e-2, 1.2e-2, 6.1e-3)
PRINTED = ('1.0e-01', '5.0e-02', '2.4e-02', '1.2e-02', '6.1e-03')
MILLISECONDS = ('20 ms', '10 ms', '5 ms', '2.5 ms', '1.25 ms')
STUDIES = [
    Study('circle', 'tight', 'the closed form', 'kinematic', 'euler', ERRORS, 1.0),
    Study('circle', 'tight', 'the closed form', 'kinematic', 'rk4', (1e-13,) * 5, float('nan')),
    Study('hills', 'smooth', 'a fine solution', 'dynamic', 'rk4', (0.0,) * 5, float('nan')),
]
Run = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Be in an empty folder without a display, where studies take no time."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(convergence, 'studies', lambda: iter(STUDIES))
    monkeypatch.setattr(output, 'window', lambda *_: None)
    return tmp_path


def test_table_prints_each_error_and_order_under_its_step() -> None:
    lines = printed('validate').splitlines()
    heading, euler, rk4 = lines[2], lines[4], lines[5]
    assert re.findall(r'[\d.]+ ms|order', heading) == [*MILLISECONDS, 'order']
    assert lines[3] == 'circle (tight), against the closed form'
    assert re.split(' +', euler.strip()) == ['kinematic', 'euler', *PRINTED, '1.00']
    assert rk4.split()[-1] == '\N{EN DASH}'
    assert len(heading) == len(euler) == len(rk4)
    assert lines[6] == 'hills (smooth), against a fine solution'
    assert max(map(len, lines)) <= 100


def test_figure_is_saved_here_where_there_is_no_display(here: Path, capsys: Run) -> None:
    barc(['validate'])
    assert capsys.readouterr().out.splitlines()[-1] == 'convergence.png'
    assert (here / 'convergence.png').read_bytes().startswith(b'\x89PNG')


def test_figure_is_saved_in_the_format_of_its_name(here: Path) -> None:
    assert barc(['validate', '--save', 'a.svg']) == 0
    assert (here / 'a.svg').read_bytes().startswith(b'<?xml')
    assert [path.name for path in here.iterdir()] == ['a.svg']


def test_figure_is_shown_where_there_is_a_display(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from matplotlib.figure import Figure  # noqa: PLC0415 (not for the other tests)

    shown: list[object] = []
    window = Figure()
    monkeypatch.setattr(output, 'window', lambda *_: window)
    monkeypatch.setattr(output, 'show', lambda: shown.append(window))
    assert barc(['validate']) == 0
    assert shown == [window]
    assert window.axes
    assert not list(here.iterdir())


def test_json_is_all_that_is_printed_and_nothing_is_drawn(here: Path) -> None:
    found = json.loads(printed('validate', '--json'))
    assert found['steps'] == list(STEPS)
    assert found['studies'][0] == {
        'test_drive': 'circle',
        'text': 'tight',
        'reference': 'the closed form',
        'model': 'kinematic',
        'integrator': 'euler',
        'errors': list(ERRORS),
        'order': 1.0,
    }
    assert found['studies'][1]['order'] is None
    assert not list(here.iterdir())


@pytest.mark.parametrize('arguments', [['--save', 'a.txt'], ['--save', 'no/such/a.png']])
def test_figure_that_cannot_be_saved_is_one_line_and_code_2(
    capsys: Run, arguments: Sequence[str]
) -> None:
    assert barc(['validate', *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith('barc validate: error: cannot save ')
    assert error.count('\n') == 1
