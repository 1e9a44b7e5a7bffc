"""What user code prints, beside a line that is drawn in place."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from barc_sim.runs.terminal.printed import Printed

if TYPE_CHECKING:
    import pytest


def shown(printed: Printed) -> list[str]:
    lines: list[str] = []
    printed.show_with(lines.append)
    return lines


def test_pieces_become_whole_lines() -> None:
    printed = Printed()
    lines = shown(printed)
    for piece in ('a', 'b\nc', '\n\nd'):
        printed(piece)
    assert lines == ['ab', 'c', '']
    printed.close()
    assert lines == ['ab', 'c', '', 'd']


def test_a_file_gets_all_lines() -> None:
    printed = Printed()
    lines = shown(printed)
    printed('x\n' * 1000)
    printed.close()
    assert lines == ['x'] * 1000


def test_a_terminal_gets_some_lines_a_second_and_how_many_were_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys.stdout, 'isatty', lambda: True)
    now = 100.0
    monkeypatch.setattr('time.monotonic', lambda: now)
    printed = Printed()
    lines = shown(printed)
    printed('x\n' * 1000)
    assert lines == ['x'] * 20
    now = 101.0
    printed('y\n')
    assert lines[20:] == ['… lines left out: 980 (with > FILE, all are kept)', 'y']
    printed('z\n' * 20)
    printed.close()
    assert lines[-1].startswith('… lines left out: 1 ')


def test_nothing_is_shown_where_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    printed = Printed(quiet=True)
    printed('a\n')
    printed.close()
    assert capsys.readouterr().out == ''


def test_lines_are_printed_where_nothing_else_shows_them(
    capsys: pytest.CaptureFixture[str],
) -> None:
    printed = Printed()
    printed('a\nb')
    printed.close()
    assert capsys.readouterr().out == 'a\nb\n'
