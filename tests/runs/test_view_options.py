"""The options of the live page."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from barc_sim.cli.parser import Parser
from barc_sim.runs.options import (
    add_view_options,
    opens_page,
    wants_page,
)

if TYPE_CHECKING:
    from argparse import Namespace


def parse(*argv: str, auto: str = 'web') -> Namespace:
    parser = Parser(prog='prog')
    add_view_options(parser, auto=auto)
    return parser.parse_args(argv)


@pytest.mark.parametrize(
    ('argv', 'auto', 'expected'),
    [
        ([], 'web', True),
        ([], 'none', False),
        (['--view', 'auto'], 'web', True),
        (['--view', 'web'], 'none', True),
        (['--view', 'none'], 'web', False),
    ],
)
def test_auto_depends_on_the_mode(argv: list[str], auto: str, expected: bool) -> None:
    assert wants_page(parse(*argv, auto=auto)) is expected


@pytest.mark.parametrize(
    ('screen', 'terminal', 'given', 'expected'),
    [
        ({'DISPLAY': ':0'}, True, {}, True),
        ({'WAYLAND_DISPLAY': 'wayland-0'}, True, {}, True),
        ({}, True, {}, False),
        ({'DISPLAY': ':0', 'SSH_CONNECTION': '10.0.0.1'}, True, {}, False),
        ({'DISPLAY': ':0'}, False, {}, False),
        ({'DISPLAY': ':0'}, True, {'quiet': True}, False),
        ({'DISPLAY': ':0'}, True, {'realtime_factor': 0.0}, False),
    ],
)
def test_a_page_is_offered_at_a_desktop_and_does_not_open_itself(
    monkeypatch: pytest.MonkeyPatch,
    screen: dict[str, str],
    terminal: bool,
    given: dict[str, object],
    expected: bool,
) -> None:
    for name in ('DISPLAY', 'WAYLAND_DISPLAY', 'SSH_CONNECTION', 'BARC_SIM_NO_BROWSER'):
        monkeypatch.delenv(name, raising=False)
    for name, value in screen.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr('sys.stdout', SimpleNamespace(isatty=lambda: terminal))
    options = parse(auto='offer')
    vars(options).update({'quiet': False, 'realtime_factor': None} | given)
    assert wants_page(options) is expected
    assert not opens_page(options)
