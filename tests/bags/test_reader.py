"""Bags read back as logs."""

from __future__ import annotations

import os
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pytest
from made_bags import fill, make

from barc_sim.bags import bounds
from barc_sim.bags import reader as bag
from barc_sim.bags.messages import BagMessage, Topic
from barc_sim.bags.metadata import TRACK_NAME, track_file
from barc_sim.bags.samples import TOPICS, Samples
from barc_sim.bags.samples import join as join_samples
from barc_sim.bags.writer import BagWriter
from barc_sim.control.lane import LaneLQR
from barc_sim.control.speed import LQR, PID
from barc_sim.errors import UserError
from barc_sim.interfaces.topics import APPLIED_COMMAND, STATE
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.log import Log, TrackLog
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


def start(directory: Path) -> BagWriter:
    directory.mkdir(parents=True)
    return BagWriter(directory, metadata={'command': 'acc', 'kp': '30.0'})


def written(tmp_path: Path, log: Log, *namespaces: str) -> Path:
    """Return a bag with a car in each namespace."""
    writer = start(tmp_path / 'run')
    for namespace in namespaces or ['']:
        fill(writer, log, namespace)
    writer.add_metadata({'kp': '31.0', 'missed': '0'})
    writer.close()
    return tmp_path / 'run'


@pytest.fixture(scope='module')
def log() -> Log:
    return closed_loop(distance=25.0)


@pytest.fixture
def run(tmp_path: Path, log: Log) -> Path:
    """Return a bag of a run."""
    return written(tmp_path, log)


def assert_same(read: Log, expected: Log) -> None:
    assert len(read) == len(expected)
    assert [*read.columns()] == [*expected.columns()]
    for name, column in expected.columns().items():
        np.testing.assert_array_equal(read.columns()[name], column, err_msg=name)


def test_a_run_is_read_back_bit_for_bit(run: Path, log: Log) -> None:
    assert_same(bag.read(run), log)


def test_missed_commands_are_read_back(tmp_path: Path, log: Log) -> None:
    late = replace(log, missed=np.arange(len(log)) % 7 == 3)
    assert_same(bag.read(written(tmp_path, late)), late)


def test_terms_of_other_controllers_are_read_back_by_name(tmp_path: Path) -> None:
    expected = closed_loop(controller=LQR(output_min=-8.0, output_max=8.0), distance=25.0)
    assert [*expected.own_terms] == [*LQR.terms]
    assert_same(bag.read(written(tmp_path, expected)), expected)


class _Weighing(LaneLQR):
    terms: Mapping[str, str] = {**LaneLQR.terms, 'weight': 'that of e_y'}
    weight = 0.05


@pytest.mark.parametrize('law', [LaneLQR, _Weighing])
def test_a_run_on_a_track_is_read_back_with_the_places(tmp_path: Path, law: type[LaneLQR]) -> None:
    plant = Plant(track=replace(Track.named('oval'), width=4.0))
    expected = closed_loop(plant, distance=25.0, lane=law())
    read = bag.read(written(tmp_path, expected))
    assert isinstance(read, TrackLog)
    assert_same(read, expected)


@pytest.mark.parametrize(
    'text',
    [
        '',
        '[' * 100_000,
        '[1, 2, 3, 4, 5]',
        '[["a"], [0.0], 6.0, "name", [0.0, 0.0, 0.0]]',
        '[[10.0], [0.0], 6.0, "name", [0.0, 0.0]]',
        '[[10.0], [0.0], 6.0, "name", [0.0, NaN, 0.0]]',
        '[[1e10], [0.0], 6.0, "name", [0.0, 0.0, 0.0]]',
        '[[10.0], [0.0], -6.0, "name", [0.0, 0.0, 0.0]]',
        '[[10.0], [0.0], 6.0, "name", [0.0, 0.0, 0.0]]' + ' ' * bounds.MAX_TRACK,
    ],
    ids=lambda text: text[:50],
)
def test_an_invalid_track_in_a_bag_counts_as_unknown(tmp_path: Path, text: str) -> None:
    log = closed_loop(Plant(track=Track.named('oval')), distance=1.0, lane=LaneLQR())
    assert isinstance(log, TrackLog)
    assert log.track
    for name, data in (('whole', track_file(log.track)), ('none', {TRACK_NAME: text.encode()})):
        make(tmp_path / name, log, attachments=data)
    read = [bag.read(tmp_path / name) for name in ('whole', 'none')]
    assert [getattr(each, 'track', '') for each in read] == [log.track, None]


