"""What `barc topics`, `echo` and `param` print, as a hidden node observes the running system.

Messages are written as YAML here because the wheels of ROS lack `rosidl_runtime_py`.
"""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager, suppress
from statistics import fmean, pstdev
from typing import TYPE_CHECKING, Any

import rclpy
import yaml
from rcl_interfaces.msg import ParameterType
from rclpy.exceptions import InvalidTopicNameException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden
from rclpy.validate_full_topic_name import validate_full_topic_name

from barc_sim.cli.parser import did_you_mean
from barc_sim.cli.process import StopSignals
from barc_sim.errors import UserError
from barc_sim.ros.peers import others_here
from barc_sim.ros.process import ros
from barc_sim.ros.topics import message_class, request

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from rcl_interfaces.msg import ParameterDescriptor, ParameterValue
    from rclpy.subscription import Subscription
    from rclpy.task import Future
    from rclpy.topic_endpoint_info import TopicEndpointInfo


#: [s] to wait for something that is not there.
_PATIENCE = 3.0
#: [s] to wait for the first other node: discovery on a busy machine can take this long.
_BUSY = 8.0
#: [s] the same where no other process of this machine takes part: others are on the network.
_ALONE = 1.2
#: [s] without a change, after which the system counts as stable.
_STEADY = 0.5
_POLL_PERIOD = 0.02  #: [s]
#: [s] to wait for a response before the request is sent again. The client can discover a service
#: before the service discovers the client; a response is lost then.
_RESPONSE_PATIENCE = 2.0
_ATTEMPTS = 3
_DEPTH = 10_000  #: messages that can wait for the next poll
#: SafeDumper, in C where libyaml is installed.
_Dumper = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
_MAX_WIDTH = 2**30  #: characters of a line of YAML: none is broken


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
        self.domain = node.context.get_domain_id()
        self._stop = stop

    def pause(self, seconds: float) -> None:
        """Wait for this time [s]."""
        if self._stop.requested.wait(seconds):
            raise KeyboardInterrupt

    def wait_for(self, condition: Callable[[], object], patience: float | None = None) -> bool:
        """Wait for `condition`; return False if it is not true within some seconds."""
        end = time.monotonic() + (_PATIENCE if patience is None else patience)
        while not condition():
            if time.monotonic() > end:
                return False
            self.pause(_POLL_PERIOD)
        return True

    def wait_until_stable(self, read: Callable[[], Any]) -> Any:  # noqa: ANN401 (of any type)
        """Call `read` until its result is not empty and no longer changes; return that."""
        seen, begin = read(), time.monotonic()
        changed = begin
        while (now := time.monotonic()) - changed < (_STEADY if seen else self._patience()):
            if now - begin > _BUSY:
                break
            self.pause(_POLL_PERIOD)
            new = read()
            if new != seen:
                seen, changed = new, time.monotonic()
        return seen

    def topics(self, *, hidden: bool = False) -> dict[str, list[str]]:
        """Return the present topics in order, and their types."""
        return {
            name: types
            for name, types in sorted(self.node.get_topic_names_and_types())
            if hidden or not topic_or_service_is_hidden(name)
        }

    def find_topic(self, name: str) -> str:
        """Wait for a topic with a publisher or a subscriber; return its full name."""
        # Without another node, the topics are this one's own.
        return self._find(name, 'topic', self.topics, lambda: self.topics() if self.nodes() else ())

    def find_node(self, name: str) -> str:
        """Wait for the node `name`; return its full name."""
        return self._find(name, 'node', self.nodes, self.nodes)

    def _find(
        self,
        name: str,
        what: str,
        present: Callable[..., Iterable[str]],
        known: Callable[[], Iterable[str]],
    ) -> str:
        """Wait for what has this name, longer while there is no other node."""
        try:
            full = str(expand_topic_name(name, self.node.get_name(), self.node.get_namespace()))
            validate_full_topic_name(full)
        except (InvalidTopicNameException, ValueError) as error:
            # Without the line of rcl's source, and without the name once more.
            reason = str(error).splitlines()[0].partition(', at /')[0].rstrip(':')
            rule = reason.rpartition('topic name')[2]
            raise UserError(f'{name!r} cannot be a {what}: a name{rule}') from None

        def is_there() -> bool:
            return full in present(hidden=True)

        someone = self.wait_for(lambda: is_there() or self.nodes(hidden=True), self._patience())
        if someone and self.wait_for(is_there):
            return full
        others = [*known()]
        if not others:
            hint = f', nor any other in ROS domain {self.domain}: start a run first'
        else:
            hint = did_you_mean(full, others) or (
                f' in ROS domain {self.domain}: there are {", ".join(others)}'
            )
        raise UserError(f'there is no {what} {full}{hint}')

    def endpoints(self, topic: str) -> tuple[list[TopicEndpointInfo], list[TopicEndpointInfo]]:
        """Return the publishers and the subscriptions of a topic, except those of this node."""
        here = self.node.get_name()
        publishers = self.node.get_publishers_info_by_topic(topic)
        subscriptions = self.node.get_subscriptions_info_by_topic(topic)
        return (
            [end for end in publishers if end.node_name != here],
            [end for end in subscriptions if end.node_name != here],
        )

    def nodes(self, *, hidden: bool = False) -> list[str]:
        """Return the full names of the present nodes, except this one, in order."""
        here = self.node.get_name()
        return sorted(
            f'{namespace.rstrip("/")}/{name}'
            for name, namespace in self.node.get_node_names_and_namespaces()
            if name != here and (hidden or not name.startswith('_'))
        )

    def no_node(self, hint: str = '') -> UserError:
        """Return the error that no node is running."""
        return UserError(f'no node is running in ROS domain {self.domain}: start a run first{hint}')

    def request(self, send: Callable[[], Future], node: str) -> Any:  # noqa: ANN401 (a service's own)
        """Send a request to `node` and return its response.

        `send` sends it and returns the future of the response.
        """
        for _ in range(_ATTEMPTS):
            future = send()
            end = time.monotonic() + _RESPONSE_PATIENCE
            while time.monotonic() < end:
                rclpy.spin_once(self.node, timeout_sec=_POLL_PERIOD)
                if future.done():
                    return future.result()
                self.pause(0.0)
        raise UserError(f'{node} does not respond: it is busy or it hangs; check it, and try again')

    def _patience(self) -> float:
        """Return how long to wait for the first other node [s]."""
        return _BUSY if others_here(self.domain) else _ALONE


