"""Fast DDS: its profiles, and the segments of dead processes in /dev/shm."""

from __future__ import annotations

import fcntl
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from barc_sim.ros.process import sweep, use_profiles

NAME = 'fastrtps_0123456789abcdef'


def test_profiles_are_set_where_there_are_none() -> None:
    environment: dict[str, str] = {}
    use_profiles(environment)
    assert environment.pop('RMW_FASTRTPS_USE_QOS_FROM_XML') == '1'
    (path,) = environment.values()
    policies = ET.fromstring(Path(path).read_text(encoding='utf-8')).iter()
    assert [element.text for element in policies if 'MemoryPolicy' in element.tag] == [
        'DYNAMIC',
        'DYNAMIC',
    ]


@pytest.mark.parametrize(
    'name',
    [
        'FASTRTPS_DEFAULT_PROFILES_FILE',
        'FASTDDS_DEFAULT_PROFILES_FILE',
        'RMW_FASTRTPS_USE_QOS_FROM_XML',
    ],
)
def test_profiles_of_the_user_stay(name: str) -> None:
    environment = {name: '0'}
    use_profiles(environment)
    assert environment == {name: '0'}


@pytest.fixture
def segment(tmp_path: Path) -> Path:
    """Return a segment with its lock beside it."""
    for name in (NAME, f'{NAME}_el'):
        (tmp_path / name).write_bytes(b'')
    return tmp_path / NAME


def test_segment_of_a_dead_process_is_removed_with_its_lock(segment: Path) -> None:
    assert sweep(segment.parent, least_age=-1.0) == 1
    assert not list(segment.parent.iterdir())


def test_segment_whose_lock_is_held_stays(segment: Path) -> None:
    lock = segment.with_name(f'{NAME}_el')
    with lock.open('rb') as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert sweep(segment.parent, least_age=-1.0) == 0
    assert segment.exists()
    assert lock.exists()


def test_segment_that_is_new_stays(segment: Path) -> None:
    assert sweep(segment.parent) == 0
    assert segment.exists()


def test_nothing_else_is_touched(tmp_path: Path) -> None:
    names = {'fastrtps_port7411', 'fastrtps_port7411_el', 'sem.else', 'else'}
    for name in names:
        (tmp_path / name).write_bytes(b'')
    assert sweep(tmp_path, least_age=-1.0) == 0
    assert {path.name for path in tmp_path.iterdir()} == names


def test_missing_folder_is_no_error(tmp_path: Path) -> None:
    assert sweep(tmp_path / 'none') == 0


_LAST_WORDS = """
import os
from barc_sim.ros.process import use_profiles
use_profiles(os.environ)
import rclpy
from rclpy.duration import Duration
from std_msgs.msg import Float64
rclpy.init()
node = rclpy.create_node('node')
got = []
subscription = node.create_subscription(Float64, 'topic', got.append, 10)
publisher = node.create_publisher(Float64, 'topic', 10)
while not publisher.get_subscription_count():
    rclpy.spin_once(node, timeout_sec=0.01)
publisher.publish(Float64(data=5.0))
node.destroy_publisher(publisher)
for _ in range(200):
    rclpy.spin_once(node, timeout_sec=0.01)
    if got:
        break
own = f'.{os.getpid() & 255:02x}.{os.getpid() >> 8 & 255:02x}.'
shared = [name for name in os.listdir('/dev/shm') if 'datasharing' in name and own in name]
print(got, shared)
rclpy.shutdown()
"""


def test_a_message_outlives_its_publisher_and_shares_no_file(ros_domain: int) -> None:
    """Data of a fixed size that is shared is gone with its publisher, and leaves a file."""
    del ros_domain
    pytest.importorskip('rclpy')
    done = subprocess.run(
        [sys.executable, '-c', _LAST_WORDS], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == '[std_msgs.msg.Float64(data=5.0)] []\n'