def test_a_term_may_have_the_name_of_a_pids_and_none_of_another_column(tmp_path: Path) -> None:
    class Feedforward(PID):
        """A PI controller that adds a constant."""

        terms: Mapping[str, str] = {
            'proportional': 'kp times the error',
            'feedforward': 'a constant',
            'motor': 'its name is that of a column',
        }
        feedforward = 0.5
        motor = 7.0

    expected = closed_loop(controller=Feedforward(output_min=-8.0, output_max=8.0), distance=25.0)
    assert [*expected.terms] == ['proportional', 'feedforward']
    assert expected.motor[-1] != 7.0
    assert_same(bag.read(written(tmp_path, expected)), expected)


@pytest.mark.parametrize('track', [None, 'oval'])
def test_a_term_may_have_the_name_of_a_tracks_column_on_a_road(
    tmp_path: Path, track: str | None
) -> None:
    class Sliding(PID):
        """A PID that declares its distance from a sliding surface."""

        terms: Mapping[str, str] = {**PID.terms, 's': 'its name is that of a column'}
        s = 7.0

    plant = Plant(track=Track.named(track) if track else None)
    expected = closed_loop(plant, Sliding(output_min=-8.0, output_max=8.0), distance=25.0)
    assert [*expected.own_terms] == ([] if track else ['s'])
    assert expected.columns()['s'][0] == (0.0 if track else 7.0)
    assert_same(bag.read(written(tmp_path, expected)), expected)


def test_a_bag_of_several_cars_is_read_by_namespace(tmp_path: Path, log: Log) -> None:
    path = written(tmp_path, log, '/car2', '')
    with pytest.raises(UserError, match=r'several cars, /, /car2: name one, as in --namespace /'):
        bag.read(path)
    for namespace in ('/', '/car2', 'car2'):
        assert_same(bag.read(path, namespace), log)
    with pytest.raises(UserError, match='no states of the car /car3'):
        bag.read(path, 'car3')


def test_info_is_the_newest_metadata(run: Path) -> None:
    assert bag.info(run) == {'command': 'acc', 'kp': '31.0', 'missed': '0'}


def test_an_unfinished_bag_is_read_up_to_its_last_whole_record(
    tmp_path: Path, log: Log, caplog: pytest.LogCaptureFixture
) -> None:
    writer = start(tmp_path / 'run')
    fill(writer, log)
    writer.flush()
    assert bag.info(tmp_path / 'run')['command'] == 'acc'
    assert_same(bag.read(tmp_path / 'run'), log)
    assert [record.getMessage() for record in caplog.records] == [
        f'{writer.file} is unfinished or damaged: read its whole records'
    ]
    writer.close()


@pytest.mark.parametrize('share', [0.3, 0.6, 0.9])
def test_a_bag_cut_short_is_read_as_far_as_it_is_whole(
    run: Path, log: Log, caplog: pytest.LogCaptureFixture, share: float
) -> None:
    file = run / 'run_0.mcap'
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    read = bag.read(run)
    assert 0 < len(read) <= len(log)
    np.testing.assert_array_equal(read.x, log.x[: len(read)])
    assert len(caplog.records) == 1


def test_the_bag_written_to_last_is_the_newest(tmp_path: Path) -> None:
    for age, name in enumerate(('b', 'c', 'a')):
        writer = start(tmp_path / name)
        writer.close()
        os.utime(writer.file, (1000 - age, 1000 - age))
    (tmp_path / 'empty').mkdir()
    assert bag.newest(tmp_path) == tmp_path / 'b'


