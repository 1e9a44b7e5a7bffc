"""Streams, arguments and signals: each ends in a sentence, or in order."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from command_line import ENVIRONMENT

from barc_sim.bags.reader import info
from barc_sim.cli.parser import call
from barc_sim.cli.process import has_ros
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable

    Start = Callable[..., subprocess.Popen[str]]
    Ready = Callable[[str], subprocess.Popen[str]]


LOCAL = ('acc', '--engine', 'local', '-q', '--distance', '5', '--realtime-factor', 'max')


def limited(
    *words: str | bytes, before: str = '', cwd: Path, **environment: str
) -> subprocess.CompletedProcess[bytes]:
    """Run `barc` from a shell that runs `before` first."""
    command = [sys.executable, '-m', 'barc_sim', *words]
    return subprocess.run(
        ['/bin/sh', '-c', f'{before}\nexec "$0" "$@"', *command],
        cwd=cwd,
        env=os.environ | ENVIRONMENT | environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
        timeout=120,
    )


def sentence(done: subprocess.CompletedProcess[bytes]) -> str:
    """Return the one line of an error that is the user's matter."""
    (line,) = done.stderr.decode().splitlines()
    assert done.returncode == 2
    assert ': error: ' in line
    return line


@pytest.mark.skipif(not has_ros(), reason='needs ROS')
def test_too_little_memory_for_ros_is_named(tmp_path: Path) -> None:
    done = limited('acc', '-q', '--no-bag', before='ulimit -v 600000', cwd=tmp_path)
    assert 'allows 585 MiB of memory, and ROS needs' in sentence(done)


#: Runs a command where rclpy is installed, and the lab's messages are not.
WITHOUT_MESSAGES = """
import sys
sys.modules['barc_interfaces'] = None
from barc_sim.__main__ import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.skipif(not has_ros(), reason='needs ROS')
@pytest.mark.parametrize('command', ['acc', 'teleop', 'acc --engine ros', 'node relay'])
def test_messages_that_are_not_built_are_named_with_the_line_that_builds_them(
    command: str, tmp_path: Path
) -> None:
    done = subprocess.run(
        [sys.executable, '-c', WITHOUT_MESSAGES, *command.split()],
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
        timeout=120,
    )

    assert 'colcon build --base-paths src src/barc_sim/barc_interfaces' in sentence(done)
    assert not [*tmp_path.iterdir()]


def test_a_run_needs_no_standard_streams(tmp_path: Path) -> None:
    done = limited(*LOCAL, before='exec <&- >&- 2>&-', cwd=tmp_path)
    assert done.returncode == 0
    assert [*(tmp_path / 'bags').iterdir()]


def test_an_argument_that_is_not_text_is_refused(tmp_path: Path) -> None:
    assert 'is not UTF-8' in sentence(limited('new', b'caf\xe9', cwd=tmp_path))
    assert not [*tmp_path.iterdir()]


#: A file of parameters that would have 1e8 of them.
ALIASES = 'a0: &a0 {x: 1}\n' + ''.join(
    f'a{k}: &a{k} {{{", ".join(f"b{i}: *a{k - 1}" for i in range(10))}}}\n' for k in range(1, 9)
)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('[' * 20_000, 'more than 50 lists or mappings are within one another'),
        (ALIASES, 'where aliases count in full'),
        ('[1]', 'no names with values'),
        ('5: 3', "'5' is not below ros__parameters"),
    ],
)
def test_a_file_without_parameters_is_refused(text: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / 'values.yaml').write_text(text)
    done = limited(*LOCAL, '--ros-args', '--params-file', 'values.yaml', cwd=tmp_path)
    assert reason in sentence(done)


def test_parameters_come_through_a_pipe_and_one_that_no_node_has_is_named(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    os.write(writing, b'/**: {ros__parameters: {kp: 3.0}}')
    os.close(writing)
    file, wrong = f'/dev/fd/{reading}', ('controller:kd:=0.2', 'controler:kp:=1.0', 'mas:=1.0')
    words = ('--ros-args', '--params-file', file, *(w for each in wrong for w in ('-p', each)))
    command = [sys.executable, '-m', 'barc_sim', *LOCAL, *words]
    done = subprocess.run(
        command, cwd=tmp_path, pass_fds=[reading], capture_output=True, text=True, check=True
    )
    os.close(reading)
    named = [line.split()[1:3] for line in done.stderr.splitlines()]
    assert named == [['-p', 'controler:kp'], ['-p', 'mas']]

    bag = info(Path(tmp_path, done.stdout.strip()))
    assert (bag['kp'], bag['kd']) == ('3.0', '0.2')


def failing(error: BaseException, cause: BaseException | None = None) -> int:
    def main() -> None:
        raise error from cause

    return call('barc acc', main)


@pytest.mark.parametrize(
    ('error', 'cause', 'expected'),
    [
        (MemoryError(), None, 'not enough memory'),
        (ValueError("Key backend: 'x' is not a valid value"), None, 'MPLBACKEND is '),
        (OSError(errno.EMFILE, 'Too many open files'), None, 'Too many open files'),
        (OSError(errno.EACCES, 'Permission denied', 'a/b'), None, "'a/b' cannot be used"),
        (UserError('its own'), MemoryError(), 'its own'),
    ],
)
def test_an_error_of_the_system_is_printed_as_one_sentence(
    error: BaseException,
    cause: BaseException | None,
    expected: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert failing(error, cause) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line


@pytest.mark.parametrize(
    ('option', 'name'),
    [('--road', 'pipe'), ('--model', 'zeros'), ('--ros-args --params-file', 'pipe')],
)
def test_a_pipe_or_device_in_place_of_a_file_ends_in_one_sentence(
    option: str, name: str, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'zeros').symlink_to('/dev/zero')
    assert name in sentence(limited(*LOCAL, *option.split(), name, cwd=tmp_path))


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
    out, err = process.communicate(timeout=200)
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


def test_hang_up_that_nohup_ignores_stays_ignored(ready: Ready) -> None:
    process = ready("""
signal.signal(signal.SIGHUP, signal.SIG_IGN)
with StopSignals() as stop:
    ready()
    written = threading.Event()
    stop.then(lambda: (os.write(1, b'asked\\n'), written.set()))
    written.wait()
""")
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGTERM)

    assert end(process) == (0, 'asked\n', '')
