"""Prints the messages of a topic as they arrive, as `ros2 topic echo` does."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from barc_sim.cli.parser import whole
from barc_sim.ros.introspection.text import TRUNCATE, Style, field_of, to_csv, to_yaml

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable
    from typing import Any

    from barc_sim.cli.parser import Parser
    from barc_sim.ros.introspection.messages import Messages
    from barc_sim.ros.introspection.observer import GraphObserver
    from barc_sim.ros.polled import Taken

#: [s] between two polls for messages.
_PERIOD = 0.02


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Print the messages of a topic, until Ctrl-C, as `ros2 topic echo` does.'
    parser.add_argument('topic', metavar='TOPIC', help='such as z_vhcl or /car2/z_vhcl')
    count = parser.add_mutually_exclusive_group()
    count.add_argument(
        '--once', dest='count', action='store_const', const=1, help='print one message'
    )
    count.add_argument('-n', dest='count', type=whole(1), metavar='N', help='print N messages')
    parser.add_argument(
        '--field', metavar='FIELD', help='print only this field, such as header.stamp'
    )
    parser.add_argument(
        '--csv', action='store_true', help='print one line of values for each message'
    )
    parser.add_argument('--no-arr', action='store_true', help='print no elements of arrays')
    parser.add_argument('--no-str', action='store_true', help='print no strings')
    length = parser.add_mutually_exclusive_group()
    length.add_argument(
        '-f', '--full-length', action='store_true', help='print long arrays and strings in full'
    )
    length.add_argument(
        '-l',
        '--truncate-length',
        type=whole(0),
        default=TRUNCATE,
        metavar='N',
        help=f'print N of their elements and characters ({TRUNCATE})',
    )
    quality = parser.add_argument_group(
        'quality of service', 'default: the strictest that the publishers offer'
    )
    quality.add_argument('--qos-reliability', choices=('reliable', 'best_effort'))
    quality.add_argument('--qos-durability', choices=('transient_local', 'volatile'))
    quality.add_argument(
        '--qos-depth', type=whole(1), metavar='N', help='messages that can wait to be printed'
    )


def run(options: Namespace) -> int:
    """Print messages up to the asked number, or until a signal.

    Raises
    ------
    UserError
        where the topic or field does not exist, or its type is not installed.
    """
    from barc_sim.ros.introspection.observer import observe  # noqa: PLC0415 (slow: not for --help)

    with observe('echo') as observer:
        return _echo(observer, options)


def _echo(observer: GraphObserver, options: Namespace) -> int:
    from rclpy.serialization import deserialize_message  # noqa: PLC0415

    from barc_sim.ros.introspection.messages import DEPTH, Messages, message_class, quality  # noqa: PLC0415

    topic = observer.find_topic(options.topic)
    kind = message_class(observer.topics(hidden=True)[topic][0])
    text = _text(options)
    if options.field is not None:
        field_of(kind(), options.field.partition('.')[0])  # check it before the first message
    if not observer.wait_for(lambda: observer.node.count_publishers(topic)):
        print(f'barc echo: {topic} has no publisher yet', file=sys.stderr)  # noqa: T201
    messages = Messages(
        observer.node,
        topic,
        kind,
        quality(
            observer.node,
            topic,
            depth=options.qos_depth or DEPTH,
            reliability=options.qos_reliability,
            durability=options.qos_durability,
        ),
    )
    with suppress(KeyboardInterrupt):  # the usual end
        _print(
            observer, messages, lambda taken: text(deserialize_message(taken.data, kind)), options
        )
    return 0


def _print(
    observer: GraphObserver, messages: Messages, text: Callable[[Taken], str], options: Namespace
) -> None:
    left, lost = options.count, 0
    while True:
        for taken in messages.take():
            print(text(taken), end='', flush=True)  # noqa: T201
            left = left and left - 1
            if left == 0:
                return
        if messages.lost > lost:
            lost = messages.lost
            print(f'barc echo: {lost} messages were lost', file=sys.stderr)  # noqa: T201
        observer.pause(_PERIOD)


def _text(options: Namespace) -> Callable[[Any], str]:
    """Return a function from a message to the text to print."""
    style = Style(
        truncate=None if options.full_length else options.truncate_length,
        arrays=not options.no_arr,
        strings=not options.no_str,
    )

    def convert(message: Any) -> str:  # noqa: ANN401 (generated classes)
        value = message if options.field is None else field_of(message, options.field)
        return f'{to_csv(value, style)}\n' if options.csv else f'{to_yaml(value, style)}---\n'

    return convert
