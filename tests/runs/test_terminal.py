"""What a run shows, in a terminal and in a pipe."""

from __future__ import annotations

import os
import pty
import re
import sys
import time
from contextlib import closing, redirect_stdout, suppress
from functools import partial
from math import radians
from typing import TYPE_CHECKING

import pytest

from barc_sim.control.driver import COAST, FULL_BRAKE, DriverInput
from barc_sim.runs.terminal import Display, cruise_line, drive_line, print_summary
from barc_sim.simulation.metrics import StretchErrors, Summary

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Capture = pytest.CaptureFixture[str]

HIDE, SHOW = '\x1b[?25l', '\x1b[?25h'
END = '\x04'
LINE = '  1.50 s    12.3 m   7.990 m/s  error +0.010 m/s  grade -10°'
STATE = (12.34, partial(cruise_line, 1.5, 12.34, 7.99, 0.01, -10.0))
PRESSED = DriverInput(forward=1.0, turn=-1.0)
DRIVE = (0.0, partial(drive_line, 12.34, -3.456, radians(-7.26), PRESSED))
DRIVE_LINE = '   12.3 s  speed  -3.46 m/s  steering  -7.3°  held ↑ →'


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Return a function that sets the time [s]."""
    now = [0.0]
    monkeypatch.setattr(time, 'monotonic', lambda: now[0])
    return lambda value: now.__setitem__(0, value)


class Terminal:
    """A terminal to be stdout."""

    def __init__(self) -> None:
        self._master, slave = pty.openpty()
        self.stdout = os.fdopen(slave, 'w', encoding='utf-8')

    def shown(self) -> str:
        """Return what has been shown since the last call."""
        self.stdout.write(END)  # it arrives in pieces, and some time after it was written
        self.stdout.flush()
        data = b''
        while not data.endswith(END.encode()):
            data += os.read(self._master, 1 << 16)
        return data.decode().removesuffix(END)

    def close(self) -> None:
        """Hang up."""
        with suppress(OSError):  # a test may have taken it away
            self.stdout.close()
        os.close(self._master)


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminal]:
    for name in ('NO_COLOR', 'FORCE_COLOR', 'TTY_COMPATIBLE', 'TTY_INTERACTIVE'):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv('TERM', 'xterm')
    monkeypatch.setenv('COLUMNS', '120')
    terminal = Terminal()
    with closing(terminal):
        yield terminal


def test_a_pipe_gets_a_plain_line_a_second(capsys: Capture, clock: Callable[[float], None]) -> None:
    display = Display(180.0)
    for k in range(250):
        clock(10.0 + 0.01 * k)
        display.show(*STATE)
    display.close()
    assert capsys.readouterr() == (f'{LINE}\n' * 3, '')


def test_a_terminal_gets_a_line_in_place_and_its_cursor_back(
    terminal: Terminal, clock: Callable[[float], None]
) -> None:
    clock(10.0)
    with redirect_stdout(terminal.stdout):
        display = Display(180.0)
        display.show(*STATE)
        text = terminal.shown()
        assert HIDE in text
        assert LINE.strip() in text
        assert '\n' not in text

        display.show(12.5, partial(cruise_line, 1.52, 12.5, 8.0, 0.0, 10.0))
        display.close()
        text = terminal.shown()

    assert 'grade +10°' in text  # the last state, however soon after the one before it
    assert text.rindex(SHOW) > text.rfind(HIDE)
    assert text.replace(SHOW, '').endswith('\n')


def test_the_line_leaves_room_for_what_ctrl_c_writes(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('COLUMNS', '40')
    with redirect_stdout(terminal.stdout):
        display = Display(180.0)
        display.show(*STATE)
        lines = re.sub(r'\x1b\[[\d;?]*[A-Za-z]', '', terminal.shown()).split('\r')
        display.close()
    assert max(map(len, lines)) == 38


@pytest.mark.parametrize(('columns', 'line'), [('0', LINE.strip()), ('1', '…'), ('2', '…')])
def test_a_terminal_without_a_size_or_with_few_columns_has_a_line(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch, columns: str, line: str
) -> None:
    monkeypatch.setenv('COLUMNS', columns)  # 0: those of the terminal, which gives none
    monkeypatch.setattr(sys, '__stdout__', terminal.stdout)
    with redirect_stdout(terminal.stdout):
        display = Display()
        display.show(*STATE)
        text = terminal.shown()
        display.close()
    assert line in text


def test_a_drive_by_hand_is_a_line_without_a_bar(terminal: Terminal) -> None:
    with redirect_stdout(terminal.stdout):
        display = Display()
        display.show(*DRIVE)
        text = terminal.shown()
        sys.stdout.write('user code prints [this]\n')
        printed = terminal.shown()
        display.close()

    assert DRIVE_LINE.strip() in text
    assert '━' not in text
    assert 'user code prints [this]' in printed


def test_a_terminal_that_is_gone_does_not_end_the_run(terminal: Terminal) -> None:
    with redirect_stdout(terminal.stdout):
        display = Display()
        display.show(*DRIVE)
        os.dup2(os.open(os.devnull, os.O_RDONLY), terminal.stdout.fileno())  # writing fails
        display.close()


@pytest.mark.parametrize(
    ('pressed', 'keys'),
    [(PRESSED, '↑ →'), (COAST, '-'), (FULL_BRAKE, 'brake'), (DriverInput(-0.5, 0.1), '↓ ←')],
)
def test_held_keys_are_shown_in_columns_that_stay_without_a_negative_zero(
    pressed: DriverInput, keys: str
) -> None:
    still = drive_line(0.0, -0.001, -0.0001, pressed)
    assert still.endswith(f'held {keys}')
    assert '-0' not in still
    assert still.index('held') == DRIVE_LINE.index('held')


def test_the_table_has_a_row_per_stretch_and_the_other_figures(capsys: Capture) -> None:
    print_summary(
        Summary(
            rms_error=0.9768,
            max_error=8.0,
            rms_error_after_run_up=0.0207,
            max_error_after_run_up=0.1263,
            overshoot=0.0034,
            settling_time=1.004,
            missed_deadlines=3,
            stretches=(
                StretchErrors(0.0, 19.9, 0.0, 2.7, 8.0),
                StretchErrors(20.1, 39.9, -10.0, 0.01, 0.04),
            ),
        ),
        'missed deadlines 3, clock slips 2',
    )
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]

    assert ['whole', 'run', '0.9768', '8.0000'] in rows
    assert ['after', '10', 'm', '0.0207', '0.1263'] in rows
    assert ['20.1', 'to', '39.9', 'm', '-10°', '0.0100', '0.0400'] in rows
    assert ' '.join(rows[-1]) == (
        'overshoot 0.3%, settling time (2 %) 1.00 s, missed deadlines 3, clock slips 2'
    )
