"""The live page of a run without ROS drives, tunes, pauses and resets."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import pytest
from browser import CHROMIUM, Browser, wait_until
from elsewhere import ELSEWHERE
from page_client import connect_page, rows
from rosbags.highlevel import AnyReader

from barc_sim import read_bag

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from websockets.sync.client import ClientConnection

PATIENCE = 30.0  #: [s]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., tuple[subprocess.Popen[str], str]]]:
    """Return a function that starts a run without ROS, and returns it with its page's address."""
    processes = []

    def start(*words: str) -> tuple[subprocess.Popen[str], str]:
        process = subprocess.Popen(
            [sys.executable, '-m', 'barc_sim', *words, '--engine', 'local', '--view', 'web'],
            cwd=tmp_path,
            env=os.environ | ELSEWHERE,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        assert process.stdout
        assert process.stdout.readline() == 'engine     local, without ROS\n'
        return process, process.stdout.readline().split()[-1]

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def wait(connection: ClientConnection, what: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Return the first message, or row of a state, for which `what` is true."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        message = connection.recv(timeout=PATIENCE)
        found = [json.loads(message)] if isinstance(message, str) else [*rows(message)]
        for each in found:
            if what(each):
                return each
    raise AssertionError('it did not come')


def test_page_drives_by_hand(start: Callable[..., Any], tmp_path: Path) -> None:
    process, url = start('teleop')
    with connect_page(url) as socket:
        wait(socket, lambda m: m.get('type') == 'hello')
        until = time.monotonic() + 1.0
        while time.monotonic() < until:
            socket.send(json.dumps({'type': 'drive', 'linear': 1.0, 'angular': 0.0}))
            time.sleep(0.1)
        wait(socket, lambda m: m.get('speed', 0.0) > 1.0)
        socket.send(json.dumps({'type': 'reset'}))
        wait(socket, lambda m: m.get('x') == 0.0 and m.get('t', 0.0) > 0.5)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    log = read_bag(next((tmp_path / 'bags').iterdir()))
    assert log.speed.max() > 1.0


def test_page_tunes_and_pauses(start: Callable[..., Any], tmp_path: Path) -> None:
    process, url = start('acc', '--laps', '0')
    with connect_page(url) as socket:
        wait(socket, lambda m: m.get('tuning', {}).get('kp') == 30.0)
        socket.send(json.dumps({'type': 'tune', 'name': 'kp', 'value': 20.0}))
        wait(socket, lambda m: m.get('tuning', {}).get('kp') == 20.0)
        socket.send(json.dumps({'type': 'tune', 'name': 'kp', 'value': -2e6}))
        refused = wait(socket, lambda m: m.get('type') == 'refused')
        assert 'kp of controller must lie between' in refused['why']
        socket.send(json.dumps({'type': 'tune', 'name': 'motor_delay', 'value': 0.3}))
        wait(socket, lambda m: m.get('tuning', {}).get('motor_delay') == 0.3)
        socket.send(json.dumps({'type': 'pause', 'on': True}))
        wait(socket, lambda m: bool(m.get('paused')))
        process.send_signal(signal.SIGINT)
        end = wait(socket, lambda m: m.get('type') == 'end')
        assert end['reason'] == 'The run has ended.'
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    with AnyReader([next((tmp_path / 'bags').iterdir())]) as reader:
        events = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic == '/parameter_events'
        ]
    changed = [
        (event.node, parameter.name, parameter.value.double_value)  # type: ignore[attr-defined]
        for event in events
        for parameter in event.changed_parameters  # type: ignore[attr-defined]
    ]
    assert changed == [('/controller', 'kp', 20.0), ('/vehicle_simulator', 'motor_delay', 0.3)]


@pytest.mark.slow
def test_more_half_open_connections_than_descriptors_end_no_run(
    start: Callable[..., Any], tmp_path: Path
) -> None:
    resource = pytest.importorskip('resource')
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    process, url = start('acc', '--laps', '0')
    resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (1024, 1024))
    where = urlsplit(url)
    with ExitStack() as stack:
        for _ in range(1100):
            half = stack.enter_context(socket.create_connection((where.hostname, where.port)))
            with suppress(OSError):  # closed already
                half.send(b'GET / HTTP/1.1\r\n')
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    assert 'Traceback' not in errors
    (bag,) = (tmp_path / 'bags').iterdir()
    assert (bag / 'metadata.yaml').exists()


@pytest.mark.skipif(not CHROMIUM, reason='there is no Chromium')
def test_browser_drives(start: Callable[..., Any], tmp_path: Path) -> None:
    process, url = start('teleop')
    with Browser() as browser:
        tab = browser.open(url)
        tab.until("document.querySelector('#time').textContent !== '\\u2013'")
        tab.press('ArrowUp')
        tab.press('ArrowLeft')
        wait_until(lambda: tab.number('#speed') > 3.0 and tab.number('#heading') > 10.0)
        tab.release('ArrowUp')
        tab.release('ArrowLeft')
        process.send_signal(signal.SIGINT)
        tab.until("document.querySelector('#state').innerText !== 'Live'")
        problems = tab.problems
        tab.close()
    process.communicate(timeout=PATIENCE)
    assert (process.returncode, problems) == (0, [])
    log = read_bag(next((tmp_path / 'bags').iterdir()))
    assert log.speed.max() > 3.0
