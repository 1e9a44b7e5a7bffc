"""The node `foxglove`: serves every topic to the Foxglove app, through its optional SDK."""

from __future__ import annotations

from typing import Any

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
    from foxglove.websocket import Capability
except ModuleNotFoundError:
    foxglove = None  # type: ignore[assignment]

#: [s] between two polls of the topics, two searches for new ones, two times of what is latched.
_PERIOD, _DISCOVERY_PERIOD, _LATCHED_PERIOD = 0.02, 0.2, 1.0
_HOST = '127.0.0.1'


class FoxgloveServer(Node):
    """Serves all visible topics at `url` on this machine.

    Messages bear the simulated time where there is a `/clock`, else the time of their reception.
    Latched messages are sent once a second, as clients come late.
    """

    def __init__(self, port: int = FOXGLOVE_PORT, **options: Any) -> None:  # noqa: ANN401
        """Serve at `port`, unless the parameter `port` is set; 0: at any that is free.

        UserError: the Foxglove SDK is not installed, or the port cannot be had.
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
        self._latched: dict[str, Message] = {}
        self._time: int | None = None  # [ns] of `/clock`
        self._sdk_context = context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name='barc_sim',
                host=_HOST,
                port=port,
                capabilities=[Capability.Time],
                context=context,
            )
        except RuntimeError as error:
            raise UserError(f'port {port} cannot be had for Foxglove: {error}') from None
        self.url = f'ws://{_HOST}:{self._server.port}'  #: to open in the app
        self._topics = TopicSubscriptions(self, lambda topic: '/_' not in topic)
        self._topics.discover()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_DISCOVERY_PERIOD, self._topics.discover, clock=steady)
        self.create_timer(_PERIOD, self._serve, clock=steady)
        self.create_timer(_LATCHED_PERIOD, self._repeat, clock=steady)

    def destroy_node(self) -> None:
        """Send the waiting messages, close the port, and destroy the node."""
        self._serve()
        self._server.stop()
        self._topics.close()
        super().destroy_node()

    def _serve(self) -> None:
        """Send what has arrived, in order."""
        for message in sorted(map(Message._make, self._topics.take()), key=lambda m: m.received):
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
                self._latched[topic.name] = message
            self._send(message)

    def _repeat(self) -> None:
        for message in self._latched.values():
            self._send(message)

    def _send(self, message: Message) -> None:
        at = message.received if self._time is None else self._time
        self._channels[message.topic.name].log(message.data, log_time=at)
