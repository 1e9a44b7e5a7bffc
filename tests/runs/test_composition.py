"""A whole run: one trajectory, however it was timed, and all of it in the bag."""

from __future__ import annotations

import re
import signal
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml

pytest.importorskip('rclpy')

from command_line import acc, bag_of, messages, printed
from rosbags.highlevel import AnyReader
from user_files import user_text

import barc_sim
from barc_sim.bags import reader as bag
from barc_sim.errors import UserError
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.metrics import laps_of
from barc_sim.vehicle.bike_model import BicycleState
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable, Sequence

    from barc_interfaces.msg import ZDynBkMdl

    from barc_sim.simulation.log import Log

COLUMNS = [name for name in barc_sim.simulation.log.COLUMNS if name != 'missed']
TOPICS = ('/z_vhcl', '/ez_vhcl', '/environment', '/ecu', '/applied_command', '/pid_state')
PROGRAMS = Path(__file__).with_name('programs')
pytestmark = pytest.mark.usefixtures('ros_domain')


def stamps(messages: Sequence[Any]) -> list[int]:
    return [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages]


def assert_same(log: Log, other: Log, rows: int | None = None) -> None:
    """Compare to the last bit, the first `rows` rows only if given."""
    assert rows is not None or len(log) == len(other)
    for name in COLUMNS:
        assert np.array_equal(getattr(log, name)[:rows], getattr(other, name)[:rows]), name


# One trajectory


def test_a_run_in_real_time_has_the_states_of_the_closed_loop_up_to_a_missed_deadline(
    tmp_path: Path,
) -> None:
    expected = closed_loop(distance=1.0)
    for _ in range(3):
        before = time.time_ns()
        path = bag_of(tmp_path, '--distance', '1')

        with AnyReader([path]) as reader:
            assert '/clock' not in reader.topics  # the bag's time is the wall's
            states = reader.topics['/z_vhcl'].connections
            times = [time for _, time, _ in reader.messages(states)]
        assert before < times[0] < times[-1] < time.time_ns()

        run = bag.read(path)
        if not run.missed.any():
            assert_same(run, expected)
            return
        assert_same(run, expected, rows=int(run.missed.argmax()))
    pytest.skip('this machine missed a deadline in each of 3 runs')


@pytest.mark.parametrize('engine', ['ros', 'local'])
def test_the_bag_marks_as_many_missed_commands_as_were_counted(tmp_path: Path, engine: str) -> None:
    (tmp_path / 'slow.py').write_text(user_text('slow_controller.py'))
    options = ('--controller', str(tmp_path / 'slow.py'), '--distance', '10', '--engine', engine)
    run = printed('acc', *options, '-q', '--bag-dir', str(tmp_path / 'bags')).strip()
    info, log = bag.info(run), bag.read(run)

    assert int(info['missed_deadlines']) + int(info['slipped_periods']) > 0
    assert np.count_nonzero(log.missed) == int(info['missed_deadlines'])
    assert info['lost_messages'] == '0'
    # What acts while a command is missed is an earlier one, perhaps the late answer to another.
    assert set(log.motor) <= {0.0, *(each.motor for each in messages(Path(run))['/ecu'])}


@pytest.mark.usefixtures('ros_domain')
def test_each_lap_is_the_run_of_one_lap_and_has_a_row(tmp_path: Path) -> None:
    words = ('--realtime-factor', 'max', '--distance', '30', '--laps', '2')
    out = printed('acc', *words, '--bag-dir', str(tmp_path / 'bags'))
    rows = re.findall(
        r'^ +(\d)  +0\.0 to +30\.2 m +0\.\d+ +0\.\d+ +0\.3% +1\.00', out, re.MULTILINE
    )
    assert rows == ['1', '2']

    path = bag.newest(tmp_path / 'bags')
    log, single = bag.read(path), closed_loop(distance=30.0)
    numbers = np.array(laps_of(log)[1])
    for number in range(2):
        assert_same(replace(log.map(lambda c: c[numbers == number]), t=single.t), single)  # noqa: B023 (called at once)

    parameters = yaml.safe_load(bag.info(path)['parameters'])
    assert parameters['/vehicle_simulator']['ros__parameters']['laps'] == 2

    printed('report', str(path), '-o', str(tmp_path / 'report.html'))
    assert 'lap 2, 0.0 to 30.2 m' in (tmp_path / 'report.html').read_text()


# The bag


