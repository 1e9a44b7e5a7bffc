"""The start of `barc`: Ctrl-C before a command begins, and a ROS that it cannot use."""

from __future__ import annotations

import os
import signal
import sysconfig
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from command_line import ENVIRONMENT, call, printed, refused

from barc_sim.cli.process import has_ros

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable

PROGRAMS = Path(__file__).with_name('programs')
WITH_ROS = (
    *('acc', 'teleop', 'topics', 'echo z_vhcl', 'param list', 'graph', 'node relay', 'record'),
    'play bag',
)


@pytest.mark.parametrize('program', ['barc_sim', 'barc_sim.run'])
@pytest.mark.parametrize('module', ['argparse', 'barc_sim.cli.parser', 'barc_sim.commands.bags'])
def test_ctrl_c_ends_the_imports_without_a_traceback(
    start: Callable[..., subprocess.Popen[str]], program: str, module: str
) -> None:
    words = (PROGRAMS / 'interrupt_at_import.py', program, module)
    process = start(*words, env=os.environ | ENVIRONMENT)
    assert process.communicate() == ('', '')
    assert process.returncode == -signal.SIGINT


def test_ctrl_c_that_came_before_python_ends_it_without_a_traceback(
    start: Callable[..., subprocess.Popen[str]],
) -> None:
    process = start(PROGRAMS / 'interrupted_before.py', env=os.environ | ENVIRONMENT)
    assert process.communicate() == ('', '')
    assert process.returncode == -signal.SIGINT


@pytest.mark.skipif(not has_ros(), reason='needs ROS')
@pytest.mark.parametrize('words', WITH_ROS)
def test_a_middleware_that_is_not_installed_is_named(
    words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_other_cpp')
    line = refused(*words.split())
    assert "RMW_IMPLEMENTATION is 'rmw_other_cpp', which is not installed in this ROS" in line


def test_a_command_without_ros_works_with_any_middleware(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_other_cpp')
    assert 'float64 motor' in printed('show', 'ECU')


@pytest.mark.skipif(
    not Path(sysconfig.get_path('platlib'), 'rclpy').exists(), reason='needs a ROS of its own'
)
def test_another_ros_on_pythonpath_is_named(tmp_path: Path) -> None:
    """As where Humble is sourced: its rclpy cannot be imported by this Python."""
    humble = tmp_path / 'humble'
    package = humble / 'rclpy'
    package.mkdir(parents=True)
    (package / '__init__.py').write_text('raise ImportError("the C extension is not present")\n')
    path = os.pathsep.join([str(humble), ENVIRONMENT['PYTHONPATH']])

    for words in (('topics',), ('acc', '-q')):
        process = call(*words, env=os.environ | {'PYTHONPATH': path}, cwd=tmp_path)
        (line,) = process.stderr.splitlines()
        assert process.returncode == 2
        assert f'PYTHONPATH puts the rclpy in {str(humble)!r} before that in ' in line
