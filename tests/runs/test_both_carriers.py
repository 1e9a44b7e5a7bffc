"""A run without ROS gives the golden figures, and the bag that it gives with ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

pytest.importorskip('rclpy')

from command_line import call, printed
from golden.make_golden import differences, figures
from golden.scenarios import SCENARIOS
from golden.test_golden import golden
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from barc_sim.interfaces.stamps import leading_time

if TYPE_CHECKING:
    from pathlib import Path

    from golden.scenarios import Scenario

__all__ = ['golden']

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
    by_name: dict[str, Topic] = {}
    with file.open('rb') as stream, AnyReader([file.parent]) as reader:
        first, repeated = {}, 0
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema
            topic = by_name.setdefault(
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
    return by_name


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize('controller', ['pid', 'lqr'])
def test_runs_with_and_without_ros_give_equal_bags(tmp_path: Path, controller: str) -> None:
    contents = {}
    for engine in ('ros', 'local'):
        bags = tmp_path / engine
        words = ('--engine', engine, '--bag-dir', str(bags), '--controller-type', controller)
        printed('acc', *words, '--realtime-factor', 'max', '--distance', '20')
        contents[engine] = topics(bags)

    assert contents['local'].keys() == contents['ros'].keys() >= {'/z_vhcl', '/ecu', '/rosout'}
    for name, topic in contents['ros'].items():
        assert contents['local'][name] == topic, name


def test_a_run_of_user_code_without_ros_gives_the_golden_figures(
    golden: dict[str, Any], tmp_path: Path
) -> None:
    def run(scenario: Scenario, folder: Path) -> None:
        assert call(*scenario.arguments(), cwd=folder).returncode == 0

    scenario = SCENARIOS['user_code']  # others: test_carriers
    local = scenario._replace(options=f'{scenario.options} --engine local')
    figures_of_run = figures(local, tmp_path, run)
    before, engine, after = figures_of_run['metadata'].partition('engine=local, without ROS ')
    assert engine
    figures_of_run['metadata'] = before + after
    assert not differences(golden['user_code'], figures_of_run)
