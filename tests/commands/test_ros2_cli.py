"""The stock `ros2` command against a run, where it is installed."""

from __future__ import annotations

import os
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
TOPICS = {
    '/ecu': 'ECU',
    '/z_vhcl': 'ZDynBkMdl',
    '/ez_vhcl': 'EZDynBkMdl',
    '/environment': 'Environment',
    '/pid_state': 'PidState',
}
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


def test_topics_are_listed_with_their_types() -> None:
    listed = ros2('topic', 'list', '-t').splitlines()
    assert {f'{topic} [barc_interfaces/msg/{kind}]' for topic, kind in TOPICS.items()} <= set(
        listed
    )


def test_topic_info_shows_our_nodes_and_their_quality_of_service() -> None:
    printed = ros2('topic', 'info', '-v', '/ecu')
    assert 'Node name: controller\n' in printed
    assert 'Node name: vehicle_simulator\n' in printed
    assert printed.count('Reliability: RELIABLE\n') == 2


def test_messages_are_echoed_as_by_our_command() -> None:
    theirs = next(yaml.safe_load_all(ros2('topic', 'echo', '--once', '/z_vhcl')))
    ours = next(yaml.safe_load_all(call('echo', '/z_vhcl', '--once').stdout))
    assert theirs.keys() == ours.keys()
    assert theirs['x'] < ours['x']


def test_rate_and_delay_are_measured() -> None:
    rate = float(until('average rate', 'topic', 'hz', '/z_vhcl').split()[-1])
    assert 5.0 < rate < 60.0  # 50 on a machine that keeps up
    assert float(until('average delay', 'topic', 'delay', '/z_vhcl').split()[-1]) > 0.0


def test_command_is_published() -> None:
    assert 'publishing #1' in ros2(
        'topic', 'pub', '--once', '/ecu', 'barc_interfaces/msg/ECU', '{motor: 1.0}'
    )


def test_node_info_shows_topics_and_services() -> None:
    printed = ros2('node', 'info', '/vehicle_simulator')
    assert '    /ecu: barc_interfaces/msg/ECU\n' in printed
    assert '    /vehicle_simulator/reset: std_srvs/srv/Trigger\n' in printed


def test_parameter_is_set_and_read() -> None:
    assert ros2('param', 'set', '/controller', 'kp', '20.0') == 'Set parameter successful\n'
    assert ros2('param', 'get', '/controller', 'kp') == 'Double value is: 20.0\n'


def test_dump_is_ours() -> None:
    dump = ros2('param', 'dump', '/controller', '--spin-time', '3')
    assert yaml.safe_load(dump) == yaml.safe_load(call('param', 'dump', '/controller').stdout)


def test_services_are_called() -> None:
    for service, kind, request in (
        ('pause', 'SetBool', '{data: true}'),
        ('pause', 'SetBool', '{data: false}'),
        ('reset', 'Trigger', '{}'),
    ):
        printed = ros2(
            'service', 'call', f'/vehicle_simulator/{service}', f'std_srvs/srv/{kind}', request
        )
        assert 'success=True' in printed


def test_package_is_found_and_its_commands_are_run() -> None:
    assert ros2('pkg', 'prefix', 'barc_sim').strip() in os.environ['AMENT_PREFIX_PATH'].split(':')
    assert ros2('run', 'barc_sim', 'acc', '--help').startswith('usage: barc acc ')
    assert ros2('run', 'barc_sim', 'plot', '--help').startswith('usage: barc plot ')
