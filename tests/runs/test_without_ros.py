"""A run where nothing of ROS can be imported, nor what only Linux has."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from elsewhere import ELSEWHERE
from page_client import connect_page, wait

import barc_sim
from barc_sim import read_bag

if TYPE_CHECKING:
    from collections.abc import Callable


ROOT = Path(barc_sim.__file__).parents[1]
PATIENCE = 100.0  #: [s]


def barc(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run `barc` in a Python that lacks ROS, and what only Linux has."""
    return python(folder, '-m', 'barc_sim', *words)


def python(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    tests = os.pathsep.join([ELSEWHERE['PYTHONPATH'], str(ROOT / 'tests')])
    return subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env=os.environ | ELSEWHERE | {'PYTHONPATH': tests},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        encoding='utf-8',
        check=False,
        timeout=200,
    )


def test_acc_drives_and_its_bag_is_read_by_the_other_commands(tmp_path: Path) -> None:
    folder = tmp_path / 'with a space'
    folder.mkdir()
    process = barc(folder, 'acc', '--realtime-factor', 'max', '--distance', '40')
    assert process.returncode == 0, process.stderr
    assert process.stdout.splitlines()[0] == 'engine     local, without ROS'

    (bag,) = (folder / 'bags').iterdir()
    metadata = yaml.safe_load((bag / 'metadata.yaml').read_text(encoding='utf-8'))
    information = metadata['rosbag2_bagfile_information']
    assert information['custom_data']['engine'] == 'local, without ROS'

    process = barc(folder, 'graph', '--bag', str(bag))
    assert process.returncode == 0, process.stderr


#: Prints a line of JSON for each of the command lines: exit code, output and error.
REFUSE = """
import json, sys
from command_line import barc
for words in json.loads(sys.argv[1]):
    done = barc(*words)
    print(json.dumps([done.returncode, done.stdout, done.stderr]))
"""


def test_a_command_that_needs_ros_is_refused_in_one_sentence_and_leaves_no_bag(
    tmp_path: Path,
) -> None:
    wrong = 'acc -q --ros-args -p '
    lines = {
        'acc --no-controller': '--no-controller',
        'acc --engine ros': '--engine ros',
        'record': 'barc record',
        'topics': 'barc topics',
        'echo /z_vhcl': 'barc echo',
        'param list': 'barc param',
        'node keyboard': 'barc node',
        f'{wrong}controller:kp:=30': 'parameter kp of controller must be of type float, such as',
        f'{wrong}kp:=-2e6': 'parameter kp of controller: -2e+06 is not a number from',
        f'{wrong}kp': "Couldn't parse -p 'kp': expected NAME:=VALUE",
        f'{wrong}kp:=[1': "Couldn't parse -p 'kp:=[1': it is not YAML",
        f'{wrong}use_sim_time:=true': 'use_sim_time needs ROS 2',
        'acc -q --ros-args -r __ns:=/1car': "Invalid name '1car': expected letters",
    }
    words = json.dumps([line.split() for line in lines])
    answers = python(tmp_path, '-c', REFUSE, words).stdout.splitlines()
    for cause, answer in zip(lines.values(), answers, strict=True):
        code, out, error = json.loads(answer)
        assert (code, out, error.count('\n')) == (2, '', 1)
        if cause.startswith(('--', 'barc')):
            assert f'{cause} needs ROS 2: ' in error
            assert 'ros-jazzy-ros-base' in error
        assert cause in error

    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def begin(
    start: Callable[..., subprocess.Popen[str]],
) -> Callable[..., tuple[subprocess.Popen[str], str]]:
    """Return a function that starts a run without ROS, and returns it with its page's address."""

    def begin(*words: str) -> tuple[subprocess.Popen[str], str]:
        local = ('--engine', 'local', '--view', 'web')
        process = start('-m', 'barc_sim', *words, *local, env=os.environ | ELSEWHERE)
        assert process.stdout
        assert process.stdout.readline() == 'engine     local, without ROS\n'
        return process, process.stdout.readline().split()[-1]

    return begin


def test_the_page_drives_by_hand_without_ros(begin: Callable[..., Any], tmp_path: Path) -> None:
    process, url = begin('teleop')
    with connect_page(url) as socket:
        wait(socket, 'hello')

        def is_fast(message: dict[str, Any]) -> bool:
            socket.send(json.dumps({'type': 'drive', 'forward': 1.0, 'turn': 0.0, 'brake': 0.0}))
            return bool(message.get('speed', 0.0) > 1.0)

        wait(socket, is_fast)
        socket.send(json.dumps({'type': 'reset'}))
        # A relay that answers its reset late may still drive the car away after this state.
        wait(socket, lambda m: m.get('x') == 0.0 and m.get('speed') == 0.0)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    log = read_bag(next((tmp_path / 'bags').iterdir()))
    assert log.speed.max() > 1.0
