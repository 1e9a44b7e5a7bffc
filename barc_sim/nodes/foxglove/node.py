"""The node `foxglove`: serves every topic to the Foxglove app."""

from __future__ import annotations

import threading
from operator import attrgetter
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from barc_sim.cli.parser import FOXGLOVE_PORT
from barc_sim.nodes.foxglove.live import LiveServer
from barc_sim.ros.parameters import declare
from barc_sim.ros.topic_subscriptions import TopicSubscriptions
from barc_sim.vehicle.parameters import Parameter

#: [s] between two polls of the topics, while a client is subscribed and while none is.
_PERIOD, _SLOW_PERIOD = 0.02, 0.1
#: [s] between two searches for new topics.
_DISCOVERY_PERIOD = 0.2


def is_visible(topic: str) -> bool:
    """Return whether a topic is not hidden, by its full name.

    Examples
    --------
    >>> is_visible('/car2/z_vhcl'), is_visible('/car2/controller/_service_event')
    (True, False)
    """
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
        for name, _ in self._topics.discover():
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
