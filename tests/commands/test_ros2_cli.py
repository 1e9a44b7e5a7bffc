"""The stock `ros2` command against a run, where it is installed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import time
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

import yaml
from command_line import call, started

if TYPE_CHECKING:
    from collections.abc import Iterator

NODES = ('/vehicle_simulator', '/controller')
ROS2 = shutil.which('ros2')
pytestmark = [
    pytest.mark.skipif(ROS2 is None, reason='ros2 is not on the PATH'),
    pytest.mark.usefixtures('run'),
    pytest.mark.slow,
]


@pytest.fixture
def run(ros_domain: int) -> Iterator[None]:
    """Drive for as long as the test needs it; end the daemon of its domain, too."""
    assert ros_domain
    with started('acc', '--distance', '0', '--no-bag') as process:
        assert process.stdout
        process.stdout.readline()  # names the engine
        process.stdout.readline()  # it drives
        ros2('daemon', 'start')  # which the calls below ask
        end = time.monotonic() + 40.0
        while not set(NODES) <= set(ros2('node', 'list').split()):  # the daemon sees it
            assert time.monotonic() < end
        yield
    subprocess.run([str(ROS2), 'daemon', 'stop'], capture_output=True, check=False, timeout=30)


def ros2(*words: str, seconds: float = 40.0) -> str:
    """Return the output of `ros2`, which must succeed."""
    done = subprocess.run(
        [str(ROS2), *words],
        env=os.environ | {'PYTHONUNBUFFERED': '1'},
        capture_output=True,
        text=True,
        check=False,
        timeout=seconds,
    )
    assert done.returncode == 0, done.stderr
    assert 'failed' not in done.stderr
    return done.stdout


def until(word: str, *words: str) -> str:
    """Return the line with `word` in it of a command that goes on for ever."""
    with subprocess.Popen(
        [str(ROS2), *words],
        env=os.environ | {'PYTHONUNBUFFERED': '1'},
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout
            return next(line for line in process.stdout if word in line)
        finally:
            process.kill()


@pytest.mark.parametrize(
    ('words', 'printed'),
    [
        ('topic list -t', '/pid_state [barc_interfaces/msg/PidState]\n'),
        ('topic info -v /ecu', 'Node name: vehicle_simulator\n'),
        ('topic pub --once /ecu barc_interfaces/msg/ECU {motor: 1.0}', 'publishing #1'),
        ('node info /vehicle_simulator', '    /vehicle_simulator/reset: std_srvs/srv/Trigger\n'),
        ('param set /controller kp 20.0', 'Set parameter successful\n'),
        ('param get /controller kp', 'Double value is: '),
        ('service call /vehicle_simulator/pause std_srvs/srv/SetBool {data: true}', 'success=True'),
        ('service call /vehicle_simulator/reset std_srvs/srv/Trigger {}', 'success=True'),
        ('run barc_sim plot --help', 'usage: barc plot '),
    ],
)
def test_ros2_knows_what_runs(words: str, printed: str) -> None:
    assert printed in ros2(*re.findall(r'\{.*\}|\S+', words))


def test_messages_and_parameters_are_printed_as_by_our_commands() -> None:
    theirs = next(yaml.safe_load_all(ros2('topic', 'echo', '--once', '/z_vhcl')))
    ours = next(yaml.safe_load_all(call('echo', '/z_vhcl', '--once').stdout))
    assert theirs.keys() == ours.keys()
    assert theirs['x'] < ours['x']
    dump = ros2('param', 'dump', '/controller', '--spin-time', '3')
    assert yaml.safe_load(dump) == yaml.safe_load(call('param', 'dump', '/controller').stdout)


def test_rate_and_delay_are_measured() -> None:
    rate = float(until('average rate', 'topic', 'hz', '/z_vhcl').split()[-1])
    assert 5.0 < rate < 60.0  # 50 on a machine that keeps up
    assert float(until('average delay', 'topic', 'delay', '/z_vhcl').split()[-1]) > 0.0
