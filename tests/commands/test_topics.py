"""The topics command: endpoints and rates of topics."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from barc_interfaces.msg import ECU
from command_line import barc, refused, spinning
from rclpy.node import Node
from std_msgs.msg import String

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.context import Context


@pytest.fixture(autouse=True)
def nodes(ros: Context) -> Iterator[None]:
    """Run a node that publishes at 50 Hz, one that listens, and hidden topics."""
    talker, listener = Node('talker', context=ros), Node('listener', context=ros)
    commands = talker.create_publisher(ECU, 'ecu', 10)
    talker.create_publisher(String, '_hidden', 10)
    talker.create_timer(0.02, lambda: commands.publish(ECU()))
    listener.create_subscription(ECU, 'ecu', lambda _: None, 10)
    with spinning(ros, talker, listener):
        yield


def test_topics_have_types_and_counts_of_both_ends() -> None:
    done = barc('topics')
    assert (done.returncode, done.stderr) == (0, '')
    lines = done.stdout.splitlines()
    assert '/ecu [barc_interfaces/msg/ECU] 1 publisher, 1 subscriber' in lines
    assert '/rosout [rcl_interfaces/msg/Log] 2 publishers, 0 subscribers' in lines
    assert '_hidden' not in done.stdout


def test_verbose_prints_nodes_and_their_quality_of_service() -> None:
    done = barc('topics', '-v', '--include-hidden-topics')
    assert '/_hidden [std_msgs/msg/String] 1 publisher, 0 subscribers' in done.stdout
    ours = done.stdout.partition('/ecu [')[2]
    assert ours.startswith('barc_interfaces/msg/ECU] 1 publisher, 1 subscriber')
    publisher, subscription, *_ = ours.split('\n\n')[1:]
    assert 'Node name: talker\n' in publisher
    assert 'Endpoint type: PUBLISHER\n' in publisher
    assert 'Node name: listener\n' in subscription
    assert 'Reliability: RELIABLE\n' in subscription


def test_rate_is_measured() -> None:
    done = barc('topics', 'ecu', '--hz', '0.5')
    _, rate = done.stdout.splitlines()
    words = re.fullmatch(
        r'  average rate: ([\d.]+) min: [\d.]+s max: [\d.]+s std dev: [\d.]+s window: (\d+)', rate
    )
    assert words
    assert 5.0 < float(words[1]) < 60.0  # 50 on a machine that keeps up
    assert int(words[2]) > 1


@pytest.mark.usefixtures('impatient')
def test_topic_without_endpoints_is_one_sentence() -> None:
    assert refused('topics', 'ecus').endswith(': there is no topic /ecus: did you mean /ecu?')
