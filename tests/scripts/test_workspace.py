"""The package in a colcon workspace, built with the line that the pages give.

COLCON names the program: `pip install colcon-common-extensions`, in an environment of its own. ROS
is the one of the tests' environment.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import barc_sim
from barc_sim.cli.process import has_ros

ROOT = Path(barc_sim.__file__).parents[1]
PAGE = ROOT / 'docs' / 'how-to' / 'platforms.md'
COLCON = os.environ.get('COLCON') or shutil.which('colcon')
#: What is built, and what is installed with it.
FOLDERS = ('barc_sim', 'barc_interfaces', 'resource')
FILES = ('setup.py', 'setup.cfg', 'package.xml', 'pyproject.toml', 'README.md', 'LICENSE')

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
    pytest.mark.skipif(not has_ros(), reason='needs ROS'),
    pytest.mark.skipif(not COLCON, reason='colcon is not installed (COLCON names it)'),
]


@pytest.fixture
def workspace(tmp_path: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a workspace with a clone in `src/barc_sim`, and a ROS without the lab's messages."""
    assert ros_domain
    workspace = tmp_path / 'workspace'
    clone = workspace / 'src' / 'barc_sim'
    for name in FOLDERS:
        shutil.copytree(ROOT / name, clone / name, ignore=shutil.ignore_patterns('__pycache__'))
    for name in FILES:
        shutil.copy(ROOT / name, clone)

    packages = tmp_path / 'packages'
    packages.mkdir()
    for path in Path(sysconfig.get_paths()['purelib']).iterdir():
        if not path.name.startswith('barc'):
            (packages / path.name).symlink_to(path)

    programs = [str(Path(str(COLCON)).parent), str(Path(sys.executable).parent)]
    monkeypatch.setenv('PATH', os.pathsep.join([*programs, os.environ['PATH']]))
    monkeypatch.setenv('PYTHONPATH', str(packages))
    monkeypatch.setenv('CMAKE_PREFIX_PATH', os.environ['AMENT_PREFIX_PATH'])
    return workspace


def run(workspace: Path, line: str) -> subprocess.CompletedProcess[str]:
    """Run a line of a shell in a workspace."""
    return subprocess.run(
        ['bash', '-c', line],  # noqa: S607
        cwd=workspace,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=240,
    )


def line_of_page() -> str:
    """Return the page's line that builds the workspace."""
    (line,) = re.findall('^colcon build .*', PAGE.read_text(encoding='utf-8'), re.MULTILINE)
    return str(line)


ACC = (
    '. install/setup.bash && install/barc_sim/lib/barc_sim/acc --realtime-factor max --distance 20'
)


def test_the_line_of_the_page_builds_package_and_messages(workspace: Path) -> None:
    assert run(workspace, line_of_page()).returncode == 0
    process = run(workspace, ACC)
    assert process.returncode == 0, process.stdout
    assert 'ROS 2 (rclpy)' in process.stdout


def test_a_plain_build_lacks_the_messages_and_the_error_has_the_line(workspace: Path) -> None:
    assert run(workspace, 'colcon build').returncode == 0
    process = run(workspace, ACC)
    assert process.returncode == 2, process.stdout
    assert line_of_page() in process.stdout
