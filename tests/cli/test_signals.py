"""Signals as a request to stop: each in a process of its own."""

from __future__ import annotations

import signal
import subprocess
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

    Start = Callable[..., subprocess.Popen[str]]
    Ready = Callable[[str], subprocess.Popen[str]]

PRELUDE = """
import os, signal, sys, threading, time
from barc_sim.cli import process as signals
from barc_sim.cli.process import StopSignals
def ready():
    print('ready', flush=True)
"""
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture
def ready(start: Start) -> Ready:
    """Return a function that starts a script, and waits until it prints `ready`."""

    def ready(script: str) -> subprocess.Popen[str]:
        process = start('-uc', PRELUDE + script, stdin=subprocess.PIPE)
        assert line(process) == 'ready\n'
        return process

    return ready


def line(process: subprocess.Popen[str]) -> str:
    assert process.stdout
    return process.stdout.readline()


def end(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Return exit code, the rest of the output, and stderr."""
    out, err = process.communicate(timeout=20)
    return process.returncode, out, err


@pytest.mark.parametrize('number', SIGNALS)
def test_signal_asks_to_stop_while_the_main_thread_is_busy_elsewhere(
    ready: Ready, number: signal.Signals
) -> None:
    # A join holds the main thread back from running a handler of its own.
    process = ready("""
with StopSignals() as stop:
    asked = threading.Lock()
    asked.acquire()
    stop.then(asked.release)
    ready()
    asked.acquire()
    print(stop.requested.is_set())
""")
    process.send_signal(number)
    assert end(process) == (0, 'True\n', '')


def test_callback_that_comes_after_the_signal_is_called_at_once(ready: Ready) -> None:
    process = ready("""
with StopSignals() as stop:
    ready()
    stop.requested.wait()
    stop.then(lambda: print('stopped'))
""")
    process.send_signal(signal.SIGINT)
    assert end(process) == (0, 'stopped\n', '')


@pytest.mark.parametrize('number', SIGNALS)
def test_signal_that_was_blocked_from_the_start_is_handled(
    ready: Ready, number: signal.Signals
) -> None:
    process = ready(f"""
held = {list(map(int, SIGNALS))}
signal.pthread_sigmask(signal.SIG_BLOCK, held)
os.kill(os.getpid(), {int(number)})
with StopSignals() as stop:
    stop.requested.wait()
    ready()
    sys.stdin.read()
    print('asked')
""")
    assert end(process) == (0, 'asked\n', '')


@pytest.mark.parametrize('number', SIGNALS)
def test_second_signal_ends_a_process_that_hangs(ready: Ready, number: signal.Signals) -> None:
    process = ready("""
signals._ECHO = 0.0
with StopSignals() as stop:
    stop.then(lambda: os.write(1, b'asked\\n'))
    ready()
    threading.Event().wait()
""")
    process.send_signal(number)
    assert line(process) == 'asked\n'
    process.send_signal(number)
    assert end(process) == (128 + number, '', '')


def test_echo_of_a_signal_does_not_cut_the_end_short(ready: Ready) -> None:
    process = ready("""
signals._ECHO = 3600.0
with StopSignals() as stop:
    stop.then(lambda: os.write(1, b'asked\\n'))
    ready()
    stop.requested.wait()
    sys.stdin.read()
    print('closed')
""")
    process.send_signal(signal.SIGTERM)
    assert line(process) == 'asked\n'
    process.send_signal(signal.SIGTERM)
    process.send_signal(signal.SIGINT)
    assert end(process) == (0, 'closed\n', '')


@pytest.mark.parametrize('number', SIGNALS)
def test_signal_after_the_exit_is_ignored(ready: Ready, number: signal.Signals) -> None:
    process = ready("""
with StopSignals():
    pass
ready()
sys.stdin.read()
print('ended in order')
""")
    process.send_signal(number)
    assert end(process) == (0, 'ended in order\n', '')


def test_hang_up_that_nohup_ignores_stays_ignored(ready: Ready) -> None:
    process = ready("""
signal.signal(signal.SIGHUP, signal.SIG_IGN)
with StopSignals() as stop:
    ready()
    stop.then(lambda: os.write(1, b'asked\\n'))
    stop.requested.wait()
""")
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGTERM)
    assert end(process) == (0, 'asked\n', '')
