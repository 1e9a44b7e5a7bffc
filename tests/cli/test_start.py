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

#: Interrupts itself when a module is imported first.
INTERRUPTED_AT = """
import os, runpy, signal, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
sys.argv = ['barc', 'info', '--help']
runpy.run_module({program!r}, run_name='__main__', alter_sys=True)
"""
#: Has been interrupted before Python could handle it.
BLOCKED = """
import os, signal, sys
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
os.kill(os.getpid(), signal.SIGINT)
from barc_sim.run import main
sys.exit(main(['info', '--help']))
"""
WITH_ROS = (
    *('acc', 'teleop', 'topics', 'echo z_vhcl', 'param list', 'graph', 'node relay', 'record'),
    'play bag',
)


@pytest.mark.parametrize('program', ['barc_sim', 'barc_sim.run'])
@pytest.mark.parametrize('module', ['argparse', 'barc_sim.cli.parser', 'barc_sim.commands.bags'])
def test_ctrl_c_ends_the_imports_without_a_traceback(
    start: Callable[..., subprocess.Popen[str]], program: str, module: str
) -> None:
    script = INTERRUPTED_AT.format(module=module, program=program)
    process = start('-c', script, env=os.environ | ENVIRONMENT)
    assert process.communicate() == ('', '')
    assert process.returncode == -signal.SIGINT


def test_ctrl_c_that_came_before_python_ends_it_without_a_traceback(
    start: Callable[..., subprocess.Popen[str]],
) -> None:
    process = start('-c', BLOCKED, env=os.environ | ENVIRONMENT)
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
        done = call(*words, env=os.environ | {'PYTHONPATH': path}, cwd=tmp_path)
        (line,) = done.stderr.splitlines()
        assert done.returncode == 2
        assert f'PYTHONPATH puts the rclpy in {str(humble)!r} before that in ' in line