@pytest.mark.parametrize('root', ['.', 'missing'])
def test_the_error_without_a_bag_names_the_folder(
    tmp_path: Path, root: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=r'there is no bag in .*: make a run first') as caught:
        bag.newest(root)
    assert repr(str(tmp_path / root)) in str(caught.value)


@pytest.mark.parametrize(
    ('make', 'sentence'),
    [
        (Path.rmdir, r"there is no bag '\S+': name"),
        (Path.exists, r'has no \.mcap and no \.db3 file in it'),
        (lambda path: (path / 'a.mcap').touch(), r"a\.mcap' is empty: name another bag"),
        (lambda path: (path / 'a.mcap').write_text('x'), r"a\.mcap' is not an MCAP file: name a"),
        (lambda path: (path / 'a.mcap').write_text('not a bag, but text'), 'is not an MCAP file'),
        (lambda path: (path / 'a.mcap').mkdir(), r"a\.mcap' is a folder, where a regular"),
        (lambda path: os.mkfifo(path / 'a.mcap'), r"a\.mcap' is a named pipe, where a regular"),
        (lambda path: (path / 'a.mcap').symlink_to('/dev/zero'), r"a\.mcap' is a link"),
    ],
)
@pytest.mark.parametrize('read', [bag.read, bag.info])
def test_the_error_names_a_path_that_is_not_a_bag(
    tmp_path: Path, read: Callable[[Path], object], make: Callable[[Path], object], sentence: str
) -> None:
    path = tmp_path / 'bag'
    path.mkdir()
    make(path)
    with pytest.raises(UserError, match=sentence):
        read(path)


def test_a_topic_with_another_type_than_the_state_is_not_a_car(tmp_path: Path) -> None:
    writer = start(tmp_path / 'run')
    topic = Topic(
        name='/z_vhcl',
        type='std_msgs/msg/Float64',
        definition='float64 data',
        type_hash='',
        offered_qos=[],
    )
    writer.write([BagMessage(topic, bytes(12), 1, 1, 1)])
    writer.close()
    with pytest.raises(UserError, match='no states of a car'):
        bag.read(tmp_path / 'run')


PERIOD = 20_000_000


class Sample(NamedTuple):
    """A message: its stamp and publication [ns], and its fields."""

    stamp: int
    published: int
    values: tuple[float, ...]


def join(messages: dict[str, list[Sample]]) -> Log:
    """Return the log of the messages of a car, by topic."""
    made = {topic: Samples(len(TOPICS[topic])) for topic in messages}
    for topic, samples in messages.items():
        for sample in samples:
            made[topic].add(*sample, {})
    return join_samples(made)


def state(k: int) -> Sample:
    """Return state `k`: its values are `k`, and it is published at `100 k`."""
    return Sample(1 + k * PERIOD, 100 * k, (float(k),) * len(TOPICS[STATE]))


def command(k: int, published: int, motor: float = 0.0) -> Sample:
    """Return a command that answers state `k`."""
    return Sample(1 + k * PERIOD, published, (motor, 0.0))


def applied(k: int, motor: float, *, missed: bool) -> Sample:
    """Return the simulator's record of the command that acts from state `k` on."""
    return Sample(1 + k * PERIOD, 100 * k + 99, (motor, 0.0, float(missed)))


def unstamped(published: int, motor: float) -> Sample:
    return Sample(0, published, (motor, 0.0))


def test_rows_are_in_the_order_of_the_stamps_whatever_the_order_of_the_file() -> None:
    log = join({STATE: [state(2), state(0), state(1)]})
    assert log.x.tolist() == [0.0, 1.0, 2.0]
    assert log.t.tolist() == [0.0, 0.02, 0.04]


def test_messages_belong_to_the_state_with_their_stamp() -> None:
    samples = {STATE: [state(k) for k in range(4)]}
    for topic, fields in TOPICS.items():
        if topic != STATE:
            samples[topic] = [
                Sample(1 + k * PERIOD, 100 * k + 1, (10.0 * k,) * len(fields)) for k in (3, 1)
            ]
    del samples['ecu']  # holds where a state has none
    log = join(samples)
    for values in (log.e_s, log.e_psi_dot, log.motor, log.servo, log.theta_deg, log.elevation):
        np.testing.assert_array_equal(values, [np.nan, 10.0, np.nan, 30.0])
    for values in (log.friction, log.gravity, log.reference, log.derivative):
        np.testing.assert_array_equal(values, [np.nan, 10.0, np.nan, 30.0])


