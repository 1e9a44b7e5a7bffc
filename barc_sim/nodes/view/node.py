"""The node `view`: serves the live page, and passes its requests to the other nodes."""

from __future__ import annotations

import sys
import time
from functools import partial
from math import isfinite
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import Twist
from rcl_interfaces.msg import ParameterEvent, ParameterType
from rclpy.node import Node

from barc_sim.cli.parser import call
from barc_sim.control.pid import PID
from barc_sim.control.types import TYPES
from barc_sim.errors import UserError
from barc_sim.nodes.view.node_clients import NodeClients
from barc_sim.nodes.view.state_feed import StateFeed
from barc_sim.page.driver_arbiter import DriverArbiter
from barc_sim.page.facts import SIMULATOR, facts
from barc_sim.page.protocol import (
    OTHERS,
    TUNABLE,
    Drive,
    Pause,
    Reset,
    ResetController,
    Status,
    Tune,
    encode,
)
from barc_sim.page.server import ViewServer
from barc_sim.ros import names
from barc_sim.ros.endpoints import publisher
from barc_sim.ros.executor import PolledCallbackGroup
from barc_sim.ros.parameters import declare
from barc_sim.ros.polled import polled, take
from barc_sim.ros.process import spin
from barc_sim.vehicle.parameters import Parameter

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from barc_sim.control.controller import Controller
    from barc_sim.page.laps import Laps
    from barc_sim.page.protocol import Request
    from barc_sim.page.server import Page
    from barc_sim.vehicle.road import Road


