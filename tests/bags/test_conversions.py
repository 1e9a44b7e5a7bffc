"""Many bags are converted as each is by itself, whoever does it."""

from __future__ import annotations

import os
import shutil
import signal
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import pytest
from command_line import barc, printed
from made_bags import make
from rosbag2_layouts import Sent, write_bag

from barc_sim.bags import conversions
from barc_sim.bags.conversions import Conversion, convert_bags
from barc_sim.bags.messages import BagMessage, Topic
from barc_sim.bags.writer import BagWriter
from barc_sim.parallel.processes import processes
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.timeout(120)

NAMES = ('run', 'robot', 'broken')


@pytest.fixture(scope='module')
def originals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a run's bag, another robot's, and one with an undecodable topic."""
    folder = tmp_path_factory.mktemp('originals')
    make(folder / 'run', closed_loop(distance=1.0))
    write_bag(folder / 'robot', [[Sent('/words', number, f'word {number}') for number in range(9)]])
    (folder / 'broken').mkdir()
    writer = BagWriter(folder / 'broken')
    broken = Topic(name='/x', type='a/msg/X', definition='no type', type_hash='', offered_qos=[])
    good = Topic(name='/y', type='a/msg/Y', definition='bool on', type_hash='', offered_qos=[])
    for topic in (broken, good):
        writer.write([BagMessage(topic, bytes([0, 1, 0, 0, 1]), 5, 5, 1)])
    writer.close()
    return folder


@pytest.fixture
def bags(originals: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a copy of the bags, in the working directory of the test."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(originals, tmp_path / 'bags')
    return tmp_path / 'bags'


def tables(folder: Path) -> dict[str, bytes]:
    """Return the files below a folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob('*')
        if path.is_file()
    }


def paths(folder: Path) -> list[str]:
    """Return the paths of the bags in a folder."""
    return [str(folder / name) for name in NAMES]


def test_each_bag_gets_the_tables_that_it_gets_by_itself(bags: Path, tmp_path: Path) -> None:
    for name in NAMES:
        printed('convert', str(bags / name), '-o', f'alone/{name}_csv')
    alone = tables(tmp_path / 'alone')
    assert {'run_csv/run.csv', 'robot_csv/words.csv', 'broken_csv/y.csv'} <= alone.keys()

    out = printed('convert', *paths(bags))
    assert out.splitlines() == [f'{name}_csv' for name in NAMES]
    for name in NAMES:
        shutil.move(f'{name}_csv', f'here/{name}_csv')
    assert tables(tmp_path / 'here') == alone

    out = printed('convert', *paths(bags), '-o', 'new/folder', '--jobs', '2')
    assert sorted(out.splitlines()) == sorted(f'new/folder/{name}_csv' for name in NAMES)
    assert tables(tmp_path / 'new' / 'folder') == alone


@pytest.mark.parametrize('jobs', [(), ('--jobs', '2')])
def test_a_bag_that_fails_stops_no_other(jobs: tuple[str, ...], bags: Path, tmp_path: Path) -> None:
    (tmp_path / 'out' / 'run_csv').mkdir(parents=True)
    (bags / 'empty').mkdir()
    words = [*paths(bags), str(bags / 'empty'), str(bags / 'missing'), '-o', 'out']
    result = barc('convert', *words, *jobs)
    assert result.returncode == 1
    assert sorted(result.stdout.splitlines()) == ['out/broken_csv', 'out/robot_csv']

    lines = result.stderr.splitlines()
    failed = {line.split()[2] for line in lines if ' could not be converted: ' in line}
    assert failed == {str(bags / name) for name in ('run', 'empty', 'missing')}
    assert any("out/run_csv' exists: name a new --output" in line for line in lines)
    assert any(
        line.startswith(f'{bags / "broken"}: messages of /x [a/msg/X] are left out')
        for line in lines
    )
    assert len(lines) == 4


def test_patterns_of_topics_count_for_all_bags(bags: Path, tmp_path: Path) -> None:
    words = [str(bags / 'run'), str(bags / 'broken'), '--topics', 'ecu', '/y', '--jobs', '1']
    printed('convert', *words, '-o', 'out')
    assert tables(tmp_path / 'out').keys() == {'run_csv/ecu.csv', 'broken_csv/y.csv'}


def test_two_bags_of_one_name_are_not_mixed(bags: Path) -> None:
    other = bags / 'other' / 'robot'
    shutil.copytree(bags / 'robot', other)
    result = barc('convert', str(bags / 'robot'), str(other))
    assert (result.returncode, result.stdout) == (1, 'robot_csv\n')
    assert f'{other} could not be converted: its tables would be in the folder' in result.stderr


def test_a_path_that_another_machine_lacks_is_named(bags: Path, tmp_path: Path) -> None:
    missing = Conversion(tmp_path / 'missing', tmp_path / 'out', is_elsewhere=True)
    placeless = Conversion(bags / 'robot', tmp_path / 'nowhere' / 'out', is_elsewhere=True)
    with ThreadPoolExecutor(1) as executor:
        failures = [
            converted.failure for _, converted in convert_bags([missing, placeless], executor)
        ]
    for failure, path in zip(failures, (missing.bag, placeless.output.parent), strict=True):
        assert failure.startswith(f'a worker of the cluster finds no {str(path)!r}: ')
    assert not (tmp_path / 'nowhere').exists()


def convert_and_end_once(conversion: Conversion, flag: Path) -> str:
    """Convert a bag; end this process before its last table when the flag is not there yet."""

    def end(*_: object) -> None:
        flag.touch()
        os.kill(os.getpid(), signal.SIGKILL)

    if not flag.exists():
        conversions.write_run_tables = end  # type: ignore[assignment]
    ((_, converted),) = convert_bags([conversion], None)
    return converted.failure


def test_a_bag_whose_worker_ends_is_converted_again(bags: Path, tmp_path: Path) -> None:
    (alone,) = convert_bags([Conversion(bags / 'run', tmp_path / 'alone')], None)
    assert not alone[1].failure
    conversion = Conversion(bags / 'run', tmp_path / 'out')
    with processes(1) as executor:
        failure = executor.submit(convert_and_end_once, conversion, tmp_path / 'flag').result()
    assert (failure, (tmp_path / 'flag').exists()) == ('', True)
    assert tables(tmp_path / 'out') == tables(tmp_path / 'alone')


def test_a_worker_that_fails_costs_its_bag_only(bags: Path, tmp_path: Path) -> None:
    class FailsOnce(ThreadPoolExecutor):
        def submit(self, function: Any, /, *arguments: Any) -> Any:  # type: ignore[override]  # noqa: ANN401
            (conversion,) = arguments
            if conversion.bag.name == 'run':
                return super().submit(divmod, 1, 0)
            return super().submit(function, conversion)

    pair = [Conversion(bags / name, tmp_path / name) for name in ('run', 'robot')]
    with FailsOnce(1) as executor:
        converted = dict(convert_bags(pair, executor))
    assert converted[pair[0]].failure.startswith('its worker has failed: ')
    assert not converted[pair[1]].failure
