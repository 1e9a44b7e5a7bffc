"""Helpers of our nodes: parameters from a table, messages from records, and refused input."""

from __future__ import annotations

import re
import time
from collections import Counter
from math import atan2, cos, nan, radians, sin
from typing import TYPE_CHECKING, Any, TypeVar

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist, Vector3
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from std_msgs.msg import Header

from barc_sim.cli.limits import not_between
from barc_sim.control.driver import DriverInput
from barc_sim.errors import UserError
from barc_sim.interfaces import qos
from barc_sim.interfaces.parameters import ANY
from barc_sim.interfaces.stamps import split_time, to_nanoseconds
from barc_sim.vehicle.bike_model import BicycleState
from barc_sim.vehicle.parameters import TRACK
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from barc_sim.interfaces.parameters import ParameterDeclaration
    from barc_sim.vehicle.road import Road

Message = TypeVar('Message')
_RECOUNT_NS = 500_000_000
_NORM_TOLERANCE = 1e-3  #: of the squared norm of a quaternion that is a rotation


def descriptor(parameter: ParameterDeclaration) -> ParameterDescriptor:
    """Return the ROS descriptor of a parameter."""
    message = ParameterDescriptor(description=parameter.description, read_only=parameter.read_only)
    if parameter.between == ANY:
        return message
    low, high = parameter.between
    if isinstance(parameter.default, float):
        message.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    else:
        message.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    return message


def declare(node: Node, parameters: Iterable[ParameterDeclaration]) -> dict[str, Any]:
    """Declare `parameters` on `node` and return their values by name."""
    return {parameter.name: _declare(node, parameter) for parameter in parameters}


def _declare(node: Node, parameter: ParameterDeclaration) -> Any:  # noqa: ANN401 (as rclpy has it)
    owner = f'parameter {parameter.name} of {node.get_name()}'
    between = parameter.between
    try:
        return node.declare_parameter(
            parameter.name, parameter.default, descriptor(parameter)
        ).value
    except InvalidParameterTypeException as error:
        received = str(error).split(', expecting')[0]
        kind = type(parameter.default).__name__
        if kind == 'int' and (value := re.search("to '(.*)' of type 'DOUBLE'", received)):
            raise UserError(f'{owner}: {not_between(float(value[1]), *between)}') from None
        raise UserError(
            f'{owner} must be of type {kind}, such as {parameter.default!r}: {received}'
        ) from None
    except InvalidParameterValueException as error:
        value = re.search(r'value \((.*)\) for parameter', str(error))
        if not value:
            raise UserError(f'{owner}: {error}') from None
        why = not_between(type(parameter.default)(value[1]), *between)
        raise UserError(f'{owner}: {why}') from None


def declare_track(node: Node, track: Track | None = None) -> Track | None:
    """Declare the parameter `track`; return `track`, or else the track that the parameter names."""
    default = TRACK._replace(default=track.name if track else '')
    name = declare(node, [default])[TRACK.name]
    return track or (Track.named(name) if name else None)


def frames(node: Node) -> tuple[str, str]:
    """Return the frames of map and car; in the namespace `/car2`, `map` and `car2/base_link`."""
    prefix = f'{node.get_namespace().strip("/")}/'.lstrip('/')
    return 'map', f'{prefix}base_link'


def fill(message: Message, record: Any) -> Message:  # noqa: ANN401 (a NamedTuple)
    """Copy the fields of `record` to those of `message` by name; return the message."""
    for name, value in zip(record._fields, record, strict=True):
        setattr(message, name, value)
    return message


def to_header(stamp_ns: int, frame_id: str = '') -> Header:
    """Return a header stamped `stamp_ns` [ns]."""
    sec, nanosec = split_time(stamp_ns)
    return Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame_id)


def to_poses(header: Header, poses: Any) -> dict[str, Any]:  # noqa: ANN401 (x, y, psi: arrays)
    """Return the field `poses` of a Path."""
    path = []
    for x, y, psi in zip(*poses, strict=True):
        half = 0.5 * float(psi)
        pose = Pose(position=Point(x=float(x), y=float(y)))
        pose.orientation = Quaternion(z=sin(half), w=cos(half))
        path.append(PoseStamped(header=header, pose=pose))
    return {'poses': path}


