"""The bags of both engines are the same, but for what says who published."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

pytest.importorskip('rclpy')

from command_line import call
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from barc_sim.bags.messages import leading_time
from barc_sim.bags.reader import info

if TYPE_CHECKING:
    from pathlib import Path


#: Their messages name the node, the folder of the bag and the line of code.
WORDS = {'/rosout', '/parameter_events'}


class Topic(NamedTuple):
    """What a bag holds of a topic, with stamps [ns] from the first one on."""

    type: str
    schema: bytes
    metadata: dict[str, str]
    sequences: list[int]
    messages: list[Any]


def topics(bags: Path) -> dict[str, Topic]:
    (file,) = bags.rglob('*.mcap')
    found: dict[str, Topic] = {}
    with file.open('rb') as stream, AnyReader([file.parent]) as reader:
        first, repeated = {}, 0
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema
            topic = found.setdefault(
                channel.topic, Topic(schema.name, schema.data, channel.metadata, [], [])
            )
            stamp = leading_time(message.data)
            since = stamp - first.setdefault(channel.topic, stamp)
            # Bytes between the fields are what ROS found in memory: it is read for comparison.
            values = reader.deserialize(message.data, schema.name)
            for field in ('header', 'stamp', 'clock'):
                if hasattr(values, field):
                    object.__setattr__(values, field, since)
            # On a busy machine, ROS names nodes that it waits for, and repeats the clock for them.
            if 'waiting for' in getattr(values, 'msg', ''):
                continue
            if channel.topic == '/clock' and repr(values) in topic.messages[-1:]:
                repeated += 1
                continue
            topic.sequences.append(message.sequence - repeated * (channel.topic == '/clock'))
            topic.messages.append(None if channel.topic in WORDS else repr(values))
    return found


#: Puts the speed where the position is wanted.
STUCK = """
from barc_sim.vehicle import bike_model


def bikeFE(*state_and_input):
    x, y, psi, v = bike_model.bikeFE(*state_and_input)
    return [v, y, psi, v]
"""


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize(
    ('local_factor', 'options'),
    [
        ('max', ('--distance', '30')),
        ('20', ('--distance', '10')),
        ('max', ('--distance', '10', '--controller-type', 'lqr')),
    ],
    ids=['lock-step', 'paced', 'another controller'],
)
def test_bags_are_equal(tmp_path: Path, local_factor: str, options: tuple[str, ...]) -> None:
    found = {}
    for engine, factor in (('ros', 'max'), ('local', local_factor)):
        bags = tmp_path / engine
        words = ('--engine', engine, '--realtime-factor', factor, '--bag-dir', str(bags))
        done = call('acc', *words, *options)
        assert (done.returncode, done.stdout.splitlines()[0].split()[0]) == (0, 'engine')
        found[engine] = topics(bags)
    assert found['local'].keys() == found['ros'].keys() >= {'/z_vhcl', '/ecu', '/rosout'}
    for name, topic in found['ros'].items():
        assert found['local'][name] == topic, name


@pytest.mark.usefixtures('ros_domain')
def test_a_car_that_never_arrives_ends_both_in_the_same_state(tmp_path: Path) -> None:
    (tmp_path / 'bike_model.py').write_text(STUCK)
    found = []
    for engine in ('ros', 'local'):
        bags = tmp_path / engine
        words = ('--engine', engine, '--realtime-factor', 'max', '--bag-dir', str(bags))
        done = call('acc', *words, '--model', str(tmp_path / 'bike_model.py'))
        sentence = 'the car stands at 8.0 m: the model returns the speed in place of x; it got no'
        assert (done.returncode, sentence in done.stderr) == (1, True)
        (bag,) = bags.iterdir()
        assert info(bag)['failure'] in done.stderr
        found.append(topics(bags)['/z_vhcl'])
    assert found[0] == found[1]
    assert len(found[0].messages) > 1000
