"""The record command, in a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

import mcap_doctor
from command_line import refused, started, wait_for
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Float64, UInt8MultiArray

from barc_sim.bags import reader as bag
from barc_sim.bags.contents import Contents
from barc_sim.bags.recovery import recover

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.context import Context

CLIENT = Path(__file__).parents[1] / 'ros' / 'programs' / 'rosbag2_client.py'
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def talker(ros: Context) -> Iterator[Node]:
    node = Node('talker', context=ros)
    yield node
    node.destroy_node()


def test_ctrl_c_ends_it_with_its_counts_and_a_whole_bag(talker: Node, tmp_path: Path) -> None:
    publisher = talker.create_publisher(Float64, 'value', LATCHED)
    words = ('--output', str(tmp_path / 'mine'), '--topics', 'value', '--custom-data', 'site=Oslo')
    with started('record', *words) as process:
        wait_for(lambda: publisher.get_subscription_count() == 1)
        for _ in range(5):
            publisher.publish(Float64())
        assert publisher.wait_for_all_acked(Duration(seconds=30))
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=200)
    assert process.returncode == 0
    assert out.splitlines() == [
        '        5 /value',
        'recorded 5 messages, lost 0',
        f'bag {tmp_path / "mine"}',
    ]
    mcap_doctor.check(tmp_path / 'mine' / 'mine_0.mcap')
    assert bag.info(tmp_path / 'mine')['lost_messages'] == '0'
    assert bag.info(tmp_path / 'mine')['site'] == 'Oslo'


def call(environment: dict[str, str], *names: str) -> list[str]:
    """Call services of the recorder as a client of `ros2 bag record`; return the responses."""
    done = subprocess.run(
        [sys.executable, str(CLIENT), 'rosbag2_recorder', *names],
        env=os.environ | environment,
        check=True,
        capture_output=True,
        text=True,
        timeout=200,
    )
    return done.stdout.splitlines()


@pytest.mark.slow  # the package of the types is built
@pytest.mark.timeout(900)
def test_clients_of_rosbag2_control_it(
    talker: Node, tmp_path: Path, rosbag2_interfaces: dict[str, str]
) -> None:
    def publish(value: float) -> None:
        publisher.publish(Float64(data=value))
        assert publisher.wait_for_all_acked(Duration(seconds=30))

    publisher = talker.create_publisher(Float64, 'value', LATCHED)
    bag = tmp_path / 'mine'
    words = ('--output', str(bag), '--topics', 'value', '--start-paused')
    environment = os.environ | rosbag2_interfaces
    with started('record', *words, env=environment) as process:
        wait_for(lambda: publisher.get_subscription_count() == 1)
        publish(1.0)
        responses = call(rosbag2_interfaces, 'is_paused', 'resume', 'is_paused')
        assert responses == ['is_paused paused=True', 'resume', 'is_paused paused=False']
        publish(2.0)
        responses = call(rosbag2_interfaces, 'split_bagfile', 'event')
        files = [f'{bag}/mine_0.mcap', f'{bag}/mine_1.mcap']
        assert responses == ['split_bagfile', f'/bag_recorder {" ".join(files)}']
        publish(3.0)
        assert call(rosbag2_interfaces, 'pause') == ['pause']
        publish(4.0)
        assert call(rosbag2_interfaces, 'stop') == ['stop']
        out, _ = process.communicate(timeout=200)
    assert process.returncode == 0
    assert out.splitlines() == [
        '        2 /value',
        'recorded 2 messages in 2 files, lost 0',
        f'bag {bag}',
    ]


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize(
    ('words', 'why'),
    [
        (('-a', '--topics', 'ecu'), '--all records every topic'),
        (('--snapshot-mode', '--max-cache-size', '0'), 'a snapshot needs a cache'),
        (('--custom-data', 'Oslo'), "'Oslo' is not KEY=VALUE"),
        (('--qos-profile-overrides-path', '/missing'), "'/missing' cannot be used"),
    ],
)
def test_options_that_are_wrong_or_exclude_each_other_are_one_sentence(
    words: tuple[str, ...], why: str
) -> None:
    assert why in refused('record', *words)


@pytest.mark.usefixtures('ros_domain')
def test_a_folder_that_is_in_the_way_is_one_sentence(tmp_path: Path) -> None:
    line = refused('record', '--output', str(tmp_path))
    bag = f"the bag '{tmp_path}' cannot be made (File exists): name another folder"
    assert line == f'barc record: error: {bag}'


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Return a file system of 4 MiB."""
    folder = tmp_path / 'disk'
    folder.mkdir()
    mount = ['mount', '-t', 'tmpfs', '-o', 'size=4m', 'barc_sim_test', str(folder)]
    if os.geteuid() or subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip('only root may mount')
    yield folder
    subprocess.run(['umount', '--lazy', str(folder)], check=True)  # noqa: S607 (the system's)


def fill(talker: Node, directory: Path) -> str:
    """Record what no compression makes smaller until the disk is full; return the error."""
    words = ('--output', str(directory), '--topics', 'value', '--min-free-space', '0')
    with started('record', *words) as process:
        publisher = talker.create_publisher(UInt8MultiArray, 'value', LATCHED)
        wait_for(lambda: publisher.get_subscription_count() == 1)

        def ended() -> bool:
            publisher.publish(UInt8MultiArray(data=os.urandom(50_000)))
            return process.poll() is not None

        wait_for(ended)
        _, err = process.communicate(timeout=200)
    assert process.returncode == 1
    return str(err)


def test_a_full_disk_ends_it_and_what_was_written_stays_readable(
    talker: Node, small_disk: Path
) -> None:
    directory = small_disk / 'mine'
    err = fill(talker, directory)
    assert f"writing to '{directory}' failed: No space left on device" in err
    file = directory / 'mine_0.mcap'
    assert file.stat().st_size > 3_000_000
    contents = Contents(file)
    assert list(contents.messages())
    damage = contents.damages['mine_0.mcap']
    assert (damage.unfinished, damage.unread, damage.unreadable_chunks) == (True, 0, 0)
    whole = small_disk.parent / 'whole'  # where there is space
    ((_, count),) = recover(directory, whole).counted
    assert count > 50
    mcap_doctor.check(whole / 'whole_0.mcap')