def _subscribe(
    observer: GraphObserver, topic: str, kind: type[Any], *, latched: bool = True
) -> Subscription:
    """Subscribe to a topic by the strictest QoS that all its publishers offer.

    `kind` is the class of the messages, `latched` whether old ones count.
    """
    publishers = observer.node.get_publishers_info_by_topic(topic)
    qos = request(publishers, _DEPTH)
    if not publishers:  # none to match yet: request the weakest
        qos.reliability = ReliabilityPolicy.BEST_EFFORT
    if not (publishers and latched):
        qos.durability = DurabilityPolicy.VOLATILE
    return observer.node.create_subscription(kind, topic, lambda _: None, qos)


def _take(subscription: Subscription) -> Iterator[tuple[Any, dict[str, int]]]:
    """Yield the messages that have arrived, each with the middleware's information on it."""
    with subscription.handle:
        for _ in range(_DEPTH):  # what arrives meanwhile could go on for ever
            taken = subscription.handle.take_message(subscription.msg_type, False)
            if taken is None:
                return
            yield taken


def print_messages(
    observer: GraphObserver, name: str, field: str | None, count: int | None, truncate: int | None
) -> None:
    """Print `count` messages of a topic, or those up to a signal; of each only a given `field`."""
    topic = observer.find_topic(name)
    kind = message_class(observer.topics(hidden=True)[topic][0])
    if field is not None:
        field_of(kind(), field.partition('.')[0])  # check it before the first message
    if not observer.wait_for(lambda: observer.node.count_publishers(topic)):
        print(f'barc echo: {topic} has no publisher yet', file=sys.stderr)  # noqa: T201
    subscription = _subscribe(observer, topic, kind)
    with suppress(KeyboardInterrupt):  # the usual end
        while True:
            for message, _ in _take(subscription):
                shown = message if field is None else field_of(message, field)
                print(f'{to_yaml(shown, truncate)}---', flush=True)  # noqa: T201
                count = count and count - 1
                if count == 0:
                    return
            observer.pause(_POLL_PERIOD)


def field_of(message: Any, path: str) -> Any:  # noqa: ANN401 (generated classes)
    """Return the field at `path`, such as `header.stamp.sec`, or `ranges.0` of an array."""
    value = message
    for name in path.split('.'):
        if _is_message(value) and name in _fields(value):
            value = getattr(value, name)
        elif _is_sequence(value) and name.isdecimal() and int(name) < len(value):
            value = value[int(name)]
        else:
            raise UserError(f'there is no field {path!r}: {name!r} is {_alternatives(value)}')
    return value


def _alternatives(value: Any) -> str:  # noqa: ANN401
    if _is_message(value):
        return f'not among {", ".join(_fields(value))}'
    if _is_sequence(value):
        return f'not an index below {len(value)}'
    return f'within a {type(value).__name__}, which has no fields'


def to_yaml(value: Any, truncate: int | None) -> str:  # noqa: ANN401
    """Return a message as a YAML document without `---`; a single field as Python prints it.

    Of longer sequences and strings it has the first `truncate` elements or characters; None: all.
    """
    if not _is_message(value):
        return f'{value}\n'
    return yaml.dump(
        _plain(value, truncate),
        Dumper=_Dumper,
        allow_unicode=True,
        width=_MAX_WIDTH,
        sort_keys=False,
    )


