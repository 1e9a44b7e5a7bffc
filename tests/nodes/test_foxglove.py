"""The server of the Foxglove app, through a client of its protocol."""

from __future__ import annotations

import json
import re
import struct
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('foxglove')

from command_line import spinning
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from websockets.sync.client import connect

from barc_sim.bags.messages import definition
from barc_sim.nodes.foxglove import FoxgloveServer
from barc_sim.ros.node_helpers import to_header

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.context import Context
    from websockets.sync.client import ClientConnection

PROTOCOL = 'foxglove.sdk.v1'
DEADLINE = 20.0  # [s]
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MESSAGE, TIME = 1, 2


class Client:
    """A client that subscribes to every channel."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self._names: dict[int, str] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.messages: dict[str, list[tuple[int, bytes]]] = {}
        self.times: list[int] = []

    def until(self, condition: Callable[[], bool]) -> None:
        """Receive until a condition holds, checked each time that nothing waits, or fail."""
        end = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < end
            timeout = 0.02
            with suppress(TimeoutError):
                while True:
                    self._receive(self._connection.recv(timeout))
                    timeout = 0.0

    def _receive(self, received: str | bytes) -> None:
        if isinstance(received, str):
            self._receive_text(json.loads(received))
        elif received[0] == MESSAGE:
            number, at = struct.unpack_from('<IQ', received, 1)
            self.messages[self._names[number]].append((at, received[13:]))
        elif received[0] == TIME:
            self.times += struct.unpack_from('<Q', received, 1)

    def _receive_text(self, message: dict[str, Any]) -> None:
        if message['op'] == 'advertise':
            for channel in message['channels']:
                self.channels[channel['topic']] = channel
                self._names[channel['id']] = channel['topic']
                self.messages.setdefault(channel['topic'], [])
            self._subscribe([channel['id'] for channel in message['channels']])
        elif unknown := re.match(r'Unknown channel ID: (\d+)', message.get('message', '')):
            # The SDK advertises a channel a moment before it takes subscriptions to it.
            self._subscribe([int(unknown[1])])

    def _subscribe(self, channels: list[int]) -> None:
        wanted = [{'id': number, 'channelId': number} for number in channels]
        self._connection.send(json.dumps({'op': 'subscribe', 'subscriptions': wanted}))

    def latest(self, topic: str) -> tuple[int, bytes]:
        """Return the newest message of a topic, once there is one."""
        self.until(lambda: bool(self.messages.get(topic)))
        return self.messages[topic][-1]


@pytest.fixture
def source(ros: Context) -> Iterator[Node]:
    """Return a node that publishes."""
    node = Node('source', context=ros)
    yield node
    node.destroy_node()


@pytest.fixture
def server(ros: Context) -> Iterator[FoxgloveServer]:
    """Return a server at a free port, spun in a thread."""
    node = FoxgloveServer(0, context=ros)
    with spinning(ros, node):
        yield node


@contextmanager
def client_of(server: FoxgloveServer) -> Iterator[Client]:
    with connect(server.url, subprotocols=[PROTOCOL]) as connection:
        assert connection.subprotocol == PROTOCOL
        yield Client(connection)


def test_channels_are_cdr_with_the_schemas_of_bags(server: FoxgloveServer, source: Node) -> None:
    publisher = source.create_publisher(Header, 'header', LATCHED)
    publisher.publish(Header())
    with client_of(server) as client:
        client.latest('/header')
        channel = client.channels['/header']
    assert (channel['encoding'], channel['schemaEncoding']) == ('cdr', 'ros2msg')
    assert channel['schemaName'] == 'std_msgs/msg/Header'
    assert channel['schema'] == definition('std_msgs/msg/Header')


def test_latched_message_is_sent_to_late_clients(server: FoxgloveServer, source: Node) -> None:
    publisher = source.create_publisher(Header, 'latched', LATCHED)
    publisher.publish(to_header(7))
    for _ in range(2):
        with client_of(server) as client:
            _, data = client.latest('/latched')
            assert deserialize_message(data, Header) == to_header(7)


def test_messages_bear_simulated_time_where_there_is_a_clock(
    server: FoxgloveServer, source: Node
) -> None:
    clock = source.create_publisher(Clock, '/clock', 10)
    publisher = source.create_publisher(Header, 'header', 10)
    with client_of(server) as client:

        def arrived() -> bool:
            clock.publish(Clock(clock=to_header(5_000_000_001).stamp))
            publisher.publish(Header())
            return any(at == 5_000_000_001 for at, _ in client.messages.get('/header', ()))

        client.until(arrived)
        _, data = client.latest('/header')
        assert deserialize_message(data, Header) == Header()
        assert set(client.times) == {5_000_000_001}
