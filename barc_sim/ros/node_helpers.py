"""Helpers of our nodes: parameters from a table, messages from records, and refused input."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Twist, Vector3
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from std_msgs.msg import Header

from barc_sim.cli.limits import not_between
from barc_sim.control.driver import DriverInput
from barc_sim.errors import UserError
from barc_sim.interfaces import qos
from barc_sim.interfaces.parameters import ANY
from barc_sim.interfaces.stamps import split_time, to_nanoseconds
from barc_sim.vehicle.parameters import TRACK
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from barc_sim.interfaces.parameters import ParameterDeclaration

Message = TypeVar('Message')
_RECOUNT_NS = 500_000_000


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
    low, high = parameter.between
    kind = type(parameter.default)
    try:
        return node.declare_parameter(
            parameter.name, parameter.default, descriptor(parameter)
        ).value
    except InvalidParameterTypeException as error:
        reason = str(error).split(', expecting')[0]
        value = re.search("to '(.*)' of type 'DOUBLE'", reason)
        if kind is int and value:
            raise UserError(f'{owner}: {not_between(float(value[1]), low, high)}') from None
        raise UserError(
            f'{owner} must be of type {kind.__name__}, such as {parameter.default!r}: {reason}'
        ) from None
    except InvalidParameterValueException as error:
        value = re.search(r'value \((.*)\) for parameter', str(error))
        why = not_between(kind(value[1]), low, high) if value else error
        raise UserError(f'{owner}: {why}') from None


def declare_track(node: Node, track: Track | None = None) -> Track | None:
    """Declare the parameter `track`; return `track`, or else the track that the parameter names."""
    default = TRACK._replace(default=track.name if track else '')
    name = declare(node, [default])[TRACK.name]
    if track is None and name:
        return Track.named(name)
    return track


def frames(node: Node) -> tuple[str, str]:
    """Return the frames of map and car; in the namespace `/car2`, `map` and `car2/base_link`."""
    namespace = node.get_namespace().strip('/')
    return 'map', f'{namespace}/base_link' if namespace else 'base_link'


def fill(message: Message, record: Any) -> Message:  # noqa: ANN401 (a NamedTuple)
    """Copy the fields of `record` to those of `message` by name; return the message."""
    for name, value in zip(record._fields, record, strict=True):
        setattr(message, name, value)
    return message


def to_header(stamp_ns: int, frame_id: str = '') -> Header:
    """Return a header stamped `stamp_ns` [ns]."""
    sec, nanosec = split_time(stamp_ns)
    return Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame_id)


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
        self._node = node
        self._window = -1  # the number of the latest 0.5 s
        self._publishers: set[Publisher] = set()

    def at(self, stamp_ns: int) -> set[Publisher]:
        """Return the publishers with subscriptions, counted once per 0.5 s of the stamps."""
        window = stamp_ns // _RECOUNT_NS
        if window != self._window:
            self._window = window
            self._publishers = {p for p in self._node.publishers if p.get_subscription_count()}
        return self._publishers


@dataclass
class _Output:
    """A message of a node, with its publisher."""

    publisher: Publisher
    message: Any
    fields: Callable[[], Mapping[str, Any]]
    every: int
    states: int = 0  #: states since the first subscription

    def publish(self, stamp: Time) -> None:
        """Publish the message of the state with this stamp, unless it is left out."""
        if self.states % self.every == 0:
            self.message.header.stamp = stamp
            for name, value in self.fields().items():
                setattr(self.message, name, value)
            self.publisher.publish(self.message)
        self.states += 1


class Outputs:
    """Publishes messages for each state; a message without a subscription is not made."""

    def __init__(self, node: Node) -> None:
        """Begin without messages."""
        self._node = node
        self._subscribed = Subscribed(node)
        self._outputs: list[_Output] = []

    def add(
        self,
        topic: str,
        message: Any,  # noqa: ANN401 (of any type)
        fields: Callable[[], Mapping[str, Any]],
        every: int = 1,
    ) -> None:
        """Publish `message` from now on, with what `fields` returns, for one state in `every`."""
        publisher = self._node.create_publisher(type(message), topic, qos.DEFAULT)
        self._outputs.append(_Output(publisher, message, fields, every))

    def publish(self, stamp: Time) -> None:
        """Publish the messages of the state with this stamp."""
        subscribed = self._subscribed.at(to_nanoseconds(stamp))
        for output in self._outputs:
            if output.publisher in subscribed:
                output.publish(stamp)


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
