"""The echo command: what it prints, how it ends, and its sentences."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

import yaml
from barc_interfaces.msg import ECU
from command_line import barc, refused, spinning, started
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rclpy.context import Context


@pytest.fixture
def talker(ros: Context) -> Iterator[Node]:
    """Return a node that publishes a command, counting, 100 times a second."""
    node = Node('talker', context=ros, namespace='car')
    commands = node.create_publisher(ECU, 'ecu', 10)
    message = ECU(servo=-0.25)
    message.header.stamp.sec = 7

    def publish() -> None:
        message.motor += 1.0
        commands.publish(message)

    node.create_timer(0.01, publish)
    with spinning(ros, node):
        yield node


@pytest.mark.usefixtures('talker')
def test_messages_are_documents_of_yaml() -> None:
    done = barc('echo', '/car/ecu', '-n', '3')
    assert (done.returncode, done.stderr) == (0, '')
    *documents, rest = yaml.safe_load_all(done.stdout)
    assert rest is None
    assert len(documents) == 3
    first = documents[0].pop('motor')
    assert documents[0] == {
        'header': {'stamp': {'sec': 7, 'nanosec': 0}, 'frame_id': ''},
        'servo': -0.25,
    }
    assert [document['motor'] for document in documents[1:]] == [first + 1.0, first + 2.0]


@pytest.mark.usefixtures('talker')
def test_name_without_its_slash_will_do() -> None:
    assert barc('echo', 'car/ecu', '--field', 'servo', '--once').stdout == '-0.25\n---\n'


@pytest.mark.usefixtures('talker')
def test_ctrl_c_ends_it_in_order() -> None:
    with started('echo', '/car/ecu') as process:
        assert process.stdout
        assert process.stdout.readline() == 'header:\n'
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=20)
        assert (process.returncode, err) == (0, '')


@pytest.mark.parametrize(
    'qos',
    [
        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
        QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
    ],
    ids=['latched', 'best effort'],
)
def test_messages_are_received_with_the_quality_of_their_publisher(
    ros: Context, qos: QoSProfile
) -> None:
    node = Node('talker', context=ros)
    publisher = node.create_publisher(String, 'news', qos)
    if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL:
        publisher.publish(String(data='news'))
    else:
        node.create_timer(0.01, lambda: publisher.publish(String(data='news')))
    with spinning(ros, node):
        assert barc('echo', 'news', '--once').stdout == 'data: news\n---\n'


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        (['/car/ecus', '--once'], 'there is no topic /car/ecus: did you mean /car/ecu?'),
        (
            ['/car/ecu', '--field', 'moto'],
            "there is no field 'moto': 'moto' is not among header, motor, servo",
        ),
        (
            ['/car/ecu', '--field', 'header.stamp.s'],
            "there is no field 'header.stamp.s': 's' is not among sec, nanosec",
        ),
        (
            ['/car/ecu', '--field', 'motor.x'],
            "there is no field 'motor.x': 'x' is within a float, which has no fields",
        ),
        (['/c ar'], "'/c ar' cannot be a topic: "),
    ],
)
@pytest.mark.usefixtures('talker', 'impatient')
def test_mistake_is_one_sentence(options: list[str], sentence: str) -> None:
    line = refused('echo', *options)
    assert sentence in line
    assert ' at /' not in line


@pytest.mark.usefixtures('impatient')
def test_empty_domain_is_one_sentence(ros_domain: int, tmp_path: Path) -> None:
    nothing = f'no node is running in ROS domain {ros_domain}: start a run first'
    sentences = {
        ('echo', 'z_vhcl'): f'there is no topic /z_vhcl, nor any other in ROS domain {ros_domain}',
        ('graph', '--save', str(tmp_path / 'graph.svg')): f'{nothing}, or name a bag (--bag)',
        ('topics',): nothing,
        ('param', 'list'): nothing,
    }
    for words, sentence in sentences.items():
        assert refused(*words).startswith(f'barc {words[0]}: error: {sentence}')