def to_state_at_rest(pose: Pose, road: Road) -> BicycleState:
    """Return the state of a car at rest at `pose` on the map; not a number: there is none.

    It undoes the mirror's pose: `x` of the state is along the road's surface, and the heading is in
    its plane. Of the orientation only the direction counts in which the car points on the map.
    """
    x = road.along(pose.position.x)
    theta = radians(road.grade_deg(x))

    q = pose.orientation
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    if not abs(norm - 1.0) < _NORM_TOLERANCE:
        return BicycleState(x, pose.position.y, nan)
    east = 1.0 - 2.0 * (q.y * q.y + q.z * q.z)
    north = 2.0 * (q.x * q.y + q.w * q.z)
    return BicycleState(x, pose.position.y, atan2(north, east / cos(theta)))


def to_driver_input(twist: Twist) -> DriverInput:
    """Return the driver's input in `twist`."""
    return DriverInput(forward=twist.linear.x, turn=twist.angular.z, brake=-twist.linear.z)


def to_twist(request: DriverInput) -> Twist:
    """Return the driver's input `request` as a Twist."""
    return Twist(
        linear=Vector3(x=request.forward, z=-request.brake or 0.0), angular=Vector3(z=request.turn)
    )


class Subscribed:
    """Finds the publishers of a node that have subscriptions: others need no message.

    To count the subscriptions at each state would take a twentieth of a step in lock-step.
    """

    def __init__(self, node: Node) -> None:
        """Count the subscriptions to the publishers of `node`."""
        self._node, self._window = node, -1
        self._publishers: set[Publisher] = set()

    def at(self, stamp_ns: int) -> set[Publisher]:
        """Return the publishers with subscriptions, counted once per 0.5 s of the stamps."""
        if stamp_ns // _RECOUNT_NS != self._window:
            self._window = stamp_ns // _RECOUNT_NS
            self._publishers = {p for p in self._node.publishers if p.get_subscription_count()}
        return self._publishers


class Outputs:
    """Publishes messages for each state; a message without a subscription is not made."""

    def __init__(self, node: Node) -> None:
        """Begin without messages."""
        self._node, self._subscribed = node, Subscribed(node)
        self._outputs: list[tuple[Publisher, Any, Callable[[], Mapping[str, Any]], int]] = []
        self._published: Counter[Publisher] = Counter()

    def add(
        self,
        topic: str,
        message: Any,  # noqa: ANN401 (of any type)
        fields: Callable[[], Mapping[str, Any]],
        every: int = 1,
    ) -> None:
        """Publish `message` from now on, with what `fields` returns, for one state in `every`."""
        publisher = self._node.create_publisher(type(message), topic, qos.DEFAULT)
        self._outputs.append((publisher, message, fields, every))

    def publish(self, stamp: Time) -> None:
        """Publish the messages of the state with this stamp."""
        subscribed = self._subscribed.at(to_nanoseconds(stamp))
        for publisher, message, fields, every in self._outputs:
            if publisher not in subscribed:
                continue
            if self._published[publisher] % every == 0:
                message.header.stamp = stamp
                for name, value in fields().items():
                    setattr(message, name, value)
                publisher.publish(message)
            self._published[publisher] += 1


class RefusedInput:
    """Counts the invalid messages that a node refuses; logs rate-limited warnings.

    The logger's own throttle inspects the stack at each message, which takes 0.3 ms; here a
    suppressed warning costs next to nothing.
    """

    def __init__(self, node: Node) -> None:
        """Warn with the logger of `node`."""
        self.count = 0
        self._logger = node.get_logger()
        self._next: dict[str, float] = {}  # [s] when the next warning `about` this may be logged

    def add(self, describe: Callable[[], str]) -> None:
        """Count a message; `describe` is called only if a warning is logged."""
        self.count += 1
        self.warn(lambda: f'refused {describe()} ({self.count} refused so far)', 'refused')

    def warn(self, sentence: Callable[[], str], about: str = '', period: float = 1.0) -> None:
        """Log what `sentence` returns, at most once in a `period` [s] for what it is `about`.

        Use it for input that is odd, but not refused.
        """
        now = time.monotonic()
        if now >= self._next.get(about, 0.0):
            self._next[about] = now + period
            self._logger.warning(sentence())
