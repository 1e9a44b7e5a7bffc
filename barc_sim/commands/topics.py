"""Command: list the topics of the running system, who is on them, and how often they are heard."""

from __future__ import annotations

import math
import sys
from argparse import ArgumentTypeError
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator, Sequence

    from barc_sim.ros.introspection.observer import Look

PROG = 'barc topics'
#: [s] for which rates are measured.
_WINDOW = 2.0


def parse(argv: Sequence[str] | None = None) -> Namespace:
    """Return the options on the command line."""
    parser = Parser(
        prog=PROG,
        description='List topics with their types, publishers and subscribers, as '
        '`ros2 topic list` and `ros2 topic info` do.',
    )
    parser.add_argument('topics', nargs='*', metavar='TOPIC', help='these only (all)')
    parser.add_argument(
        '-v', '--verbose', action='store_true', help='also the nodes and their quality of service'
    )
    parser.add_argument(
        '--hz',
        nargs='?',
        type=_seconds,
        const=_WINDOW,
        metavar='SECONDS',
        help=f'also measure how often messages arrive, for so long ({_WINDOW:g})',
    )
    parser.add_argument(
        '--include-hidden-topics', action='store_true', help='also those with a _ before a name'
    )
    return parser.parse_args(argv)


def topics(options: Namespace) -> None:
    """Print the topics.

    Raises
    ------
    UserError
        where there is none, or not the one that is asked for.
    """
    from barc_sim.ros.introspection.observer import looking  # noqa: PLC0415 (--help need not wait for ROS)

    with looking('topics') as look:
        chosen = _chosen(look, options)
        rates = _rates(look, chosen, options.hz) if options.hz else {}
        for name, types in chosen.items():
            print('\n'.join(_lines(look, name, types, options, rates.get(name))))  # noqa: T201


def _chosen(look: Look, options: Namespace) -> dict[str, list[str]]:
    if options.topics:
        names = [look.topic(name) for name in options.topics]
        look.settled(lambda: [_counts(look, name) for name in names])
        known = look.topics(hidden=True)
        return {name: known[name] for name in names}
    hidden = options.include_hidden_topics

    def seen() -> list[object]:
        return [(name, _counts(look, name)) for name in look.topics(hidden=hidden)]

    look.settled(lambda: seen() if look.nodes(hidden=hidden) else [])
    if not look.nodes(hidden=hidden):
        raise UserError(f'no node is running in ROS domain {look.domain}: start a run first')
    return look.topics(hidden=hidden)


def _counts(look: Look, topic: str) -> tuple[int, int]:
    publishers, subscribers = look.ends(topic)
    return len(publishers), len(subscribers)


def _rates(look: Look, names: dict[str, list[str]], seconds: float) -> dict[str, str]:
    """Return by topic how often its messages arrive, where its type is installed here."""
    from barc_sim.ros.introspection import rate  # noqa: PLC0415
    from barc_sim.ros.introspection.messages import Messages, message_class, quality  # noqa: PLC0415

    def listen(name: str) -> Messages | str:
        """Listen to a topic from now on, or say why that can't be."""
        try:
            kind = message_class(names[name][0])
            return Messages(look.node, name, kind, quality(look.node, name, durability='volatile'))
        except UserError as error:
            return str(error)

    heard = {name: listen(name) for name in names}
    look.pause(seconds)
    rates = {}
    for name, messages in heard.items():
        if isinstance(messages, str):
            rates[name] = messages
        else:
            rates[name] = rate.in_words([taken.received for taken in messages.take()])
            messages.close()
    return rates


def _lines(
    look: Look, name: str, types: list[str], options: Namespace, rate: str | None
) -> Iterator[str]:
    publishers, subscribers = look.ends(name)
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


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value <= 3600.0:  # noqa: PLR2004
        raise ArgumentTypeError(f'{text!r} is not a number of seconds from 0 to 3600')
    return value


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = parse(argv)
    return call(PROG, lambda: topics(options))


if __name__ == '__main__':
    sys.exit(main())
