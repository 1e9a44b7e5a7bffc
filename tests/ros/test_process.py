"""Nodes in processes of their own, and Fast DDS's use of memory there."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest
import rclpy
from command_line import barc

import barc_sim
from barc_sim.errors import UserError
from barc_sim.ros.process import (
    _PROFILES,
    PLAYER_PROFILES,
    check_ports,
    has_shared_memory,
    ros,
    sweep,
    use_profiles,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    Start = Callable[..., subprocess.Popen[str]]

ROOT = Path(barc_sim.__file__).parents[1]
PROGRAMS = Path(__file__).with_name('programs')
pytestmark = pytest.mark.usefixtures('ros_domain')


def test_nodes_of_two_processes_find_each_other_and_end_in_order(start: Start) -> None:
    parameters = ['--ros-args', '-p', 'realtime_factor:=0.0', '-p', 'distance:=3.0']
    controller, simulator = (
        start('-m', 'barc_sim', 'node', *words)
        for words in (['controller'], ['vehicle_simulator', *parameters])
    )
    out, err = simulator.communicate(timeout=200)
    assert (simulator.returncode, out) == (0, '')
    assert 'Traceback' not in err

    controller.send_signal(signal.SIGTERM)
    assert controller.communicate(timeout=200) == ('', '')
    assert controller.returncode == 0


def test_bad_parameter_is_one_line_and_exit_code_2() -> None:
    process = barc('node', 'controller', '--ros-args', '-p', 'kp:=high')
    assert (process.returncode, process.stdout) == (2, '')
    (line,) = process.stderr.splitlines()
    assert line.startswith('controller: error: parameter kp')


# ROS's start


def test_the_error_of_a_bad_argument_is_one_sentence(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(UserError) as refusal, ros(['--ros-args', '-p']):
        pass
    assert str(refusal.value).endswith('No parameter override rule found.')
    assert capfd.readouterr() == ('', '')
    with ros(None):  # nothing of it stays
        assert rclpy.ok()
    assert not rclpy.ok()


def test_the_users_log_level_stays() -> None:
    # In a process of its own: the levels outlive the context.
    script = (
        'from barc_sim.ros.process import ros\n'
        'from rclpy.logging import get_logger_effective_level\n'
        "with ros(['--ros-args', '--log-level', 'rcl:=debug']):\n"
        "    print(get_logger_effective_level('rcl').name)"
    )
    command = [sys.executable, '-c', script]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)

    assert told.stdout == 'DEBUG\n'


@pytest.mark.parametrize(('given', 'expected'), [(None, 'LOCALHOST'), ('SUBNET', 'SUBNET')])
def test_a_run_is_discovered_on_this_machine_alone_unless_set_otherwise(
    monkeypatch: pytest.MonkeyPatch, given: str | None, expected: str
) -> None:
    # Set first, so that it is restored afterwards, whatever the code sets.
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', given or '')
    if given is None:
        del os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE']
    with ros([]):
        assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == expected


@pytest.mark.parametrize(
    ('name', 'value', 'expected'),
    [
        ('ROS_DOMAIN_ID', '233', 'choose one from 0 to 232'),
        ('ROS_DOMAIN_ID', 'abc', 'ROS_DOMAIN_ID is not an integral number'),
        ('HOME', '', 'set HOME, or ROS_LOG_DIR to a folder'),
    ],
)
def test_an_error_names_the_setting_that_ros_cannot_use(
    name: str, value: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv('ROS_LOG_DIR', raising=False)
    monkeypatch.setenv(name, value)
    with pytest.raises(UserError, match=re.escape(expected)), ros([]):
        pass
    assert not rclpy.ok()


# Fast DDS

NAME = 'fastrtps_0123456789abcdef'


def test_our_profiles_are_set_where_the_user_has_none() -> None:
    environment: dict[str, str] = {}
    use_profiles(environment)
    assert environment.pop('RMW_FASTRTPS_USE_QOS_FROM_XML') == '1'

    (path,) = environment.values()
    policies = ET.fromstring(Path(path).read_text(encoding='utf-8')).iter()
    assert [element.text for element in policies if 'MemoryPolicy' in element.tag] == [
        'DYNAMIC',
        'DYNAMIC',
    ]


def test_a_players_profile_has_a_short_heartbeat() -> None:
    environment: dict[str, str] = {}
    for profiles in (_PROFILES, PLAYER_PROFILES):  # as in a process that a run has started
        use_profiles(environment, profiles)
    root = ET.parse(environment['FASTRTPS_DEFAULT_PROFILES_FILE']).getroot()
    (period,) = (each for each in root.iter() if each.tag.endswith('heartbeatPeriod'))
    assert [float(each.text or 0.0) for each in period] == [0.0, 5e7]


def test_the_users_profiles_stay() -> None:
    for name in ('FASTDDS_DEFAULT_PROFILES_FILE', 'RMW_FASTRTPS_USE_QOS_FROM_XML'):
        environment = {name: '0'}
        use_profiles(environment)
        assert environment == {name: '0'}


@pytest.fixture
def segment(tmp_path: Path) -> Path:
    """Return a segment with its lock beside it."""
    for name in (NAME, f'{NAME}_el'):
        (tmp_path / name).write_bytes(b'')
    return tmp_path / NAME


def test_an_old_segment_without_a_process_is_removed_and_nothing_else(segment: Path) -> None:
    lock = segment.with_name(f'{NAME}_el')
    others = {segment.with_name(name) for name in ('fastrtps_port7411', 'fastrtps_port7411_el')}
    for path in others:
        path.write_bytes(b'')
    with lock.open('rb') as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert sweep(segment.parent, min_age=-1.0) == 0

    assert sweep(segment.parent) == 0
    assert {*segment.parent.iterdir()} == {segment, lock, *others}
    assert sweep(segment.parent, min_age=-1.0) == 1
    assert {*segment.parent.iterdir()} == others
    assert sweep(segment.with_name('none')) == 0


@pytest.mark.parametrize('make', [os.mkfifo, lambda path: Path(path).symlink_to('/dev/zero')])
def test_a_file_that_is_no_lock_is_neither_opened_nor_removed(
    tmp_path: Path, make: Callable[[Path], None]
) -> None:
    path = tmp_path / 'fastrtps_0123456789abcdef_el'
    make(path)
    assert sweep(tmp_path, min_age=-1.0) == 0
    assert path.is_symlink() or path.exists()


@pytest.mark.parametrize('name', ['fastrtps_port{}_el', 'sem.fastrtps_port{}_mutex'])
def test_an_error_names_the_port_that_fast_dds_would_wait_for(tmp_path: Path, name: str) -> None:
    path = tmp_path / name.format(7400 + 250 * 7 + 11)
    path.touch()
    check_ports(7, tmp_path)
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(UserError, match=f'{path.name}.*is not a regular file.*remove it, or'):
        check_ports(7, tmp_path)

    for domain in (6, 8):
        check_ports(domain, tmp_path)


#: Runs the rest in a place of its own, where /dev/shm cannot be written.
READ_ONLY = (
    *('unshare', '--map-root-user', '--mount', '/bin/sh', '-c'),
    *('mount -t tmpfs -o ro none /dev/shm && exec "$0" "$@"',),
)


@pytest.mark.skipif(
    not shutil.which('unshare')
    or bool(subprocess.run([*READ_ONLY, 'true'], check=False).returncode),
    reason='needs unshare, and the right to mount',
)
def test_nodes_find_each_other_without_shared_memory_and_print_nothing(
    start: Start, tmp_path: Path
) -> None:
    drive = ('-m', 'barc_sim', 'acc', '-q', '--distance', '3', '--realtime-factor', 'max')
    process = start(*drive, '--no-controller', before=READ_ONLY)
    controller = start('-m', 'barc_sim', 'node', 'controller', before=READ_ONLY)
    out, err = process.communicate()
    # On a busy machine the controller can be late.
    others = [line for line in err.splitlines() if 'has not answered its reset' not in line]
    assert (process.returncode, others) == (0, [])
    assert (tmp_path / out.strip()).is_dir()

    controller.send_signal(signal.SIGTERM)
    assert controller.communicate() == ('', '')


def test_shared_memory_is_used_where_it_can_be_written(tmp_path: Path) -> None:
    assert has_shared_memory(tmp_path)
    assert not has_shared_memory(tmp_path / 'none')


def test_a_message_outlives_its_publisher_and_shares_no_file() -> None:
    """Data of a fixed size that is shared is gone with its publisher, and leaves a file."""
    process = subprocess.run(
        [sys.executable, PROGRAMS / 'last_message.py'],
        capture_output=True,
        text=True,
        check=True,
        timeout=200,
    )

    assert process.stdout == '[std_msgs.msg.Float64(data=5.0)] []\n'
