"""The node `foxglove`: serves every topic to the Foxglove app, through its optional SDK."""

from __future__ import annotations

import threading
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from barc_sim.bags import names
from barc_sim.bags.messages import Message, leading_time
from barc_sim.cli.parser import FOXGLOVE_PORT, MAX_PORT
from barc_sim.errors import Parameter, UserError
from barc_sim.ros.node_helpers import declare
from barc_sim.ros.topics import TopicSubscriptions

try:
    import foxglove
    from foxglove.websocket import Capability, ServerListener
except ModuleNotFoundError:
    foxglove, ServerListener = None, object  # type: ignore[assignment,misc]

if TYPE_CHECKING:
    from collections.abc import Iterable

    from foxglove.websocket import ChannelView, Client


#: [s] between two polls of the topics, while a client is subscribed and while none is.
_PERIOD, _SLOW_PERIOD = 0.02, 0.1
#: [s] between two searches for new topics.
_DISCOVERY_PERIOD = 0.2
_HOST = '127.0.0.1'


class FoxgloveServer(Node):
    """Serves all visible topics at `url` on this machine, in a thread of its own.

    Messages bear the simulated time where there is a `/clock`, else the time of their reception.
    Latched messages are sent again to late clients.

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
        if foxglove is None:
            raise UserError(
                'the Foxglove SDK is not installed in this Python: '
                "python -m pip install 'foxglove-sdk>=0.30,<1'"
            )
        super().__init__('foxglove', **options)
        what, between = 'its port; 0: any that is free', (0, MAX_PORT)
        port = declare(self, [Parameter('port', port, what, between, read_only=True)])['port']
        self._channels: dict[str, foxglove.Channel] = {}
        self._latched: dict[str, bytes] = {}
        self._asked: list[str] = []  # topics to which a client has subscribed
        self._time: int | None = None  # [ns] of `/clock`
        self._sdk_context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name='barc_sim',
                host=_HOST,
                port=port,
                capabilities=[Capability.Time],
                server_listener=_Listener(self._asked),
                context=self._sdk_context,
            )
        except RuntimeError as error:
            raise UserError(f'port {port} cannot be had for Foxglove: {error}') from None
        self.url = f'ws://{_HOST}:{self._server.port}'  #: to open in the app
        self._topics = TopicSubscriptions(self, _is_visible)
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
        self._server.stop()
        self._topics.close()
        super().destroy_node()

    def _discover(self) -> None:
        for name in self._topics.discover():
            self.get_logger().warning(f'{name} is not served: {self._topics.unknown[name]}')

    def _serve(self) -> None:
        closing = False
        while not closing:
            is_watched = any(channel.has_sinks() for channel in self._channels.values())
            closing = self._closing.wait(_PERIOD if is_watched else _SLOW_PERIOD)
            messages = map(Message._make, self._topics.take())
            self._send(sorted(messages, key=attrgetter('received')))

    def _send(self, messages: Iterable[Message]) -> None:
        """Send messages, in order, to the clients that subscribe to their topics."""
        while self._asked:
            name = self._asked.pop()
            if name in self._latched:
                self._channels[name].log(self._latched[name], log_time=self._time)
        for message in messages:
            topic = message.topic
            if topic.name not in self._channels:
                schema = foxglove.Schema(
                    name=topic.type, encoding='ros2msg', data=topic.definition.encode()
                )
                self._channels[topic.name] = foxglove.Channel(
                    topic.name, message_encoding='cdr', schema=schema, context=self._sdk_context
                )
            if topic.name == names.CLOCK:
                self._time = leading_time(message.data)
                self._server.broadcast_time(self._time)
            if any(profile['durability'] == 'transient_local' for profile in topic.offered_qos):
                self._latched[topic.name] = message.data
            at = message.received if self._time is None else self._time
            self._channels[topic.name].log(message.data, log_time=at)


def _is_visible(topic: str, _: object = ()) -> bool:
    return '/_' not in topic


class _Listener(ServerListener):
    """Keeps the topics of new subscriptions; called in a thread of the SDK."""

    def __init__(self, asked: list[str]) -> None:
        self._asked = asked

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:  # noqa: ARG002
        self._asked.append(channel.topic)
