"""The node `foxglove`: serves every topic to the Foxglove app, as the recorder hears them."""

from __future__ import annotations

import sys
import threading
from operator import attrgetter
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from barc_sim.cli.option_types import FOXGLOVE_PORT
from barc_sim.cli.parser import call
from barc_sim.nodes.foxglove.live import LiveServer
from barc_sim.ros.executor.executor import QuickCallbackGroup
from barc_sim.ros.parameters import declare
from barc_sim.ros.process import spin
from barc_sim.ros.topic_subscriptions import Listener
from barc_sim.vehicle.parameter import Parameter

#: [s] between two looks at the topics, while a client is subscribed and while none is.
_PERIOD, _SLOW_PERIOD = 0.02, 0.1
#: [s] between two looks for new topics.
_LOOK_PERIOD = 0.2


def is_visible(topic: str) -> bool:
    """Return whether a topic, by its full name, is not a hidden one."""
    return '/_' not in topic


class FoxgloveServer(Node):
    """Serves all topics but hidden ones, at `url` on this machine; a thread of its own does it."""

    def __init__(self, port: int = FOXGLOVE_PORT, **options: Any) -> None:  # noqa: ANN401
        """Serve at `port`, unless the parameter says otherwise; 0: at any that is free.

        Raises
        ------
        UserError
            where the Foxglove SDK is not installed, or the port can't be had.
        """
        super().__init__('foxglove', **options)
        known = Parameter('port', port, 'its port; 0: any that is free', (0, 65535), read_only=True)
        self._server = LiveServer(declare(self, [known])['port'])
        self.url = self._server.url
        self._listener = Listener(self, is_visible)
        self._look()
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LOOK_PERIOD, self._look, QuickCallbackGroup(), wall)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._serve, name='foxglove', daemon=True)
        self._thread.start()

    def destroy_node(self) -> None:
        """Send what has come, close the port, and destroy the node."""
        self._closing.set()
        self._thread.join()
        self._server.close()
        self._listener.close()
        super().destroy_node()

    def _look(self) -> None:
        for name, _ in self._listener.discover():
            self.get_logger().warning(f'{name} is not served: {self._listener.unknown[name]}')

    def _serve(self) -> None:
        closing = False
        while not closing:
            closing = self._closing.wait(_PERIOD if self._server.watched else _SLOW_PERIOD)
            self._server.send(sorted(self._listener.take(), key=attrgetter('received')))


def main(args: list[str] | None = None) -> int:
    """Run the node alone, until it is told to stop."""
    return call('foxglove', lambda: spin(_announced, args))


def _announced() -> FoxgloveServer:
    node = FoxgloveServer()
    print(f'foxglove   {node.url}', flush=True)  # noqa: T201
    return node


if __name__ == '__main__':
    sys.exit(main())
