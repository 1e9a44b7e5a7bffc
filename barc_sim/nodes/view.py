"""The node `view`: serves the live page, and passes its requests to the other nodes."""

from __future__ import annotations

import time
from collections import deque
from functools import partial
from math import isfinite, nan
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import (
    ECU,
    ControllerState,
    Environment,
    EZDynBkMdl,
    LaneState,
    PidState,
    TrackState,
    ZDynBkMdl,
)
from geometry_msgs.msg import Twist
from nav_msgs.msg import Path
from rcl_interfaces.msg import ParameterEvent, ParameterType
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from std_srvs.srv import SetBool, Trigger

from barc_sim.bags import names
from barc_sim.cli.parser import MAX_PORT
from barc_sim.errors import Parameter, UserError
from barc_sim.page.feed import FIELDS, STATE_FIELDS, Feed, is_valid, values_of
from barc_sim.page.protocol import CONTROLLER, SIMULATOR, TUNABLE, Drive, Pause, Press, Status, Tune
from barc_sim.page.run_page import RunPage
from barc_sim.ros.node_helpers import declare, to_nanoseconds

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from barc_sim.page.feed import Sample
    from barc_sim.page.protocol import Request
    from barc_sim.page.run_page import OnDone
    from barc_sim.simulation.stepper import Stepper
    from barc_sim.vehicle.road import Road

MODES = ('acc', 'teleop')
_TYPES = {
    names.STATE_ERROR: EZDynBkMdl,
    names.ENVIRONMENT: Environment,
    names.ECU: ECU,
    names.PID_STATE: PidState,
    names.CONTROLLER_STATE: ControllerState,
    names.TRACK_STATE: TrackState,
    names.LANE_STATE: LaneState,
}
_STATE_VALUES: Callable[[Any], tuple[float, ...]] = attrgetter(*STATE_FIELDS)
_VALUES: dict[str, Callable[[Any], tuple[float, ...]]] = {
    topic: attrgetter(*fields) for topic, fields in FIELDS.items()
}
#: Messages of a topic that wait for the server's thread, which a busy machine can hold up: those of
#: a third of a second at a real-time factor of 6. In lock-step the newest ones are shown.
_DEPTH = 100
_SERVICES = {
    names.RESET_SIMULATOR: Trigger,
    names.RESET_CONTROLLER: Trigger,
    names.PAUSE_SIMULATOR: SetBool,
    **{f'{node}/set_parameters': SetParameters for node in (CONTROLLER, SIMULATOR)},
    **{f'{node}/get_parameters': GetParameters for node in (CONTROLLER, SIMULATOR)},
}


