"""The node `view`: serves the live page, and passes its requests to the other nodes."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import Twist
from rcl_interfaces.msg import ParameterEvent, ParameterType
from rclpy.node import Node

from barc_sim.errors import UserError
from barc_sim.nodes.view.node_clients import NodeClients
from barc_sim.nodes.view.state_feed import StateFeed
from barc_sim.page.protocol import (
    TUNABLE,
    Drive,
    Status,
)
from barc_sim.page.run_page import RunPage
from barc_sim.ros import names
from barc_sim.ros.endpoints import publisher
from barc_sim.ros.executor import PolledCallbackGroup
from barc_sim.ros.parameters import declare
from barc_sim.ros.polled import polled, take
from barc_sim.vehicle.parameters import Parameter

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from barc_sim.vehicle.road import Road


MODES = ('acc', 'teleop')
_DEPTH = 16  #: of the queue of parameter events


class ViewNode(Node):
    """Serves the live page at `url`, and publishes `cmd_vel` while a page drives.

    The server's thread does nearly all the work, between two steps of the simulator; the executor
    only handles responses of services.

    Parameters
    ----------
    mode, host, port
        Defaults of the parameters.
    status
        Returns the facts that no topic carries; called in the server's thread, from the first
        state on.
    road
        Replaces the road that the simulator's parameter names.
    finish
        Ends the run; without it, the page cannot.
    options
        Those of `rclpy.node.Node`.

    Attributes
    ----------
    url
        The page's address, for the user alone: it gives the right to drive.
    page
        The page: its `end` shows the end of the run, and its `laps` are those so far.

    Raises
    ------
    UserError
        A parameter is invalid, or the port cannot be used.

    Examples
    --------
    >>> import rclpy
    >>> from urllib.request import urlopen
    >>> rclpy.init()
    >>> view = ViewNode('teleop')
    >>> with urlopen(view.url) as answer:
    ...     b'<title>' in answer.read()
    True
    >>> view.destroy_node()
    >>> rclpy.shutdown()
    """

    def __init__(
        self,
        mode: str = 'acc',
        *,
        host: str = '127.0.0.1',
        port: int = 0,
        status: Callable[[], Status] = Status,
        road: Road | None = None,
        finish: Callable[[], None] | None = None,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        super().__init__('view', **options)
        values = declare(
            self,
            [
                Parameter('mode', mode, "what the page shows: 'acc' or 'teleop'", read_only=True),
                Parameter('host', host, 'the address to serve the page at', read_only=True),
                Parameter(
                    'port', port, 'its port; 0: any that is free', (0, 65535), read_only=True
                ),
            ],
        )
        if values['mode'] not in MODES:
            raise UserError(f"mode {values['mode']!r} of the view must be 'acc' or 'teleop'")
        self.page = page = RunPage(
            values['mode'], values['host'], values['port'], status, road, finish
        )
        self._is_page_released = False
        self.url = page.url
        self._cmd_vel_pub = publisher(self, Twist, names.CMD_VEL)
        clients, feed = NodeClients(self, page.call), StateFeed(self)
        group = PolledCallbackGroup()
        self._events = polled(self, ParameterEvent, '/parameter_events', _DEPTH, group)
        page.start(feed, clients, self._drive, self._changes)
        self.get_logger().debug(f'a page of the mode {values["mode"]!r} is served')

    def release_page(self) -> RunPage:
        """Return the page, which has ended, so that it outlives the node."""
        self._is_page_released = True
        return self.page

    def destroy_node(self) -> None:
        """Close all pages and the port unless they are released, and destroy the node."""
        if not self._is_page_released:
            self.page.close()
        super().destroy_node()

    # The server's thread calls the methods below.

    def _drive(self, command: Drive) -> None:
        twist = Twist()
        twist.linear.x, twist.angular.z, brake = command
        twist.linear.z = -brake
        self._cmd_vel_pub.publish(twist)

    def _changes(self) -> Iterator[tuple[str, str, float]]:
        namespace = f'{self.get_namespace().rstrip("/")}/'
        for event, _ in take(self._events, _DEPTH):
            if event.node.startswith(namespace):
                yield from _tuned(event, event.node.removeprefix(namespace))


def _tuned(event: ParameterEvent, node: str) -> Iterator[tuple[str, str, float]]:
    """Yield the valid changes of an event of `node` that the page shows."""
    for parameter in event.changed_parameters:
        value = parameter.value
        if (
            TUNABLE.get(parameter.name) == node
            and value.type == ParameterType.PARAMETER_DOUBLE
            and isfinite(value.double_value)
        ):
            yield node, parameter.name, value.double_value


def announced() -> ViewNode:
    """Return a node, whose page's address is printed."""
    node = ViewNode()
    print(f'view    {node.url}', flush=True)  # noqa: T201 (not into /rosout: it has the token)
    return node
