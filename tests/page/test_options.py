"""Which live page is asked for, and where a browser opens."""

from __future__ import annotations

import webbrowser
from threading import Event

import pytest

from barc_sim.cli.parser import Parser
from barc_sim.page import options as view_options
from barc_sim.page.options import add_view_options, has_desktop, open_page, wanted


def parser(*, on: bool) -> Parser:
    parser = Parser(prog='prog')
    add_view_options(parser, on=on)
    return parser


@pytest.mark.parametrize(
    ('argv', 'on', 'expected'),
    [
        ([], True, True),
        ([], False, False),
        (['--view', 'auto'], True, True),
        (['--view', 'web'], False, True),
        (['--view', 'none'], True, False),
    ],
)
def test_auto_is_what_the_mode_says(argv: list[str], on: bool, expected: bool) -> None:
    assert wanted(parser(on=on).parse_args(argv)) is expected


def test_the_page_is_for_this_machine_unless_asked_otherwise() -> None:
    options = parser(on=True).parse_args([])
    assert (options.view_host, options.view_port) == ('127.0.0.1', 0)
    options = parser(on=True).parse_args(['--view-host', '192.168.1.5', '--view-port', '8080'])
    assert (options.view_host, options.view_port) == ('192.168.1.5', 8080)


@pytest.mark.parametrize('port', ['-1', '65536', '80.0', 'http', ''])
def test_a_port_that_is_none_is_named(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        parser(on=True).parse_args([f'--view-port={port}'])
    assert exit_.value.code == 2
    assert f'{port!r} is not a whole number from 0 to 65535' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('environment', 'expected'),
    [
        ({}, False),
        ({'DISPLAY': ''}, False),
        ({'DISPLAY': ':0'}, True),
        ({'WAYLAND_DISPLAY': 'wayland-0'}, True),
        ({'DISPLAY': 'localhost:10.0', 'SSH_CONNECTION': '::1 1 ::1 22'}, False),
    ],
)
def test_a_desktop_is_a_screen_that_is_not_reached_over_ssh(
    environment: dict[str, str], expected: bool
) -> None:
    assert has_desktop(environment) is expected


@pytest.mark.parametrize('desktop', [True, False])
def test_a_browser_opens_on_a_desktop_only(monkeypatch: pytest.MonkeyPatch, desktop: bool) -> None:
    opened: list[str] = []
    called = Event()
    monkeypatch.setattr(webbrowser, 'open', lambda url: (opened.append(url), called.set()))
    monkeypatch.setattr(view_options, 'has_desktop', lambda: desktop)
    assert open_page('http://127.0.0.1:1/') is desktop
    assert called.wait(10.0 if desktop else 0.0) is desktop
    assert opened == ['http://127.0.0.1:1/'] * desktop
