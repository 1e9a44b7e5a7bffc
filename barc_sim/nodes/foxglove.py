"""The node `foxglove`: serves every topic to the Foxglove app, through its optional SDK."""

from __future__ import annotations

import threading
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from barc_sim.bags import names
from barc_sim.bags.messages import leading_time
from barc_sim.cli.parser import FOXGLOVE_PORT
from barc_sim.errors import UserError
from barc_sim.ros.node_helpers import declare
from barc_sim.ros.topic_subscriptions import TopicSubscriptions
from barc_sim.vehicle.limits import Parameter

try:
    import foxglove
    from foxglove.websocket import Capability, ServerListener
except ModuleNotFoundError:
    foxglove, ServerListener = None, object  # type: ignore[assignment,misc]

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from foxglove.websocket import ChannelView, Client

    from barc_sim.bags.messages import Message
    from barc_sim.bags.recording import Topic

#: [s] between two polls of the topics, while a client is subscribed and while none is.
_PERIOD, _SLOW_PERIOD = 0.02, 0.1
#: [s] between two searches for new topics.
_DISCOVERY_PERIOD = 0.2


_HOST = '127.0.0.1'


class LiveServer:
    """A WebSocket server of the Foxglove app, for this machine only.

    Messages bear the simulated time where there is a `/clock`, else the time of their reception.
    Latched messages are sent again to late clients.

    Attributes
    ----------
    url
        The address to open in the app.
    """

    def __init__(self, port: int) -> None:
        """Serve at `port`; 0: at any that is free.

        Raises
        ------
        UserError
            The SDK is not installed, or the port cannot be had.
        """
        if foxglove is None:
            raise UserError(
                'the Foxglove SDK is not installed in this Python: '
                "python -m pip install 'foxglove-sdk>=0.30,<1'"
            )
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name='barc_sim',
                host=_HOST,
                port=port,
                capabilities=[Capability.Time],
                server_listener=_SubscribeListener(self._on_subscribe),
                context=self._context,
            )
        except RuntimeError as error:
            raise UserError(f'port {port} cannot be had for Foxglove: {error}') from None
        self.url = f'ws://{_HOST}:{self._server.port}'
        self._channels: dict[str, foxglove.Channel] = {}
        self._latched: dict[str, bytes] = {}
        self._asked: list[str] = []
        self._clock: int | None = None

    @property
    def watched(self) -> bool:
        """Whether a client is subscribed to anything."""
        return any(channel.has_sinks() for channel in self._channels.values())

    def offer(self, topic: Topic) -> None:
        """Advertise a topic to clients."""
        if topic.name not in self._channels:
            self._channels[topic.name] = foxglove.Channel(
                topic.name,
                message_encoding='cdr',
                schema=foxglove.Schema(
                    name=topic.type, encoding='ros2msg', data=topic.definition.encode()
                ),
                context=self._context,
            )

    def send(self, messages: Iterable[Message]) -> None:
        """Send messages, in order, to the clients that subscribe to their topics."""
        while self._asked:
            name = self._asked.pop()
            if name in self._latched:
                self._channels[name].log(self._latched[name], log_time=self._clock)
        for message in messages:
            topic = message.topic
            self.offer(topic)
            if topic.name == names.CLOCK:
                self._clock = leading_time(message.data)
                self._server.broadcast_time(self._clock)
            if any(profile['durability'] == 'transient_local' for profile in topic.offered_qos):
                self._latched[topic.name] = message.data
            at = message.received if self._clock is None else self._clock
            self._channels[topic.name].log(message.data, log_time=at)

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()

    def _on_subscribe(self, name: str) -> None:
        # Runs in a thread of the SDK: the latched message follows with the next messages.
        self._asked.append(name)


class _SubscribeListener(ServerListener):
    """Passes the topics of new subscriptions to a callback."""

    def __init__(self, callback: Callable[[str], None]) -> None:
        self._callback = callback

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:  # noqa: ARG002
        """Pass on the topic's name."""
        self._callback(channel.topic)


def is_visible(topic: str, _: object = ()) -> bool:
    """Return whether a topic is not hidden, by its full name."""
    return '/_' not in topic


class FoxgloveServer(Node):
    """Serves all visible topics at `url` on this machine, in a thread of its own.

    Examples
    --------
    >>> import rclpy
    >>> rclpy.init()
    >>> server = FoxgloveServer(port=0)
    >>> server.url.rpartition(':')[0]
    'ws://127.0.0.1'
    >>> server.destroy_node()
    >>> rclpy.shutdown()
    """

    def __init__(self, port: int = FOXGLOVE_PORT, **options: Any) -> None:  # noqa: ANN401
        """Serve at `port`, unless the parameter `port` is set; 0: at any that is free.

        Raises
        ------
        UserError
            The Foxglove SDK is not installed, or the port cannot be had.
        """
        super().__init__('foxglove', **options)
        known = Parameter('port', port, 'its port; 0: any that is free', (0, 65535), read_only=True)
        self._server = LiveServer(declare(self, [known])['port'])
        self.url = self._server.url
        self._topics = TopicSubscriptions(self, is_visible)
        self._discover()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_DISCOVERY_PERIOD, self._discover, clock=steady)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._serve, name='foxglove', daemon=True)
        self._thread.start()

    def destroy_node(self) -> None:
        """Send the waiting messages, close the port, and destroy the node."""
        self._closing.set()
        self._thread.join()
        self._server.close()
        self._topics.close()
        super().destroy_node()

    def _discover(self) -> None:
        for name in self._topics.discover():
            self.get_logger().warning(f'{name} is not served: {self._topics.unknown[name]}')

    def _serve(self) -> None:
        closing = False
        while not closing:
            closing = self._closing.wait(_PERIOD if self._server.watched else _SLOW_PERIOD)
            self._server.send(sorted(self._topics.take(), key=attrgetter('received')))


def announced() -> FoxgloveServer:
    """Return a node, whose address is printed."""
    node = FoxgloveServer()
    print(f'foxglove   {node.url}', flush=True)  # noqa: T201
    return node
