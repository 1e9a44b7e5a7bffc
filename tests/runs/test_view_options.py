"""Where the live page opens, and where it is offered."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from barc_sim.__main__ import parse
from barc_sim.runs.options import page_of

DESKTOP = {'DISPLAY': ':0'}


@pytest.mark.parametrize(
    ('argv', 'expected'),
    [
        ('teleop', 'web'),
        ('teleop --quiet', 'web'),
        ('teleop --view none', 'none'),
        ('acc', 'none'),
        ('acc --view web', 'web'),
    ],
)
def test_without_a_desktop_mode_and_option_decide_whether_the_page_opens(
    argv: str, expected: str
) -> None:
    mode, *words = argv.split()
    assert page_of(parse(mode, words)) == expected


@pytest.mark.parametrize(
    ('screen', 'terminal', 'argv', 'expected'),
    [
        (DESKTOP, True, '', 'offer'),
        ({'WAYLAND_DISPLAY': 'wayland-0'}, True, '', 'offer'),
        ({'DISPLAY': ''}, True, '', 'none'),
        (DESKTOP | {'SSH_CONNECTION': '10.0.0.1'}, True, '', 'none'),
        (DESKTOP | {'BARC_SIM_NO_BROWSER': '1'}, True, '', 'none'),
        (DESKTOP, False, '', 'none'),
        (DESKTOP, True, '--quiet', 'none'),
        (DESKTOP, True, '--realtime-factor max', 'none'),
    ],
)
def test_acc_offers_the_page_in_a_terminal_on_a_desktop(
    monkeypatch: pytest.MonkeyPatch,
    screen: dict[str, str],
    terminal: bool,
    argv: str,
    expected: str,
) -> None:
    for name in ('DISPLAY', 'WAYLAND_DISPLAY', 'SSH_CONNECTION', 'BARC_SIM_NO_BROWSER'):
        monkeypatch.delenv(name, raising=False)
    for name, value in screen.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr('sys.stdout', SimpleNamespace(isatty=lambda: terminal))
    assert page_of(parse('acc', argv.split())) == expected