def _plain(value: Any, truncate: int | None) -> Any:  # noqa: ANN401
    """Return `value` in YAML's types."""
    if _is_message(value):
        return {name: _plain(getattr(value, name), truncate) for name in _fields(value)}
    if isinstance(value, bytes):
        value = value.decode('latin-1')
    if isinstance(value, str):
        return value if truncate is None or len(value) <= truncate else f'{value[:truncate]}...'
    if _is_sequence(value):
        shown = [_plain(element, truncate) for element in value[:truncate]]
        return [*shown, '...'] if len(shown) < len(value) else shown
    return value.item() if hasattr(value, 'item') else value  # NumPy's scalars


def _is_message(value: object) -> bool:
    return hasattr(value, 'get_fields_and_field_types')


def _is_sequence(value: object) -> bool:
    """Return whether `value` is a list, tuple, array.array or NumPy array."""
    return hasattr(value, '__len__') and not isinstance(value, (str, bytes))


def _fields(message: Any) -> list[str]:  # noqa: ANN401
    return list(message.get_fields_and_field_types())


def print_topics(
    observer: GraphObserver,
    names: Sequence[str],
    seconds: float | None,
    *,
    full: bool,
    hidden: bool,
) -> None:
    """Print the named topics, or all, with their types and endpoints.

    Over `seconds`, if given, their rates are measured; `full` adds nodes and QoS, and `hidden` the
    hidden topics.
    """
    topics = _named(observer, names) if names else _all(observer, hidden=hidden)
    rates = _rates(observer, topics, seconds) if seconds else {}
    for name, types in topics.items():
        publishers, subscribers = observer.endpoints(name)
        ends = f'{_plural(len(publishers), "publisher")}, {_plural(len(subscribers), "subscriber")}'
        lines = [f'{name} [{", ".join(types)}] {ends}']
        if name in rates:
            lines.append(f'  {rates[name]}')
        if full:
            for end in (*publishers, *subscribers):
                lines += ['', *(f'  {line}' for line in str(end).splitlines())]
            lines.append('')
        print('\n'.join(lines))  # noqa: T201


def _named(observer: GraphObserver, names: Sequence[str]) -> dict[str, list[str]]:
    topics = [observer.find_topic(name) for name in names]
    observer.wait_until_stable(lambda: [_counts(observer, topic) for topic in topics])
    types = observer.topics(hidden=True)
    return {topic: types[topic] for topic in topics}


def _all(observer: GraphObserver, *, hidden: bool) -> dict[str, list[str]]:
    def read() -> list[object]:
        if not observer.nodes(hidden=hidden):
            return []
        return [(topic, _counts(observer, topic)) for topic in observer.topics(hidden=hidden)]

    if not observer.wait_until_stable(read):
        raise observer.no_node()
    return observer.topics(hidden=hidden)


def _counts(observer: GraphObserver, topic: str) -> tuple[int, int]:
    publishers, subscribers = observer.endpoints(topic)
    return len(publishers), len(subscribers)


def _rates(observer: GraphObserver, topics: dict[str, list[str]], seconds: float) -> dict[str, str]:
    """Return by topic the rate of its messages, or why it cannot be measured."""
    rates, subscribed = {}, {}
    for topic, (kind, *_) in topics.items():
        try:
            subscribed[topic] = _subscribe(observer, topic, message_class(kind), latched=False)
        except UserError as error:  # noqa: PERF203
            rates[topic] = str(error)
    observer.pause(seconds)
    for topic, subscription in subscribed.items():
        times = [about['received_timestamp'] for _, about in _take(subscription)]
        rates[topic] = describe_rate(times)
        subscription.destroy()
    return rates


def describe_rate(times: Sequence[int]) -> str:
    """Return the mean rate of events at `times` [ns] in the words of `ros2 topic hz`.

    The window is the number of periods between them.
    """
    if len(times) < 2:  # noqa: PLR2004 (a period has two ends)
        return ('no message', '1 message')[len(times)]
    periods = [(new - old) * 1e-9 for old, new in zip(times, times[1:])]  # noqa: B905, RUF007
    mean = fmean(periods)
    return (
        f'average rate: {1.0 / mean if mean else 0.0:.3f} min: {min(periods):.3f}s '
        f'max: {max(periods):.3f}s std dev: {pstdev(periods):.5f}s window: {len(periods)}'
    )


def _plural(count: int, noun: str) -> str:
    return f'{count} {noun}{"s" * (count != 1)}'


