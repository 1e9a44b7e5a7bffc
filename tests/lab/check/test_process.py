"""A folder is judged in a process of its own: nothing in it hangs or ends the command."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.lab.check.lab import Settings
from barc_sim.lab.confined.process import Limits
from barc_sim.lab.hills.lab import HILLS

if TYPE_CHECKING:
    from pathlib import Path

SOME = Settings(criteria=('model.x', 'pid.proportional', 'loop.lab_road'))
SIGNATURE = 'def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):\n'


def write(folder: Path, model: str | None = None, controller: str | None = None) -> Path:
    for name, text in {'bike_model.py': model, 'controller.py': controller}.items():
        if text is not None:
            (folder / name).write_text(text, encoding='utf-8')
    return folder


def test_a_sleep_ends_at_the_deadline(tmp_path: Path, model: str, controller: str) -> None:
    folder = write(tmp_path, model, f'import time\ntime.sleep(1000)\n{controller}')
    report = HILLS.judge_folder(folder, SOME, Limits(wait=0.5, total=30.0))
    assert [finding.passed for finding in report.findings] == [True, False, False]
    assert 'does it sleep, or wait for something?' in report.findings[1].message


def test_an_endless_loop_is_named_and_the_rest_judged(tmp_path: Path, controller: str) -> None:
    folder = write(tmp_path, f'{SIGNATURE}    while True:\n        pass\n', controller)
    report = HILLS.judge_folder(folder, SOME, Limits(call=0.3))
    assert [finding.passed for finding in report.findings] == [False, True, True]
    assert 'bike_model.py, line ' in report.findings[0].message
    assert 'is there an endless loop?' in report.findings[0].message


def test_code_that_ends_the_process_costs_what_is_left(tmp_path: Path, model: str) -> None:
    text = (
        'class PID:\n    def __init__(self, kp, ki, kd): pass\n'
        '    def acc_calculate(self, speed_reference, speed_current):\n'
        '        import os\n        os._exit(3)\n'
    )
    report = HILLS.judge_folder(write(tmp_path, model, text), SOME)
    assert [finding.passed for finding in report.findings] == [True, False, False]
    assert 'has ended itself with exit code 3' in report.findings[2].message


def test_of_prints_the_beginning_is_kept(tmp_path: Path, model: str) -> None:
    text = model.replace('    beta =', '    print("v is", v)\n    beta =')
    printed = HILLS.judge_folder(write(tmp_path, text), SOME).printed
    assert printed.startswith('v is ')
    assert printed.endswith('[and more]')
    assert len(printed) < 20_000