def test_track_states_without_a_state_make_no_track_log() -> None:
    place = Sample(0, 0, (1.0,) * len(TOPICS['track_vhcl']))
    assert type(join({STATE: [state(0)], 'track_vhcl': [place]})) is Log


def test_saturated_is_what_the_controller_published() -> None:
    said = [Sample(1 + k * PERIOD, 100 * k, (8.0, 1.0, 0.0, 0.0, k == 1)) for k in range(2)]
    log = join({STATE: [state(0), state(1)], 'pid_state': said})
    assert log.saturated.tolist() == [False, True]
    assert log.reference.tolist() == [8.0, 8.0]


def test_a_command_is_missed_unless_published_before_the_next_state() -> None:
    states = [state(k) for k in range(4)]
    commands = [command(0, 99), command(1, 200, motor=3.0), command(3, 301)]
    log = join({STATE: states, 'ecu': commands})
    assert log.missed.tolist() == [False, True, True, False]
    assert log.motor.tolist() == [0.0, 0.0, 3.0, 0.0]  # the last one holds


def test_the_last_state_is_missed_only_if_nothing_answers_it() -> None:
    states = [state(0), state(1)]
    assert join({STATE: states, 'ecu': [command(0, 50), command(1, 10**9)]}).missed.sum() == 0
    assert join({STATE: states, 'ecu': [command(0, 50)]}).missed.tolist() == [False, True]


def test_of_several_answers_the_first_published_counts() -> None:
    commands = [command(0, 60, motor=2.0), command(0, 50, motor=1.0)]
    log = join({STATE: [state(0)], 'ecu': commands})
    assert log.motor.tolist() == [1.0]


def test_a_command_without_a_stamp_holds_and_nothing_is_missed() -> None:
    states = [state(k) for k in range(4)]
    log = join({STATE: states, 'ecu': [unstamped(150, 1.0), unstamped(350, 2.0)]})
    np.testing.assert_array_equal(log.motor, [np.nan, 1.0, 1.0, 2.0])
    assert log.missed.tolist() == [True, False, False, False]


def test_the_simulators_record_decides_which_command_acts_and_what_is_missed() -> None:
    """Under load an answer can be published before the next state, and still be too late."""
    commands = [command(0, 50, motor=1.0), command(1, 199, motor=2.0), command(3, 350, motor=4.0)]
    records = [
        applied(0, 1.0, missed=False),
        applied(1, 1.0, missed=True),
        applied(2, 2.0, missed=True),
    ]
    log = join({STATE: [state(k) for k in range(4)], 'ecu': commands, APPLIED_COMMAND: records})
    assert log.missed.tolist() == [False, True, True, False]
    assert log.motor.tolist() == [1.0, 1.0, 2.0, 4.0]


def test_a_state_without_a_record_had_no_deadline() -> None:
    log = join({STATE: [state(0), state(1)], APPLIED_COMMAND: [applied(0, 1.0, missed=False)]})
    assert log.missed.tolist() == [False, False]
    np.testing.assert_array_equal(log.motor, [1.0, np.nan])


@pytest.mark.parametrize(('far', 'refused'), [(0.9e9, False), (1.1e9, True)])
def test_a_car_too_far_from_the_start_is_refused(
    tmp_path: Path, log: Log, far: float, *, refused: bool
) -> None:
    path = written(tmp_path, replace(log, y=np.full(len(log), far)))
    with pytest.raises(UserError, match='m from the start') if refused else nullcontext():
        bag.read(path)


def test_more_than_64_terms_are_refused() -> None:
    samples = Samples(0)
    samples.add(1, 1, (), dict.fromkeys(map(str, range(64)), 0.0))
    with pytest.raises(ValueError, match='terms'):
        samples.add(2, 2, (), {'64': 0.0})
    assert len(samples) == 1
