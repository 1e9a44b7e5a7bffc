"""Prints topics, messages and parameters of the running system, which a hidden node observes.

Messages are written as YAML here because the wheels of ROS lack `rosidl_runtime_py`.
"""

from __future__ import annotations

import time
from contextlib import contextmanager
from itertools import chain
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.task import Future
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

from barc_sim.bags.metadata import to_yaml
from barc_sim.cli.parser import did_you_mean, show
from barc_sim.cli.process import StopSignals
from barc_sim.cli.yaml_files import from_yaml
from barc_sim.errors import UserError
from barc_sim.ros.executor import QuickExecutor
from barc_sim.ros.peers import full_names, others_here
from barc_sim.ros.process import ros
from barc_sim.ros.topics import message_class, request

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from rclpy.topic_endpoint_info import TopicEndpointInfo


#: [s] to wait for a topic, node or service to appear.
_TIMEOUT = 3.0
#: [s] to wait for the first other node: discovery on a busy machine can take this long.
_FIRST_TIMEOUT = 8.0
#: [s] the same if no other process of this machine is in the domain; other machines may be.
_ALONE_TIMEOUT = 1.2
#: [s] without a change, after which the system counts as stable.
_STABLE_PERIOD = 0.5
_POLL_PERIOD = 0.02  #: [s]
#: [s] to wait for a response before the request is sent again. The client can discover a service
#: before the service discovers the client; a response is lost then.
_RESPONSE_TIMEOUT = 2.0
_ATTEMPTS = 3
_DEPTH = 10_000  #: messages that can wait to be printed
_MAX_SHOWN = 128  #: elements of an array, characters of a string


@contextmanager
def observe(name: str) -> Iterator[GraphObserver]:
    """Start ROS and give an observer with the hidden node `_name`; both end with the block."""
    with StopSignals() as stop, ros([]):
        node = Node(f'_{name}', enable_rosout=False, start_parameter_services=False)
        try:
            yield GraphObserver(node, stop)
        finally:
            node.destroy_node()


class GraphObserver:
    """The ROS graph as `node` discovers it.

    Every wait raises KeyboardInterrupt after a signal that ends the process.
    """

    def __init__(self, node: Node, stop: StopSignals) -> None:
        """Observe with `node`, which no executor spins."""
        self.node = node
        self._domain = f'ROS domain {node.context.get_domain_id()}'
        self.stop = stop

    def pause(self, seconds: float) -> None:
        """Wait for this time [s]."""
        if self.stop.requested.wait(seconds):
            raise KeyboardInterrupt

    def wait_for(self, condition: Callable[[], object], timeout: float | None = None) -> bool:
        """Wait for `condition`; return False if it is not true within `timeout` [s]."""
        end = time.monotonic() + (_TIMEOUT if timeout is None else timeout)
        while not condition():
            if time.monotonic() > end:
                return False
            self.pause(_POLL_PERIOD)
        return True

    def _wait_for_first(self, condition: Callable[[], object]) -> bool:
        """Wait for a condition that the first other node fulfils; return whether it does."""
        has_others = others_here(self.node.context.get_domain_id())
        return self.wait_for(condition, _FIRST_TIMEOUT if has_others else _ALONE_TIMEOUT)

    def wait_until_stable(self, read: Callable[[], Any]) -> Any:  # noqa: ANN401 (of any type)
        """Wait for another node; then call `read` until its result no longer changes; return it."""
        if not self._wait_for_first(self.nodes):
            raise UserError(f'no node is running in {self._domain}: start a run first')

        end = time.monotonic() + _FIRST_TIMEOUT
        result = read()
        while time.monotonic() < end:
            self.pause(_STABLE_PERIOD)
            before = result
            result = read()
            if result == before:
                break
        return result

    def topics(self) -> dict[str, str]:
        """Return the types of the present topics by name, sorted."""
        return {name: types[0] for name, types in sorted(self.node.get_topic_names_and_types())}

    def nodes(self) -> list[str]:
        """Return the full names of the present nodes, without hidden ones, sorted."""
        return sorted(
            f'{namespace.rstrip("/")}/{name}'
            for name, namespace in self.node.get_node_names_and_namespaces()
            if not name.startswith('_')
        )

    def endpoints(self, topic: str) -> tuple[list[TopicEndpointInfo], list[TopicEndpointInfo]]:
        """Return the publishers and the subscriptions of a topic, except those of this node."""
        here = self.node.get_name()
        publishers = self.node.get_publishers_info_by_topic(topic)
        subscriptions = self.node.get_subscriptions_info_by_topic(topic)
        return (
            [each for each in publishers if each.node_name != here],
            [each for each in subscriptions if each.node_name != here],
        )

    def find(self, name: str, kind: str, present: Callable[[], Iterable[str]]) -> str:
        """Wait until the topic or node `name` is `present`; return its full name."""
        full = str(self.node.resolve_topic_name(name))
        has_others = self._wait_for_first(lambda: full in present() or self.nodes())
        if has_others and self.wait_for(lambda: full in present()):
            return full

        hint = f' in {self._domain}: start a run'
        if has_others:
            visible = [each for each in present() if not topic_or_service_is_hidden(each)]
            hint = did_you_mean(full, visible) or f': there are {", ".join(visible)}'
        raise UserError(f'there is no {kind} {full}{hint}')