class ViewNode(Node):
    """Serves the live page at `url`, and publishes `cmd_vel` while a page drives.

    The executor only keeps what arrives; the server's thread does the work, between two steps.
    `url` has the page's token: who has it can drive. `page` is the page: its `end` shows the end of
    the run, and its `laps` are those so far.

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
        """Serve the page; `mode`, `host` and `port` are defaults of the parameters.

        `status` returns the facts that no topic carries; it is called in the server's thread, from
        the first state on. `road` replaces the one that the simulator's parameter names. `finish`
        ends the run; without it, the page cannot.

        Raises
        ------
        UserError
            A parameter is invalid, or the port cannot be used.
        """
        super().__init__('view', **options)
        parameters = [
            Parameter('mode', mode, "what the page shows: 'acc' or 'teleop'"),
            Parameter('host', host, 'the address to serve the page at'),
            Parameter('port', port, 'its port; 0: any that is free', (0, MAX_PORT)),
        ]
        values = declare(self, [each._replace(read_only=True) for each in parameters])
        if values['mode'] not in MODES:
            raise UserError(f"mode {values['mode']!r} of the view must be 'acc' or 'teleop'")
        self.page = page = RunPage(
            values['mode'], values['host'], values['port'], status, road, finish
        )
        self.url = page.url
        self._cmd_vel_pub = self.create_publisher(Twist, names.CMD_VEL, names.QOS)
        clients, self._feed = NodeClients(self, page.call), StateFeed(self)
        self._events: deque[ParameterEvent] = deque(maxlen=_DEPTH)
        self.create_subscription(
            ParameterEvent, '/parameter_events', _keep_in(self._events), _DEPTH
        )
        page.start(self._feed, self._drive, clients.request, clients.parameters, self._changes)

    @property
    def latest(self) -> int:
        """The stamp [ns] of the newest state."""
        return self._feed.latest

    def destroy_node(self) -> None:
        """Close the port, and destroy the node."""
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
        for event in _drained(self._events):
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


def status(stepper: Stepper) -> Status:
    """Return what no topic carries of a simulator in this process."""
    return Status(stepper.missed, stepper.paused)


def _keep_in(queue: deque[Any]) -> Callable[[Any], None]:
    return lambda message: queue.append(message)  # noqa: PLW0108 (rclpy reads its signature)


def _drained(queue: deque[Any]) -> Iterator[Any]:
    """Yield what waits in a queue, which another thread appends to."""
    for _ in range(len(queue)):
        yield queue.popleft()


class StateFeed(Feed):
    """The states of a run with their other messages, from the topics."""

    def __init__(self, node: Node) -> None:
        """Subscribe with `node`."""
        super().__init__()
        self.latest = 0
        self._states_arrived: deque[tuple[int, ZDynBkMdl]] = deque(maxlen=_DEPTH)
        self._arrived: dict[str, deque[Any]] = {topic: deque(maxlen=_DEPTH) for topic in _TYPES}
        node.create_subscription(ZDynBkMdl, names.STATE, self._on_state, _DEPTH)
        for topic, kind in _TYPES.items():
            node.create_subscription(kind, topic, _keep_in(self._arrived[topic]), _DEPTH)
        node.create_subscription(Path, names.PREDICTION, self._on_plan, names.QOS_NEWEST)

    def _on_plan(self, plan: Path) -> None:
        places = [each.pose.position for each in plan.poses]
        self.plan = [(round(place.x, 3), round(place.y, 3)) for place in places]

    def _on_state(self, state: ZDynBkMdl) -> None:
        self._states_arrived.append((time.time_ns(), state))
        self.latest = to_nanoseconds(state.header.stamp)

    def _others(self) -> dict[str, list[Sample]]:
        others: dict[str, list[Sample]] = {topic: [] for topic in FIELDS}
        for topic, arrived in self._arrived.items():
            samples = others[names.PID_STATE if topic == names.CONTROLLER_STATE else topic]
            read = _READERS.get(topic)
            for message in _drained(arrived):
                values = read(message) if read else _VALUES[topic](message)
                if read or is_valid(values):
                    samples.append((to_nanoseconds(message.header.stamp), values))
        return others

    def _states(self) -> list[tuple[int, Sample]]:
        return [
            (received, (to_nanoseconds(state.header.stamp), _STATE_VALUES(state)))
            for received, state in _drained(self._states_arrived)
        ]


def _controller_values(message: PidState | ControllerState) -> tuple[float, ...]:
    terms: dict[str, float] = {}
    if isinstance(message, ControllerState):
        terms = dict(zip(message.names, message.values, strict=False))
    return values_of(names.PID_STATE, lambda name: terms.get(name, getattr(message, name, nan)))


def _lane_values(message: LaneState) -> tuple[float, ...]:
    return values_of(names.LANE_STATE, partial(getattr, message))


#: Of the topics whose values may be NaN.
_READERS: dict[str, Callable[[Any], tuple[float, ...]]] = {
    names.PID_STATE: _controller_values,
    names.CONTROLLER_STATE: _controller_values,
    names.LANE_STATE: _lane_values,
}


class NodeClients:
    """Calls services of `vehicle_simulator` and `controller` without waiting for the responses.

    What takes a response is called in the thread to which `deliver` passes it.
    """

    def __init__(self, node: Node, deliver: Callable[[Callable[[], object]], None]) -> None:
        """Create the clients of `node`."""
        self._node, self._deliver = node, deliver
        self._clients = {
            service: node.create_client(kind, service) for service, kind in _SERVICES.items()
        }

    def request(self, request: Request, on_done: OnDone) -> None:
        """Pass a request of a page to its service."""
        service, message = _call_of(request)

        def on_response(response: Any) -> None:  # noqa: ANN401 (the service's own)
            if isinstance(response, SetParameters.Response):
                on_done(response.results[0].successful, response.results[0].reason)
            else:
                on_done(response.success, response.message)

        if not self._call(service, message, on_response):
            name = self._node.resolve_service_name(service)
            self._deliver(partial(on_done, False, f'no node offers {name}'))

    def parameters(
        self, node: str, wanted: Sequence[str], on_values: Callable[[dict[str, Any]], None]
    ) -> bool:
        """Request parameters of a node; False if it is not there."""

        def on_response(response: GetParameters.Response) -> None:
            # A node that does not have one of the parameters sends no values at all.
            values = map(parameter_value_to_python, response.values)
            on_values(dict(zip(wanted, values, strict=False)))

        return self._call(
            f'{node}/get_parameters', GetParameters.Request(names=wanted), on_response
        )

    def _call(self, service: str, request: Any, on_response: Callable[[Any], None]) -> bool:  # noqa: ANN401
        """Call a service if it is there."""
        client = self._clients[service]
        if not client.service_is_ready():
            return False
        client.call_async(request).add_done_callback(
            lambda future: self._deliver(partial(on_response, future.result()))
        )
        return True


def _call_of(request: Request) -> tuple[str, Any]:
    """Return the service of a page's request, and the message to it."""
    match request:
        case Tune(name, value):
            parameter = RosParameter(name, value=value).to_parameter_msg()
            message = SetParameters.Request(parameters=[parameter])
            return f'{TUNABLE[name]}/set_parameters', message
        case Pause(on):
            return names.PAUSE_SIMULATOR, SetBool.Request(data=on)
        case Press('reset'):
            return names.RESET_SIMULATOR, Trigger.Request()
    return names.RESET_CONTROLLER, Trigger.Request()