MODES = ('acc', 'teleop')
_DEPTH = 16  #: of the queue of parameter events
_SLOW_PERIOD = 0.1  #: [s] between two polls while no page is open
_STATUS_PERIOD = 0.25  #: [s]
_RETRY_AFTER = 1.0  #: [s] after which an unanswered request is repeated


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
    options
        Those of `rclpy.node.Node`.

    Attributes
    ----------
    url
        The page's address, for the user alone: it gives the right to drive.

    Raises
    ------
    UserError
        A parameter is invalid, or the port cannot be used.
    """

    def __init__(
        self,
        mode: str = 'acc',
        *,
        host: str = '127.0.0.1',
        port: int = 0,
        status: Callable[[], Status] = Status,
        road: Road | None = None,
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
        self._mode = values['mode']
        self._status = status
        self._road = road
        self._arbiter = DriverArbiter()
        self._simulator: dict[str, Any] = {}
        self._controller: dict[str, Any] = {}
        self._kind: type[Controller] | None = None  # of the controller, once it is known
        self._retry_at: dict[str, float] = {}
        self._paused = False
        self._ended: str | None = None  # the message of the end
        self._next_status = 0.0
        self._server = ViewServer(self, values['host'], values['port'])
        self.url = self._server.url

        self._cmd_vel_pub = publisher(self, Twist, names.CMD_VEL)
        self._node_clients = NodeClients(self, self._server.call)
        self._feed = StateFeed(self)
        group = PolledCallbackGroup()
        self._events = polled(self, ParameterEvent, '/parameter_events', _DEPTH, group)
        self._server.start()
        self.get_logger().debug(f'a page of the mode {self._mode!r} is served')

    @property
    def seen(self) -> int:
        """Number of states taken."""
        return self._feed.seen

    @property
    def laps(self) -> Laps:
        """The laps of the run so far."""
        return self._feed.laps

    def end(self, reason: str, bag: str = '') -> None:
        """Show the pages the end of the run, its reason and `bag`, the bag's path.

        May be called from any thread.
        """
        self._server.call(partial(self._end, reason, bag))

    def destroy_node(self) -> None:
        """Close all pages and the port, and destroy the node."""
        self._server.close()
        super().destroy_node()

    # The server's thread calls the methods below.

    def greet(self) -> Iterator[str | bytes]:
        """Yield the messages for a new page."""
        yield encode('hello', **self._facts())
        yield self._feed.history()
        if self._ended is not None:
            yield self._ended

    def _facts(self) -> dict[str, Any]:
        kind = self._kind or PID
        return facts(self._mode, self._simulator, self._controller, kind, self._road)

    def receive(self, page: Page, request: Request) -> None:
        """Handle a page's request."""
        if isinstance(request, Drive):
            now = time.monotonic()
            if self._arbiter.request(page, request, now):
                self._publish(now)
            else:
                page.send(encode('refused', what='drive', why='another page is driving'))
        elif isinstance(request, Tune):
            on_done = partial(self._on_done, page, request.name)
            self._node_clients.tune(*request, on_done=on_done)
        elif isinstance(request, Pause):
            on_done = partial(self._on_paused, page, request)
            self._node_clients.pause(request.on, on_done=on_done)
        elif isinstance(request, Reset):
            self._node_clients.reset(on_done=partial(self._on_done, page, 'reset'))
        elif isinstance(request, ResetController):
            on_done = partial(self._on_done, page, 'reset the controller')
            self._node_clients.reset_controller(on_done=on_done)

    def leave(self, page: Page) -> None:
        """Release the keys of a page that has closed."""
        self._arbiter.leave(page)
        self._publish(time.monotonic())

    def pulse(self) -> float:
        """Send new rows and, in turn, the status; return the time to the next call [s]."""
        now = time.monotonic()
        self._publish(now)
        if rows := self._feed.poll():
            self._server.send(rows)
        if now >= self._next_status:
            self._next_status = now + _STATUS_PERIOD
            self._update_parameters()
            if self._ended is None and self._server.pages:
                self._send_status()
        return self._feed.until_next() if self._server.pages else _SLOW_PERIOD

    def _publish(self, now: float) -> None:
        if command := self._arbiter.due(now):
            twist = Twist()
            twist.linear.x, twist.angular.z, brake = command
            twist.linear.z = -brake
            self._cmd_vel_pub.publish(twist)

    def _send_status(self) -> None:
        missed, slipped, paused = self._status() if self.seen else Status()
        laps = self.laps.facts()
        factor, driver = self._feed.realtime_factor(), self._arbiter.driver
        for page in self._server.pages:
            page.send(
                encode(
                    'status',
                    factor=factor,
                    missed=missed,
                    slipped=slipped,
                    laps=laps,
                    paused=self._paused if paused is None else paused,
                    driver=None if driver is None else 'you' if driver is page else 'other',
                )
            )

    def _update_parameters(self) -> None:
        """Request the parameters that are unknown, and take those that have changed."""
        if not self._simulator:
            on_values = partial(self._on_parameters, self._simulator)
            self._request('vehicle_simulator', SIMULATOR, on_values)
        if self._kind is None:
            self._request('controller', ('controller_type',), self._on_controller_type)
        elif not self._controller:
            on_values = partial(self._on_parameters, self._controller)
            self._request('controller', (*self._kind.gains, *OTHERS), on_values)
        controller = f'{self.get_namespace().rstrip("/")}/controller'
        for event, _ in take(self._events, _DEPTH):
            if event.node == controller:
                self._on_parameters(self._controller, dict(_tuned(event)))

    def _request(
        self, node: str, parameters: Sequence[str], on_values: Callable[[dict[str, Any]], None]
    ) -> None:
        """Request parameters of a node, unless a recent request is still unanswered."""
        now = time.monotonic()
        if now >= self._retry_at.get(node, 0.0) and self._node_clients.parameters(
            node, parameters, on_values
        ):
            self._retry_at[node] = now + _RETRY_AFTER

    def _on_controller_type(self, values: dict[str, Any]) -> None:
        """Take the declaration of the controller's type; the PID's if it names none."""
        self._kind = TYPES.get(values.get('controller_type', ''), PID)
        self._retry_at.pop('controller', None)
        self._update_parameters()

    def _on_parameters(self, known: dict[str, Any], values: dict[str, Any]) -> None:
        known.update(values)
        self._server.send(encode('facts', **self._facts()))

    def _on_done(self, page: Page, what: str, done: bool, why: str) -> None:
        if not done:
            page.send(encode('refused', what=what, why=why))

    def _on_paused(self, page: Page, request: Pause, done: bool, why: str) -> None:
        if done:
            self._paused = request.on
            self._send_status()
        self._on_done(page, 'pause', done, why)

    def _end(self, reason: str, bag: str) -> None:
        if rows := self._feed.poll():
            self._server.send(rows)
        self._ended = encode(
            'end',
            reason=reason,
            bag=bag,
            laps=self.laps.facts(),
            stretches=self.laps.stretches(),
        )
        self._server.send(self._ended)


def _tuned(event: ParameterEvent) -> Iterator[tuple[str, float]]:
    """Yield the valid changes of an event that the page shows; any node may have sent it."""
    for parameter in event.changed_parameters:
        value = parameter.value
        if (
            parameter.name in TUNABLE
            and value.type == ParameterType.PARAMETER_DOUBLE
            and isfinite(value.double_value)
        ):
            yield parameter.name, value.double_value


def main(args: list[str] | None = None) -> int:
    """Run the node alone, until a signal stops it."""
    return call('view', lambda: spin(_announced, args))


def _announced() -> ViewNode:
    node = ViewNode()
    print(f'view    {node.url}', flush=True)  # noqa: T201 (not into /rosout: it has the token)
    return node


if __name__ == '__main__':
    sys.exit(main())