def print_messages(observer: GraphObserver, name: str, count: int | None) -> None:
    """Print `count` messages of a topic; None: all messages until a signal."""
    topic = observer.find(name, 'topic', observer.topics)
    kind = message_class(observer.topics()[topic])
    if not observer.wait_for(lambda: observer.node.count_publishers(topic)):
        show(f'barc echo: {topic} has no publisher yet', error=True)

    publishers = observer.node.get_publishers_info_by_topic(topic)
    qos = request(publishers, _DEPTH)
    if not publishers:  # the weakest QoS matches any later one
        qos.reliability = ReliabilityPolicy.BEST_EFFORT
        qos.durability = DurabilityPolicy.VOLATILE

    finished = Future()
    left = count

    def on_message(message: Any) -> None:  # noqa: ANN401 (generated classes)
        nonlocal left
        if finished.done():
            return
        show(f'{to_yaml(plain(message))}---')
        left = left and left - 1
        if left == 0:
            finished.set_result(None)

    observer.node.create_subscription(kind, topic, on_message, qos)
    observer.stop.then(lambda: finished.set_result(None))
    with QuickExecutor() as executor:
        executor.add_node(observer.node)
        executor.spin_until_future_complete(finished)


def plain(value: Any) -> Any:  # noqa: ANN401 (generated classes)
    """Return a message in YAML's types; long values are cut."""
    if hasattr(value, 'get_fields_and_field_types'):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        value = value.decode('latin-1')
    if isinstance(value, str):
        return value if len(value) <= _MAX_SHOWN else f'{value[:_MAX_SHOWN]}...'
    if hasattr(value, '__len__'):  # a list, an array of Python's or of NumPy's
        elements = [plain(element) for element in value[:_MAX_SHOWN]]
        return [*elements, '...'] if len(elements) < len(value) else elements
    return value.item() if hasattr(value, 'item') else value  # NumPy's scalars


def print_topics(observer: GraphObserver, names: Sequence[str], *, full: bool) -> None:
    """Print the named topics, or all that are not hidden, with their types and endpoints.

    `full` adds nodes and QoS.
    """
    topics = [observer.find(name, 'topic', observer.topics) for name in names]

    def read() -> dict[str, tuple[Any, ...]]:
        return {
            name: (kind, *map(full_names, observer.endpoints(name)))
            for name, kind in observer.topics().items()
            if (name in topics if topics else not topic_or_service_is_hidden(name))
        }

    for name, (kind, publishers, subscribers) in observer.wait_until_stable(read).items():
        counts = _plural(len(publishers), 'publisher'), _plural(len(subscribers), 'subscriber')
        lines = [f'{name} [{kind}] {", ".join(counts)}']
        if full:
            for endpoint in chain.from_iterable(observer.endpoints(name)):
                lines += ['', *(f'  {line}' for line in str(endpoint).splitlines())]
            lines.append('')
        show('\n'.join(lines))


def _plural(count: int, noun: str) -> str:
    return f'{count} {noun}{"s" * (count != 1)}'


class RemoteParameters:
    """The parameters of a node."""

    def __init__(self, observer: GraphObserver, name: str) -> None:
        """Find the node's services."""
        self.node = observer.find(name, 'node', observer.nodes)  #: its full name
        self._observer = observer
        self._client = AsyncParameterClient(observer.node, self.node)
        if not observer.wait_for(self._client.services_are_ready):
            raise UserError(f'{self.node} has no parameter services')

    def _request(self, send: Any, *arguments: Any) -> Any:  # noqa: ANN401 (a service's own)
        """Call `send`, a method of the client, and return the response."""
        for _ in range(_ATTEMPTS):
            future = send(*arguments)
            rclpy.spin_until_future_complete(
                self._observer.node, future, timeout_sec=_RESPONSE_TIMEOUT
            )
            if future.done():
                return future.result()
            self._observer.pause(0.0)
        raise UserError(
            f'{self.node} does not respond: it is busy or it hangs; check it, and try again'
        )

    def names(self) -> list[str]:
        """Return the names of all parameters, sorted."""
        return sorted(self._request(self._client.list_parameters).result.names)

    def get(self, name: str) -> Any:  # noqa: ANN401 (of any type)
        """Return the value of a parameter."""
        values = self._request(self._client.get_parameters, [name]).values
        if not values:
            names = self.names()
            hint = did_you_mean(name, names) or f': it has {", ".join(names)}'
            raise UserError(f'{self.node} has no parameter {name}{hint}')
        return parameter_value_to_python(values[0])

    def set(self, name: str, text: str) -> None:
        """Set a parameter to `text`, read as YAML unless the present value is a float or string."""
        present = self.get(name)
        kind = type(present)
        try:
            value = kind(text) if kind in (float, str) else from_yaml(text)
            parameter = Parameter(name, value=value)
        except (TypeError, ValueError, AssertionError, OverflowError):
            raise UserError(
                f'parameter {name} cannot be {text!r}: expected a value like {present!r}, its '
                'present one'
            ) from None
        (result,) = self._request(self._client.set_parameters, [parameter]).results
        if not result.successful:
            raise UserError(f'{self.node} refused {text!r}: {result.reason or "without a reason"}')


def print_names(observer: GraphObserver, node: str | None) -> None:
    """Print the names of the parameters of `node`, by default of all nodes."""
    for full_name in [node] if node else observer.wait_until_stable(observer.nodes):
        try:
            names = RemoteParameters(observer, full_name).names()
        except UserError as error:
            if node:
                raise
            show(f'barc param: {error}', error=True)  # and continue with the others
            continue
        heading = [] if node else [f'{full_name}:']
        show('\n'.join([*heading, *(f'  {name}' for name in names)]))
