"""The node `view`: the live page, and what a page that drives asks of the other nodes."""

from __future__ import annotations

import sys
import time
from collections import deque
from functools import partial
from math import isfinite, nan
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ECU, ControllerState, Environment, EZDynBkMdl, PidState, ZDynBkMdl
from geometry_msgs.msg import Twist
from rcl_interfaces.msg import ParameterEvent, ParameterType
from rclpy.node import Node

from barc_sim.cli.parser import call
from barc_sim.control.pid import PID
from barc_sim.control.types import TYPES
from barc_sim.errors import UserError
from barc_sim.nodes.view.node_clients import NodeClients
from barc_sim.page.driver_arbiter import DriverArbiter
from barc_sim.page.facts import SIMULATOR, facts
from barc_sim.page.protocol import TUNABLE, Drive, Pause, Reset, Status, Tune, encode
from barc_sim.page.rows import FIELDS, STATE_FIELDS, Rows
from barc_sim.page.server import ViewServer
from barc_sim.ros import names
from barc_sim.ros.conversions import NANOSECONDS, to_nanoseconds
from barc_sim.ros.endpoints import publisher
from barc_sim.ros.parameters import declare
from barc_sim.ros.polled import PolledCallbackGroup, polled, take
from barc_sim.ros.process import spin
from barc_sim.vehicle.parameter import Parameter

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from barc_sim.control.controller import Controller
    from barc_sim.page.protocol import Request
    from barc_sim.page.rows import Sample
    from barc_sim.page.server import Page


MODES = ('acc', 'teleop')
_TYPES = {
    names.STATE_ERROR: EZDynBkMdl,
    names.ENVIRONMENT: Environment,
    names.ECU: ECU,
    names.PID_STATE: PidState,
    names.CONTROLLER_STATE: ControllerState,
}
#: Messages of a topic that wait for the next look: a page needs no more than the newest of them.
_DEPTH = 16
#: [s] between two looks at the topics, while a page is open and while none is.
_PERIOD, _SLOW_PERIOD = 0.02, 0.1
#: [s] after a state at which to look: it has been answered by then, and the next step is far.
_AFTER = 0.006
_STATUS_PERIOD = 0.25  #: [s]
_PATIENCE = 1.0  #: [s] after which what was not answered is asked again
_GREATEST = 1e12  #: in any unit: what is beyond is none, and sums of it are not finite
_WINDOW = 4  #: status periods over which the real-time factor is measured


