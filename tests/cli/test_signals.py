"""Signals as a request to stop: each in a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import barc_sim

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(barc_sim.__file__).parents[1]
PRELUDE = """
import os, signal, sys, threading, time
from barc_sim.cli.signals import StopSignals
def ready():
    print('ready', flush=True)
"""
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


class Process:
    """A process that runs a script, and prints `ready` before the signal."""

    def __init__(self, script: str) -> None:
        self.popen = subprocess.Popen(
            [sys.executable, '-c', PRELUDE + script],
            cwd=ROOT,
            env=os.environ | {'PYTHONUNBUFFERED': '1'},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.line('ready')

    def line(self, expected: str) -> None:
        """Read the next line."""
        assert self.popen.stdout
        assert self.popen.stdout.readline() == f'{expected}\n'

    def end(self) -> tuple[int, str, str]:
        """Return exit code, the rest of the output, and stderr."""
        out, err = self.popen.communicate(timeout=20)
        return self.popen.returncode, out, err


@pytest.fixture
def processes() -> Iterator[list[Process]]:
    processes: list[Process] = []
    yield processes
    for process in processes:
        process.popen.kill()
        process.popen.communicate()


@pytest.mark.parametrize('number', SIGNALS)
def test_signal_asks_to_stop_while_the_main_thread_is_busy_elsewhere(
    processes: list[Process], number: signal.Signals
) -> None:
    # A join holds the main thread back from running a handler of its own.
    processes.append(
        Process("""
with StopSignals() as stop:
    asked = threading.Lock()
    asked.acquire()
    stop.then(asked.release)
    ready()
    asked.acquire()
    print(stop.requested.is_set())
""")
    )
    processes[0].popen.send_signal(number)
    assert processes[0].end() == (0, 'True\n', '')


def test_callback_that_comes_after_the_signal_is_called_at_once(processes: list[Process]) -> None:
    processes.append(
        Process("""
with StopSignals() as stop:
    ready()
    stop.requested.wait()
    stop.then(lambda: print('stopped'))
""")
    )
    processes[0].popen.send_signal(signal.SIGINT)
    assert processes[0].end() == (0, 'stopped\n', '')


@pytest.mark.parametrize('number', SIGNALS)
def test_signal_that_was_blocked_from_the_start_is_handled(
    processes: list[Process], number: signal.Signals
) -> None:
    processes.append(
        Process(f"""
held = {list(map(int, SIGNALS))}
signal.pthread_sigmask(signal.SIG_BLOCK, held)
os.kill(os.getpid(), {int(number)})
with StopSignals() as stop:
    stop.requested.wait()
    ready()
    sys.stdin.read()
    print('asked')
""")
    )
    assert processes[0].end() == (0, 'asked\n', '')


@pytest.mark.parametrize('number', SIGNALS)
def test_second_signal_ends_a_process_that_hangs(
    processes: list[Process], number: signal.Signals
) -> None:
    processes.append(
        Process("""
with StopSignals(echo=0.0) as stop:
    stop.then(lambda: os.write(1, b'asked\\n'))
    ready()
    threading.Event().wait()
""")
    )
    processes[0].popen.send_signal(number)
    processes[0].line('asked')
    processes[0].popen.send_signal(number)
    assert processes[0].end() == (128 + number, '', '')


def test_echo_of_a_signal_does_not_cut_the_end_short(processes: list[Process]) -> None:
    processes.append(
        Process("""
with StopSignals(echo=3600.0) as stop:
    stop.then(lambda: os.write(1, b'asked\\n'))
    ready()
    stop.requested.wait()
    sys.stdin.read()
    print('closed')
""")
    )
    processes[0].popen.send_signal(signal.SIGTERM)
    processes[0].line('asked')
    processes[0].popen.send_signal(signal.SIGTERM)
    processes[0].popen.send_signal(signal.SIGINT)
    assert processes[0].end() == (0, 'closed\n', '')


@pytest.mark.parametrize('number', SIGNALS)
def test_signal_after_the_exit_is_ignored(processes: list[Process], number: signal.Signals) -> None:
    processes.append(
        Process("""
with StopSignals():
    pass
ready()
sys.stdin.read()
print('ended in order')
""")
    )
    processes[0].popen.send_signal(number)
    assert processes[0].end() == (0, 'ended in order\n', '')


def test_hang_up_that_nohup_ignores_stays_ignored(processes: list[Process]) -> None:
    processes.append(
        Process("""
signal.signal(signal.SIGHUP, signal.SIG_IGN)
with StopSignals() as stop:
    ready()
    stop.then(lambda: os.write(1, b'asked\\n'))
    stop.requested.wait()
""")
    )
    processes[0].popen.send_signal(signal.SIGHUP)
    processes[0].popen.send_signal(signal.SIGTERM)
    assert processes[0].end() == (0, 'asked\n', '')
