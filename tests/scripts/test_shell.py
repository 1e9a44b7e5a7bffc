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
SHELLS = ('bash', 'zsh', 'fish', 'dash')
HINT = 'ros2 is not installed: use barc echo TOPIC'
#: What is up to date is not set up: the environment is that of these tests.
NO_SET_UP = """
up_to_date() { :; }
bring_up_to_date() { die 'a test must not set anything up.'; }
"""
#: What would hide our Python, as conda's and pyenv's lines do.
START_UP = {
    '.bashrc': 'export MINE=own PATH=/usr/bin:/bin',
    '.zshrc': 'export MINE=own PATH=/usr/bin:/bin',
    '.zshenv': 'export PATH=/usr/bin:/bin',
    '.config/fish/config.fish': 'set -gx MINE own; set -gx PATH /usr/bin /bin',
    '.shrc': 'export MINE=own PATH=/usr/bin:/bin',
}

pytestmark = pytest.mark.skipif(
    'ROS_DISTRO' in os.environ or not (Path(sys.prefix) / 'share' / 'barc_interfaces').exists(),
    reason='only in an environment with the wheels of ROS',
)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a copy of the scripts beside a link to this environment."""
    checkout = tmp_path / 'checkout'
    shutil.copytree(ROOT / 'scripts', checkout / 'scripts')
    with (checkout / 'scripts' / 'setup.bash').open('a') as file:
        file.write(NO_SET_UP)
    for path in ROOT.iterdir():
        if path.name not in {'scripts', '.setup', '.venv'}:
            (checkout / path.name).symlink_to(path)
    (checkout / '.venv').symlink_to(sys.prefix)
    return checkout


@pytest.fixture
def environment(tmp_path: Path, checkout: Path) -> dict[str, str]:
    """Return the variables of a login, with a home whose start-up files set PATH."""
    for name, text in START_UP.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'{text}\n')
    return {
        'PATH': '/usr/bin:/bin',
        'HOME': str(tmp_path),
        'ENV': str(tmp_path / '.shrc'),
        'TERM': 'dumb',
        'CHECKOUT': str(checkout),
        'BARC_PYTHON': os.path.realpath(sys.executable),
    }


def run(
    environment: dict[str, str], *words: str, text: str = ''
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [f'{environment["CHECKOUT"]}/scripts/shell', *words],
        env=environment,
        input=text,
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )


class Session:
    """A shell in a terminal."""

    def __init__(self, environment: dict[str, str]) -> None:
        self.terminal, terminal_of_shell = pty.openpty()
        self.process = subprocess.Popen(
            [f'{environment["CHECKOUT"]}/scripts/shell'],
            env=environment,
            stdin=terminal_of_shell,
            stdout=terminal_of_shell,
            stderr=terminal_of_shell,
            start_new_session=True,
        )
        os.close(terminal_of_shell)
        self.seen = ''

    def until(self, text: str) -> str:
        """Return what has been printed since the last call, up to this text."""
        end = time.monotonic() + 100.0
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


def test_a_terminal_has_the_environment_and_a_hint_to_the_tools_of_ros(
    session: Session, checkout: Path
) -> None:
    assert HINT in session.until('source a ROS 2 Jazzy first.')

    session.until('(barc_sim) ')
    session.type('echo "<$MINE"-"$AMENT_PREFIX_PATH"-"$ROS_AUTOMATIC_DISCOVERY_RANGE>"')
    session.until(f'<own-{checkout}/.venv-LOCALHOST>')
    session.type('command -v python; echo found')
    session.until(f'{checkout}/.venv/bin/python')
    session.type('ros2 topic list')
    session.until(HINT)
    session.type('exit 3')
    assert session.process.wait(timeout=200) == 3


@pytest.mark.parametrize('shell', SHELLS)
def test_a_script_in_a_pipe_is_run(environment: dict[str, str], checkout: Path, shell: str) -> None:
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f'{shell} is not installed')

    process = run(environment | {'SHELL': program}, text='command -v python\nexit 4\n')
    assert (process.returncode, process.stdout, process.stderr) == (
        4,
        f'{checkout}/.venv/bin/python\n',
        '',
    )


@pytest.mark.parametrize('discovery', [None, 'SUBNET'])
def test_a_command_is_run_with_ros(
    environment: dict[str, str], checkout: Path, discovery: str | None
) -> None:
    script = (
        'import os, rclpy, sys\n'
        'from ament_index_python import get_package_share_directory as share\n'
        'print(share("barc_interfaces"), os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"], sys.argv)\n'
        'sys.exit(7)'
    )
    set_already = {'ROS_AUTOMATIC_DISCOVERY_RANGE': discovery} if discovery else {}
    process = run(environment | set_already, 'python', '-c', script, 'a b', '*')
    assert (process.returncode, process.stderr) == (7, '')

    share = f'{checkout}/.venv/share/barc_interfaces'
    assert process.stdout == f"{share} {discovery or 'LOCALHOST'} ['-c', 'a b', '*']\n"


@pytest.mark.parametrize(
    ('words', 'message'),
    [(('ros2', 'topic', 'list'), HINT), (('no-such-thing',), 'no-such-thing is not installed.')],
)
def test_a_missing_command_is_named(
    environment: dict[str, str], words: tuple[str, ...], message: str
) -> None:
    process = run(environment, *words)
    assert (process.returncode, process.stdout) == (1, '')
    assert process.stderr.startswith(f'barc_sim: {message}')
