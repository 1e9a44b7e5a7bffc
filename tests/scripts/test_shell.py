"""scripts/shell: the user's own shell with ROS in it, and commands."""

from __future__ import annotations

import os
import pty
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / 'scripts' / 'shell'
VENV = ROOT / '.venv'
SHELLS = ('bash', 'zsh', 'fish', 'dash')
HINT = 'ros2 is not installed: use python -m barc_sim echo TOPIC'
#: What would hide our Python, as conda's and pyenv's lines do.
START_UP = {
    '.bashrc': 'export MINE=own PATH=/usr/bin:/bin',
    '.zshrc': 'export MINE=own PATH=/usr/bin:/bin',
    '.zshenv': 'export PATH=/usr/bin:/bin',
    '.config/fish/config.fish': 'set -gx MINE own; set -gx PATH /usr/bin /bin',
    '.shrc': 'export MINE=own PATH=/usr/bin:/bin',
}

pytestmark = pytest.mark.skipif(
    Path(sys.prefix) != VENV or 'ROS_DISTRO' in os.environ,
    reason='only where ./scripts/test has set the checkout up, without a sourced ROS',
)


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Return what a login would have set, with a home whose start-up files set PATH."""
    for name, text in START_UP.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'{text}\n')
    return {
        'PATH': '/usr/bin:/bin',
        'HOME': str(tmp_path),
        'ENV': str(tmp_path / '.shrc'),
        'TERM': 'dumb',
        'BARC_PYTHON': os.path.realpath(sys.executable),
    }


def run(
    environment: dict[str, str], *words: str, text: str = ''
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(SCRIPT), *words],
        env=environment,
        input=text,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


class Session:
    """A shell in a terminal."""

    def __init__(self, environment: dict[str, str]) -> None:
        self.terminal, theirs = pty.openpty()
        self.process = subprocess.Popen(
            [str(SCRIPT)],
            env=environment,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            start_new_session=True,
        )
        os.close(theirs)
        self.seen = ''

    def until(self, text: str) -> str:
        """Return what has been printed since the last call, up to this text."""
        end = time.monotonic() + 40.0
        while text not in self.seen:
            assert time.monotonic() < end, self.seen
            if select.select([self.terminal], [], [], 0.2)[0]:
                self.seen += os.read(self.terminal, 4096).decode(errors='replace')
        before, _, self.seen = self.seen.partition(text)
        return before + text

    def type(self, line: str) -> None:
        """Press the keys of a line, and Enter."""
        os.write(self.terminal, f'{line}\r'.encode())


@pytest.fixture(params=SHELLS)
def session(environment: dict[str, str], request: pytest.FixtureRequest) -> Iterator[Session]:
    """Open each shell that is installed."""
    program = shutil.which(request.param)
    if program is None:
        pytest.skip(f'{request.param} is not installed')
    session = Session(environment | {'SHELL': program})
    yield session
    session.process.kill()
    session.process.wait()
    os.close(session.terminal)


def test_terminal_tells_what_is_there_and_has_it(session: Session) -> None:
    assert HINT in session.until('source a ROS 2 Jazzy first.')
    session.until('(barc_sim) ')
    session.type('echo "<$MINE"-"$AMENT_PREFIX_PATH"-"$ROS_AUTOMATIC_DISCOVERY_RANGE>"')
    session.until(f'<own-{VENV}-LOCALHOST>')
    session.type('command -v python; echo found')
    session.until(f'{VENV}/bin/python')
    session.type('ros2 topic list')
    session.until(HINT)
    session.type('exit 3')
    assert session.process.wait(timeout=20) == 3


@pytest.mark.parametrize('shell', SHELLS)
def test_pipe_is_read_as_a_script(environment: dict[str, str], shell: str) -> None:
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f'{shell} is not installed')
    done = run(environment | {'SHELL': program}, text='command -v python\nexit 4\n')
    assert (done.returncode, done.stdout, done.stderr) == (4, f'{VENV}/bin/python\n', '')


def test_command_is_run_with_ros(environment: dict[str, str]) -> None:
    script = (
        'import rclpy, sys\nfrom ament_index_python import get_package_share_directory as share\n'
        'print(share("barc_interfaces"), *sys.argv[1:])'
    )
    done = run(environment, 'python', '-c', script, 'a b', '*')
    assert (done.returncode, done.stderr) == (0, '')
    assert done.stdout == f'{VENV}/share/barc_interfaces a b *\n'


def test_exit_code_of_a_command_is_its_own(environment: dict[str, str]) -> None:
    assert run(environment, 'python', '-c', 'raise SystemExit(7)').returncode == 7


def test_range_of_discovery_that_is_set_stays(environment: dict[str, str]) -> None:
    chosen = environment | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
    assert run(chosen, 'printenv', 'ROS_AUTOMATIC_DISCOVERY_RANGE').stdout == 'SUBNET\n'


def test_missing_ros2_is_told_with_what_takes_its_place(environment: dict[str, str]) -> None:
    done = run(environment, 'ros2', 'topic', 'list')
    assert (done.returncode, done.stdout) == (1, '')
    assert done.stderr.startswith(f'barc_sim: {HINT}')


def test_missing_command_is_named(environment: dict[str, str]) -> None:
    done = run(environment, 'no-such-thing')
    assert (done.returncode, done.stderr) == (1, 'barc_sim: no-such-thing is not installed.\n')