@pytest.fixture(scope='module')
def path(module_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: ARG001
    """Return the bag of a short run."""
    options = ('--realtime-factor', 'max', '--distance', '3', '--kp', '29')
    return bag_of(tmp_path_factory.mktemp('run'), *options)


def test_the_bag_has_each_step_once_on_each_topic(path: Path) -> None:
    by_topic = messages(path)
    begin = stamps(by_topic['/z_vhcl'])[0]
    steps = int(bag.info(path)['steps'])
    for topic in TOPICS:
        assert stamps(by_topic[topic]) == [begin + k * 20_000_000 for k in range(steps)], topic
    assert by_topic['/z_vhcl'][-2].x < 3.0 <= by_topic['/z_vhcl'][-1].x

    with AnyReader([path]) as reader:  # the bag's time is the simulated one
        times = [time for _, time, _ in reader.messages(reader.topics['/z_vhcl'].connections)]
    assert times == stamps(by_topic['/z_vhcl'])


def test_the_bag_has_the_command_and_the_parameters_of_the_run(path: Path) -> None:
    info = bag.info(path)
    assert info['command'].startswith('barc acc -q --realtime-factor max')
    assert (info['kp'], info['road'], info['missed_deadlines']) == ('29.0', 'lab', '0')
    parameters = yaml.safe_load(info['parameters'])
    assert parameters['/controller']['ros__parameters']['kp'] == 29.0
    assert parameters['/vehicle_simulator']['ros__parameters']['distance'] == 3.0


@pytest.mark.slow
@pytest.mark.parametrize('factor', ['1', 'max'])
def test_the_bag_has_the_message_of_a_publisher_that_lives_shortly(
    tmp_path: Path, start: Callable[..., subprocess.Popen[str]], factor: str
) -> None:
    brief = start(PROGRAMS / 'publish_once.py')
    assert brief.stdout
    brief.stdout.readline()

    run = start('-m', 'barc_sim.run', 'acc', '-q', '--realtime-factor', factor, '--distance', '0')
    assert brief.wait(30) == 0
    run.send_signal(signal.SIGINT)
    path = tmp_path / run.communicate(timeout=200)[0].strip()

    by_topic = messages(path)
    assert [reference.data for reference in by_topic['/speed_reference']] == [5.0]


@pytest.mark.usefixtures('ros_domain')
def test_an_initial_pose_is_in_the_bag_and_the_run_from_there_can_be_repeated(
    tmp_path: Path, start: Callable[..., subprocess.Popen[str]]
) -> None:
    rviz = start(PROGRAMS / 'set_initial_pose.py')
    assert rviz.stdout
    rviz.stdout.readline()
    options = ('--realtime-factor', 'max', '--road', 'flat', '--distance', '0')
    run = start('-m', 'barc_sim.run', 'acc', '-q', *options)
    assert rviz.wait(60) == 0
    run.send_signal(signal.SIGINT)
    path = tmp_path / run.communicate(timeout=200)[0].strip()

    (message,) = messages(path)['/initialpose']
    assert (message.pose.pose.position.x, message.pose.pose.position.y) == (-40.0, 3.0)

    log = bag.read(path)
    first = int(np.argmax(log.x == -40.0))
    assert np.all(np.diff(log.t) > 0.0)

    plant = Plant(road=Road.flat())
    plant.place(BicycleState(-40.0, 3.0))
    again = closed_loop(plant, distance=-30.0)
    rows = log.map(lambda column: column[first : first + len(again)])
    assert_same(rows, replace(again, t=rows.t))


# How it ends


def test_a_fault_in_a_node_is_raised_and_the_bag_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    on_state = CruiseController._on_state  # noqa: SLF001

    def fail_above_half(self: CruiseController, state: ZDynBkMdl) -> None:
        assert state.v_x < 0.5, 'a fault of ours'
        on_state(self, state)

    monkeypatch.setattr(CruiseController, '_on_state', fail_above_half)
    with pytest.raises(AssertionError, match='a fault of ours'):
        acc(tmp_path, '--realtime-factor', 'max')
    (path,) = (tmp_path / 'bags').iterdir()
    by_topic = messages(path)
    assert by_topic['/z_vhcl'][-1].v_x >= 0.5
    assert len(by_topic['/ecu']) == len(by_topic['/z_vhcl']) - 1
    assert bag.info(path)['steps'] == str(len(by_topic['/z_vhcl']))


@pytest.mark.parametrize(
    ('moment', 'folder_exists'), [('__init__', False), ('publish_state', True)]
)
def test_a_refused_run_leaves_no_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str, *, folder_exists: bool
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise UserError('not here')

    monkeypatch.setattr(VehicleSimulator, moment, refuse)
    folder = tmp_path / 'here'
    (folder / 'bags' if folder_exists else folder).mkdir(parents=True)
    process = acc(folder)
    assert (process.returncode, process.stdout) == (2, '')
    assert process.stderr == 'barc acc: error: not here\n'
    assert list(folder.rglob('*')) == ([folder / 'bags'] if folder_exists else [])


def test_an_error_after_the_first_state_leaves_the_bag_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish = VehicleSimulator.publish_state
    states: list[object] = []

    def refuse_the_fifth(*arguments: Any) -> None:  # noqa: ANN401
        if len(states) == 4:
            raise UserError('no more')
        states.append(publish(*arguments))

    monkeypatch.setattr(VehicleSimulator, 'publish_state', refuse_the_fifth)
    process = acc(tmp_path, '--realtime-factor', 'max')
    assert process.returncode == 1
    assert process.stderr.splitlines()[-1] == 'barc acc: error: no more'
    path = tmp_path / process.stdout.strip()
    assert bag.info(path)['failure'] == 'no more'
    assert len(messages(path)['/z_vhcl']) == 4
