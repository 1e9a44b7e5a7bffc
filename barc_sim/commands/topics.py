"""Lists the topics of the running system with their endpoints and rates."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.cli.parser import number
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator

    from barc_sim.cli.parser import Parser
    from barc_sim.ros.introspection.observer import GraphObserver

#: [s] over which rates are measured.
_WINDOW = 2.0


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'List topics with their types, publishers and subscribers, as `ros2 topic list` and '
        '`ros2 topic info` do.'
    )
    parser.add_argument('topics', nargs='*', metavar='TOPIC', help='these only (all)')
    parser.add_argument(
        '-v', '--verbose', action='store_true', help='also the nodes and their quality of service'
    )
    parser.add_argument(
        '--hz',
        nargs='?',
        type=number(0.001, 3600.0),
        const=_WINDOW,
        metavar='SECONDS',
        help=f'also measure the rate of messages for this long ({_WINDOW:g})',
    )
    parser.add_argument(
        '--include-hidden-topics', action='store_true', help='also hidden topics: those with _'
    )


def run(options: Namespace) -> None:
    """Print the topics.

    Raises
    ------
    UserError
        where there is no topic, or a named one does not exist.
    """
    from barc_sim.ros.introspection.observer import observe  # noqa: PLC0415 (slow: not for --help)

    with observe('topics') as observer:
        chosen = _chosen(observer, options)
        rates = _rates(observer, chosen, options.hz) if options.hz else {}
        for name, types in chosen.items():
            print('\n'.join(_lines(observer, name, types, options, rates.get(name))))  # noqa: T201


def _chosen(observer: GraphObserver, options: Namespace) -> dict[str, list[str]]:
    if options.topics:
        names = [observer.find_topic(name) for name in options.topics]
        observer.wait_until_stable(lambda: [_counts(observer, name) for name in names])
        types = observer.topics(hidden=True)
        return {name: types[name] for name in names}
    hidden = options.include_hidden_topics

    def seen() -> list[object]:
        return [(name, _counts(observer, name)) for name in observer.topics(hidden=hidden)]

    observer.wait_until_stable(lambda: seen() if observer.nodes(hidden=hidden) else [])
    if not observer.nodes(hidden=hidden):
        raise UserError(f'no node is running in ROS domain {observer.domain}: start a run first')
    return observer.topics(hidden=hidden)


def _counts(observer: GraphObserver, topic: str) -> tuple[int, int]:
    publishers, subscribers = observer.endpoints(topic)
    return len(publishers), len(subscribers)


def _rates(observer: GraphObserver, names: dict[str, list[str]], seconds: float) -> dict[str, str]:
    """Return by topic the rate of its messages, or why it cannot be measured."""
    from barc_sim.ros.introspection.messages import (  # noqa: PLC0415
        Messages,
        describe_rate,
        message_class,
        quality,
    )

    def subscribe(name: str) -> Messages | str:
        """Return the messages from now on, or why there can be none."""
        try:
            kind = message_class(names[name][0])
            return Messages(
                observer.node, name, kind, quality(observer.node, name, durability='volatile')
            )
        except UserError as error:
            return str(error)

    subscribed = {name: subscribe(name) for name in names}
    observer.pause(seconds)
    rates = {}
    for name, messages in subscribed.items():
        if isinstance(messages, str):
            rates[name] = messages
        else:
            rates[name] = describe_rate([taken.received for taken in messages.take()])
            messages.close()
    return rates


def _lines(
    observer: GraphObserver, name: str, types: list[str], options: Namespace, rate: str | None
) -> Iterator[str]:
    publishers, subscribers = observer.endpoints(name)
    kinds = ', '.join(types)
    yield (
        f'{name} [{kinds}] {_plural(len(publishers), "publisher")}, '
        f'{_plural(len(subscribers), "subscriber")}'
    )
    if rate:
        yield f'  {rate}'
    if options.verbose:
        for end in (*publishers, *subscribers):
            yield ''
            yield from (f'  {line}' for line in str(end).splitlines())
        yield ''


def _plural(count: int, noun: str) -> str:
    return f'{count} {noun}{"s" * (count != 1)}'
