"""What user code prints, beside a line that is drawn in place."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from barc_sim.runs.terminal.user_output import UserOutput

if TYPE_CHECKING:
    import pytest


def shown(output: UserOutput) -> list[str]:
    lines: list[str] = []
    output.show_with(lines.append)
    return lines


def test_pieces_become_whole_lines() -> None:
    output = UserOutput()
    lines = shown(output)
    for piece in ('a', 'b\nc', '\n\nd'):
        output(piece)
    assert lines == ['ab', 'c', '']
    output.close()
    assert lines == ['ab', 'c', '', 'd']


def test_a_file_gets_all_lines() -> None:
    output = UserOutput()
    lines = shown(output)
    output('x\n' * 1000)
    output.close()
    assert lines == ['x'] * 1000


def test_a_terminal_gets_some_lines_a_second_and_how_many_were_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys.stdout, 'isatty', lambda: True)
    now = 100.0
    monkeypatch.setattr('time.monotonic', lambda: now)
    output = UserOutput()
    lines = shown(output)
    output('x\n' * 1000)
    assert lines == ['x'] * 20
    now = 101.0
    output('y\n')
    assert lines[20:] == ['… lines left out: 980 (with > FILE, all are kept)', 'y']
    output('z\n' * 20)
    output.close()
    assert lines[-1].startswith('… lines left out: 1 ')


def test_nothing_is_shown_where_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    output = UserOutput(quiet=True)
    output('a\n')
    output.close()
    assert capsys.readouterr().out == ''


def test_lines_are_output_where_nothing_else_shows_them(capsys: pytest.CaptureFixture[str]) -> None:
    output = UserOutput()
    output('a\nb')
    output.close()
    assert capsys.readouterr().out == 'a\nb\n'
