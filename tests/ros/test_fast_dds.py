"""Fast DDS: its profiles, and the segments of dead processes in /dev/shm."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from barc_sim.ros.fast_dds import sweep, use_profiles

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


def data_sharing(folder: Path, process: int) -> Path:
    """Return the file of a writer of the process."""
    low, high = process & 0xFF, process >> 8 & 0xFF
    path = folder / f'fast_datasharing_01.0f.78.fd.{low:02x}.{high:02x}.4c.a8.00.00.00.00_0.0.15.4'
    path.write_bytes(b'')
    return path


def dead_process() -> int:
    """Return the number of no process, in its lower half."""
    living = {int(path.name) & 0xFFFF for path in Path('/proc').iterdir() if path.name.isdecimal()}
    return next(number for number in range(60_000, 100, -1) if number not in living)


def test_shared_data_of_a_dead_process_is_removed(tmp_path: Path) -> None:
    dead, own = data_sharing(tmp_path, dead_process()), data_sharing(tmp_path, os.getpid())

    assert sweep(tmp_path, least_age=-1.0) == 1
    assert not dead.exists()
    assert own.exists()


def test_shared_data_that_is_new_stays(tmp_path: Path) -> None:
    path = data_sharing(tmp_path, dead_process())

    assert sweep(tmp_path) == 0
    assert path.exists()


def test_shared_data_stays_while_a_hidden_process_uses_fast_dds(
    segment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = data_sharing(segment.parent, dead_process())
    monkeypatch.setattr('pathlib.Path.read_text', lambda *_, **__: '')  # /proc/locks

    with segment.with_name(f'{NAME}_el').open('rb') as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert sweep(segment.parent, least_age=-1.0) == 0

    assert path.exists()
