"""A browser opens on a desktop only."""

from __future__ import annotations

import webbrowser
from threading import Event

import pytest

from barc_sim.page.server import open_page


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
def test_page_opens_on_a_screen_that_is_not_reached_over_ssh(
    environment: dict[str, str], expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    called = Event()
    monkeypatch.setattr(webbrowser, 'open', lambda url: (opened.append(url), called.set()))
    assert open_page('http://127.0.0.1:1/', environment) is expected
    assert called.wait(10.0 if expected else 0.0) is expected
    assert opened == ['http://127.0.0.1:1/'] * expected