class Parameters:
    """The parameters of a node."""

    def __init__(self, observer: GraphObserver, node: str) -> None:
        """Find the node's services."""
        self.node = observer.find_node(node)  #: its full name
        self._observer = observer
        self._client = AsyncParameterClient(observer.node, self.node)
        if not observer.wait_for(self._client.services_are_ready):
            raise UserError(f'{self.node} has no parameter services')

    def _request(self, send: Any, *arguments: Any) -> Any:  # noqa: ANN401 (a service's own)
        return self._observer.request(lambda: send(*arguments), self.node)

    def names(self) -> list[str]:
        """Return the names of all parameters, in order."""
        return sorted(self._request(self._client.list_parameters).result.names)

    def checked(self, names: Sequence[str]) -> Sequence[str]:
        """Return the names, or all without any; UserError: the node lacks one of them."""
        declared = self.names()
        for name in names:
            if name not in declared:
                hint = did_you_mean(name, declared) or f': it has {", ".join(declared)}'
                raise UserError(f'{self.node} has no parameter {name}{hint}')
        return names or declared

    def values(self, names: Sequence[str] = ()) -> dict[str, ParameterValue]:
        """Return the values of the named parameters, or of all."""
        names = self.checked(names)
        return dict(zip(names, self._request(self._client.get_parameters, names).values))  # noqa: B905

    def descriptor(self, name: str) -> ParameterDescriptor:
        """Return the descriptor of a parameter."""
        return self._request(self._client.describe_parameters, self.checked([name])).descriptors[0]

    def set(self, name: str, value: object) -> str:
        """Set a parameter; return why that is impossible, or ''."""
        try:
            parameter = Parameter(name, value=value)
        except (TypeError, AssertionError, OverflowError):
            return (
                f'it cannot be {value!r}: expected a boolean, a number, a string, or a list of one '
                'of these'
            )
        (result,) = self._request(self._client.set_parameters, [parameter]).results
        why = result.reason or 'without a reason'
        return '' if result.successful else f'{self.node} refused it: {why}'


def print_names(observer: GraphObserver, node: str | None) -> None:
    """Print the names of a node's parameters, or those of all nodes."""
    nodes = [observer.find_node(node)] if node else observer.wait_until_stable(observer.nodes)
    if not nodes:
        raise observer.no_node()
    for each in nodes:
        try:
            names = Parameters(observer, each).names()
        except UserError as error:
            if node:
                raise
            print(f'barc param: {error}', file=sys.stderr)  # noqa: T201 (continue with the others)
            continue
        heading = [] if node else [f'{each}:']
        print('\n'.join([*heading, *(f'  {name}' for name in names)]))  # noqa: T201


def print_value(parameters: Parameters, name: str) -> None:
    """Print the line of `ros2 param get`."""
    value = parameters.values([name])[name]
    if value.type == ParameterType.PARAMETER_NOT_SET:
        print('Parameter not set.')  # noqa: T201
        return
    kind = Parameter.Type(value.type).name.replace('_', ' ').replace('BOOL', 'boolean').capitalize()
    label = kind.replace('array', 'values are') if 'array' in kind else f'{kind} value is'
    print(f'{label}: {parameter_value_to_python(value)}')  # noqa: T201


def set_value(parameters: Parameters, name: str, text: str) -> None:
    """Set a parameter to the value of `text`: in YAML, unless it is declared as a string."""
    descriptor = parameters.descriptor(name)
    is_string = descriptor.type == ParameterType.PARAMETER_STRING
    try:
        value = yaml.load(text, yaml.BaseLoader if is_string else yaml.SafeLoader)  # noqa: S506
    except yaml.YAMLError:
        raise UserError(f'{text!r} is not a value in YAML: a string may need quotes') from None
    if value is None:
        value = text
    if descriptor.type == ParameterType.PARAMETER_DOUBLE and type(value) in (int, str):
        with suppress(ValueError):  # YAML takes 1e-7 for text
            value = float(value)
    if descriptor.read_only:
        setting = f'{parameters.node.rpartition("/")[2]}:{name}:={value}'
        why = f'it is read-only: set it at the start (--ros-args -p {setting})'
    else:
        why = parameters.set(name, value)
    if why:
        raise UserError(f'parameter {name} cannot be set: {why}')
    print('Set parameter successful')  # noqa: T201


def print_file(parameters: Parameters) -> None:
    """Print all parameters of a node as a file; a dot in a name opens a level."""
    nested: dict[str, Any] = {}
    for name, value in parameters.values().items():
        *groups, last = name.split('.')
        level = nested
        for group in groups:
            level = level.setdefault(group, {})
        if value.type != ParameterType.PARAMETER_NOT_SET:
            level[last] = parameter_value_to_python(value)
    content = {parameters.node: {'ros__parameters': nested}}
    text = yaml.safe_dump(content, default_flow_style=False, allow_unicode=True)
    print(text, end='')  # noqa: T201
