"""Serves serialized messages to the Foxglove app, through its optional SDK."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.bags.cdr import leading_time
from barc_sim.errors import UserError
from barc_sim.ros import names

try:
    import foxglove
    from foxglove.websocket import Capability, ServerListener
except ModuleNotFoundError:
    foxglove, ServerListener = None, object  # type: ignore[assignment,misc]

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from foxglove.websocket import ChannelView, Client

    from barc_sim.bags.messages import Message
    from barc_sim.bags.metadata import Topic

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
