"""The line of a drive by hand."""

from __future__ import annotations

from math import radians
from typing import TYPE_CHECKING

import pytest

from barc_sim.control.driver import COAST, FULL_BRAKE, DriverInput
from barc_sim.runs.terminal.status_line import Status, StatusLine, text

if TYPE_CHECKING:
    from pytest import CaptureFixture  # noqa: PT013 (a type)

RIGHT = Status(12.34, -3.456, radians(-7.26), DriverInput(forward=1.0, turn=-1.0))


def test_line_tells_time_speed_steering_and_what_is_held() -> None:
    assert text(RIGHT) == '   12.3 s  speed  -3.46 m/s  steering  -7.3°  held ↑ →'


@pytest.mark.parametrize(
    ('pressed', 'held'),
    [(COAST, '-'), (FULL_BRAKE, 'brake'), (DriverInput(forward=-0.5, turn=0.1), '↓ ←')],
)
def test_held_keys_are_shown(pressed: DriverInput, held: str) -> None:
    assert text(Status(0.0, 0.0, 0.0, pressed)).endswith(f'held {held}')


def test_there_is_no_negative_zero_and_columns_stay() -> None:
    still = text(Status(0.0, -0.001, -0.0001))
    assert '-0' not in still
    assert still.index('held') == text(RIGHT).index('held')


def test_in_a_pipe_there_is_a_line_a_second(capsys: CaptureFixture[str]) -> None:
    line = StatusLine()
    assert line.is_due()
    for _ in range(5):
        line.show(RIGHT)
    line.close()
    assert not line.is_due()
    assert capsys.readouterr().out == text(RIGHT) + '\n'


def test_quiet_shows_nothing(capsys: CaptureFixture[str]) -> None:
    line = StatusLine(quiet=True)
    assert not line.is_due()
    line.show(RIGHT)
    line.close()
    assert capsys.readouterr().out == ''
