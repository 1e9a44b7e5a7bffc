"""What `barc topics` and `barc echo` print: the endpoints, rates and messages of topics.

The YAML is written here because the wheels of ROS lack `rosidl_runtime_py`; a test compares the two
where both are installed.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from statistics import fmean, pstdev
from typing import TYPE_CHECKING, Any

import yaml
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from barc_sim.errors import UserError
from barc_sim.ros.topics import message_class, request

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rclpy.subscription import Subscription

    from barc_sim.ros.observer import GraphObserver

#: Elements of a long sequence and characters of a long string that are shown.
TRUNCATE = 128
#: SafeDumper, in C where libyaml is installed.
_Dumper = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
_ENDLESS = 2**30
_DEPTH = 10_000  #: messages that can wait for the next poll
_PERIOD = 0.02  #: [s] between two polls for messages


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
            observer.pause(_PERIOD)


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


def to_yaml(value: Any, truncate: int | None = TRUNCATE) -> str:  # noqa: ANN401
    """Return a message as a YAML document without `---`; a single field as Python prints it.

    Of longer sequences and strings it has `truncate` elements and characters; None: all.
    """
    if not _is_message(value):
        return f'{value}\n'
    return yaml.dump(
        _plain(value, truncate), Dumper=_Dumper, allow_unicode=True, width=_ENDLESS, sort_keys=False
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