class ViewNode(Node):
    """Serves the live page at `url`, and publishes `cmd_vel` while a page drives.

    The executor's thread has next to nothing to do for it: the server's thread looks at the topics
    between two steps, and does all the rest.

    Attributes
    ----------
    url
        The page's address, for the user alone: who knows it may drive.
    seen
        How many states it has taken.
    """

    def __init__(
        self,
        mode: str = 'acc',
        *,
        host: str = '127.0.0.1',
        port: int = 0,
        status: Callable[[], Status] = Status,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Serve the page.

        `status` is asked, from another thread and from the first state on, for what no topic tells.

        Raises
        ------
        UserError
            where a parameter can't be used, or the port can't be had.
        """
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
        self._server = ViewServer(self, values['host'], values['port'])
        self.url = self._server.url
        self._status = status
        self.seen = 0
        self._rows = Rows()
        self._arbiter = DriverArbiter()
        self._simulator: dict[str, Any] = {}
        self._controller: dict[str, Any] = {}
        self._kind: type[Controller] | None = None  # the controller's, once it is known
        self._ask_at: dict[str, float] = {}
        self._paused = False
        self._ended: str | None = None
        self._next_status = 0.0
        self._received: deque[tuple[int, int]] = deque(maxlen=_WINDOW)
        self._newest: tuple[int, int] | None = None

        self._cmd_vel_pub = publisher(self, Twist, names.CMD_VEL)
        self._node_clients = NodeClients(self, self._server.call)
        group = PolledCallbackGroup()
        self._states = polled(self, ZDynBkMdl, names.STATE, _DEPTH, group)
        self._others = {
            topic: polled(self, kind, topic, _DEPTH, group) for topic, kind in _TYPES.items()
        }
        self._events = polled(self, ParameterEvent, '/parameter_events', _DEPTH, group)
        self._server.start()
        self.get_logger().debug(f'a page of the mode {self._mode!r} is served')

    def end(self, reason: str) -> None:
        """Tell the pages, in a sentence, that the run has ended; may be called from any thread."""
        self._server.call(partial(self._end, reason))

    def destroy_node(self) -> None:
        """Close all pages and the port, and destroy the node."""
        self._server.close()
        super().destroy_node()

    # What follows runs in the server's thread.

    def greet(self) -> Iterator[str | bytes]:
        """Tell a page that has opened what is known."""
        yield encode('hello', **self._facts())
        yield self._rows.history()
        if self._ended is not None:
            yield encode('end', reason=self._ended)

    def _facts(self) -> dict[str, Any]:
        return facts(self._mode, self._simulator, self._controller, self._kind or PID)

    def receive(self, page: Page, request: Request) -> None:
        """Do what a page asks for."""
        if isinstance(request, Drive):
            now = time.monotonic()
            if self._arbiter.request(page, request, now):
                self._publish(now)
            else:
                page.send(encode('refused', what='drive', why='another page is driving'))
        elif isinstance(request, Tune):
            self._node_clients.tune(*request, on_done=partial(self._on_tuned, page, request))
        elif isinstance(request, Pause):
            self._node_clients.pause(request.on, on_done=partial(self._on_paused, page, request))
        elif isinstance(request, Reset):
            self._node_clients.reset(on_done=partial(self._on_reset, page))

    def leave(self, page: Page) -> None:
        """Let go what a page held that has gone."""
        self._arbiter.leave(page)
        self._publish(time.monotonic())

    def pulse(self) -> float:
        """Pass on what is new; return after how many seconds to look again."""
        now = time.monotonic()
        self._publish(now)
        if rows := self._look():
            self._server.send(rows)
        if now >= self._next_status:
            self._next_status = now + _STATUS_PERIOD
            self._look_at_parameters()
            if self._ended is None:
                self._send_status()
        return self._until_next() if self._server.pages else _SLOW_PERIOD

    def _look(self) -> bytes:
        others: dict[str, list[Sample]] = {topic: [] for topic in FIELDS}
        for topic, subscription in self._others.items():
            of_controller = topic in _OF_CONTROLLER
            samples = others[names.PID_STATE if of_controller else topic]
            for message, _ in take(subscription, _DEPTH):
                values = _controller_values(message) if of_controller else _VALUES[topic](message)
                if of_controller or _usable(values):
                    samples.append((to_nanoseconds(message.header.stamp), values))
        states = []
        for message, info in take(self._states, _DEPTH):
            values = _STATE_VALUES(message)
            if not _usable(values):
                continue
            stamp = to_nanoseconds(message.header.stamp)
            states.append((stamp, values))
            self._newest = info['received_timestamp'], stamp
        self.seen += len(states)
        return self._rows.add(states, others)

    def _until_next(self) -> float:
        """Return after how long to look again: a little after the state that is expected then."""
        if self._newest is None:
            return _PERIOD
        age = (time.time_ns() - self._newest[0]) / NANOSECONDS
        return min(max(_PERIOD + _AFTER - age, 0.5 * _PERIOD), 1.5 * _PERIOD)

    def _publish(self, now: float) -> None:
        if command := self._arbiter.due(now):
            twist = Twist()
            twist.linear.x, twist.angular.z, brake = command
            twist.linear.z = -brake
            self._cmd_vel_pub.publish(twist)

    def _send_status(self) -> None:
        missed, slipped, paused = self._status() if self._newest else Status()
        for page in self._server.pages:
            driver = self._arbiter.driver
            page.send(
                encode(
                    'status',
                    factor=self._realtime_factor(),
                    missed=missed,
                    slipped=slipped,
                    paused=self._paused if paused is None else paused,
                    driver=None if driver is None else 'you' if driver is page else 'other',
                )
            )
        if self._newest:
            self._received.append(self._newest)

    def _realtime_factor(self) -> float | None:
        """Return simulated seconds per second, of late; None where too little is known."""
        if not self._newest or len(self._received) < _WINDOW:
            return None
        real, simulated = (
            new - old for new, old in zip(self._newest, self._received[0], strict=True)
        )
        if not real:
            return 0.0
        return simulated / real

    def _look_at_parameters(self) -> None:
        if not self._simulator:
            update = partial(self._on_parameters, self._simulator)
            self._ask('vehicle_simulator', SIMULATOR, update)
        if self._kind is None:
            self._ask('controller', ('controller_type',), self._on_controller_type)
        elif not self._controller:
            update = partial(self._on_parameters, self._controller)
            self._ask('controller', (*self._kind.gains, 'speed_reference'), update)
        controller = f'{self.get_namespace().rstrip("/")}/controller'
        for event, _ in take(self._events, _DEPTH):
            if event.node == controller:
                self._on_parameters(self._controller, dict(_tuned(event)))

    def _ask(
        self, node: str, names: Sequence[str], answer: Callable[[dict[str, Any]], None]
    ) -> None:
        """Ask a node for parameters, unless it was asked a moment ago."""
        now = time.monotonic()
        if now >= self._ask_at.get(node, 0.0) and self._node_clients.parameters(node, names, answer):
            self._ask_at[node] = now + _PATIENCE

    def _on_controller_type(self, values: dict[str, Any]) -> None:
        """Take the declaration of the controller's type, or that of the PID if it names none."""
        self._kind = TYPES.get(values.get('controller_type', ''), PID)
        self._ask_at.pop('controller', None)
        self._look_at_parameters()

    def _on_parameters(self, known: dict[str, Any], values: dict[str, Any]) -> None:
        known.update(values)
        self._server.send(encode('facts', **self._facts()))

    def _on_tuned(self, page: Page, request: Tune, done: bool, why: str) -> None:
        if not done:
            page.send(encode('refused', what=request.name, why=why))

    def _on_paused(self, page: Page, request: Pause, done: bool, why: str) -> None:
        if done:
            self._paused = request.on
            self._send_status()
        else:
            page.send(encode('refused', what='pause', why=why))

    def _on_reset(self, page: Page, done: bool, why: str) -> None:
        if not done:
            page.send(encode('refused', what='reset', why=why))

    def _end(self, reason: str) -> None:
        self._ended = reason
        if rows := self._look():
            self._server.send(rows)
        self._server.send(encode('end', reason=reason))


def _usable(values: tuple[float, ...]) -> bool:
    return all(abs(value) <= _GREATEST for value in values)  # NaN is not


def _controller_values(message: PidState | ControllerState) -> tuple[float, ...]:
    """Return the values of `FIELDS['pid_state']`, NaN for those that are unknown or absurd."""
    terms: dict[str, float] = {}
    if isinstance(message, ControllerState):
        terms = dict(zip(message.names, message.values, strict=False))
    values = (terms.get(name, getattr(message, name, nan)) for name in FIELDS[names.PID_STATE])
    return tuple(value if abs(value) <= _GREATEST else nan for value in values)


def _tuned(event: ParameterEvent) -> Iterator[tuple[str, float]]:
    """Yield what the page can show of an event; anybody may have sent it."""
    for parameter in event.changed_parameters:
        value = parameter.value
        if (
            parameter.name in TUNABLE
            and value.type == ParameterType.PARAMETER_DOUBLE
            and isfinite(value.double_value)
        ):
            yield parameter.name, value.double_value


_STATE_VALUES: Callable[[Any], tuple[float, ...]] = attrgetter(*STATE_FIELDS)
_OF_CONTROLLER = (names.PID_STATE, names.CONTROLLER_STATE)
_VALUES: dict[str, Callable[[Any], tuple[float, ...]]] = {
    topic: attrgetter(*fields) for topic, fields in FIELDS.items()
}


def main(args: list[str] | None = None) -> int:
    """Run the node alone, until it is told to stop."""
    return call('view', lambda: spin(_announced, args))


def _announced() -> ViewNode:
    node = ViewNode()
    print(f'view    {node.url}', flush=True)  # noqa: T201 (not into /rosout: it holds the token)
    return node


if __name__ == '__main__':
    sys.exit(main())
