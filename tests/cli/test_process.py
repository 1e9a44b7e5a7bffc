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
    StartProgram = Callable[..., subprocess.Popen[str]]


PROGRAMS = Path(__file__).with_name('programs')
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


def sentence(process: subprocess.CompletedProcess[bytes]) -> str:
    """Return the one line of an error that is the user's matter."""
    (line,) = process.stderr.decode().splitlines()
    assert process.returncode == 2
    assert ': error: ' in line
    return line


@pytest.mark.skipif(not has_ros(), reason='needs ROS')
def test_too_little_memory_for_ros_is_named(tmp_path: Path) -> None:
    process = limited('acc', '-q', '--no-bag', before='ulimit -v 600000', cwd=tmp_path)
    assert 'allows 585 MiB of memory, and ROS needs' in sentence(process)


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
    process = subprocess.run(
        [sys.executable, '-c', WITHOUT_MESSAGES, *command.split()],
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
        timeout=120,
    )

    assert 'colcon build --base-paths src src/barc_sim/barc_interfaces' in sentence(process)
    assert not [*tmp_path.iterdir()]


def test_a_run_needs_no_standard_streams(tmp_path: Path) -> None:
    process = limited(*LOCAL, before='exec <&- >&- 2>&-', cwd=tmp_path)
    assert process.returncode == 0
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
    process = limited(*LOCAL, '--ros-args', '--params-file', 'values.yaml', cwd=tmp_path)
    assert reason in sentence(process)


def test_parameters_come_through_a_pipe_and_one_that_no_node_has_is_named(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    os.write(writing, b'/**: {ros__parameters: {kp: 3.0}}')
    os.close(writing)
    file, wrong = f'/dev/fd/{reading}', ('controller:kd:=0.2', 'controler:kp:=1.0', 'mas:=1.0')
    words = ('--ros-args', '--params-file', file, *(w for each in wrong for w in ('-p', each)))
    command = [sys.executable, '-m', 'barc_sim', *LOCAL, *words]
    process = subprocess.run(
        command, cwd=tmp_path, pass_fds=[reading], capture_output=True, text=True, check=True
    )
    os.close(reading)
    unused = [line.split()[1:3] for line in process.stderr.splitlines()]
    assert unused == [['-p', 'controler:kp'], ['-p', 'mas']]

    bag = info(Path(tmp_path, process.stdout.strip()))
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


SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture
def start_program(start: Start) -> StartProgram:
    """Return a function that starts a program, and waits until it prints `ready`."""

    def start_program(name: str, *words: str) -> subprocess.Popen[str]:
        process = start('-u', PROGRAMS / name, *words, stdin=subprocess.PIPE)
        assert line(process) == 'ready\n'
        return process

    return start_program


def line(process: subprocess.Popen[str]) -> str:
    assert process.stdout
    return process.stdout.readline()


def end(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Return exit code, the rest of the output, and stderr."""
    out, err = process.communicate(timeout=200)
    return process.returncode, out, err


@pytest.mark.parametrize('number', SIGNALS)
def test_signal_asks_to_stop_while_the_main_thread_is_busy_elsewhere(
    start_program: StartProgram, number: signal.Signals
) -> None:
    process = start_program('wait_in_main_thread.py')
    process.send_signal(number)

    assert end(process) == (0, 'True\n', '')


@pytest.mark.parametrize('number', SIGNALS)
def test_signal_that_was_blocked_from_the_start_is_handled(
    start_program: StartProgram, number: signal.Signals
) -> None:
    words = [str(int(each)) for each in (number, *SIGNALS)]
    process = start_program('start_with_blocked_signals.py', *words)
    assert end(process) == (0, 'asked\n', '')


@pytest.mark.parametrize('number', SIGNALS)
def test_second_signal_ends_a_process_that_hangs(
    start_program: StartProgram, number: signal.Signals
) -> None:
    process = start_program('hang.py')
    process.send_signal(number)
    assert line(process) == 'asked\n'

    process.send_signal(number)
    assert end(process) == (128 + number, '', '')


def test_echo_of_a_signal_does_not_cut_the_end_short(start_program: StartProgram) -> None:
    process = start_program('end_slowly.py')
    process.send_signal(signal.SIGTERM)
    assert line(process) == 'asked\n'

    process.send_signal(signal.SIGTERM)
    process.send_signal(signal.SIGINT)
    assert end(process) == (0, 'closed\n', '')


def test_hang_up_that_nohup_ignores_stays_ignored(start_program: StartProgram) -> None:
    process = start_program('ignore_hang_up.py')
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGTERM)

    assert end(process) == (0, 'asked\n', '')
