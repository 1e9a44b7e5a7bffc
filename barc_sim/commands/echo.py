"""Command: print the messages of a topic as they arrive, as `ros2 topic echo` does."""

from __future__ import annotations

import sys
from argparse import ArgumentTypeError
from contextlib import suppress
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call
from barc_sim.ros.introspection.text import TRUNCATE, Style, field_of, to_csv, to_yaml

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence
    from typing import Any

    from barc_sim.ros.introspection.messages import Messages
    from barc_sim.ros.introspection.observer import Look
    from barc_sim.ros.serialized import Taken

PROG = 'barc echo'
#: [s] between two looks at what has arrived.
_PERIOD = 0.02


def parse(argv: Sequence[str] | None = None) -> Namespace:
    """Return the options on the command line."""
    parser = Parser(
        prog=PROG,
        description='Print the messages of a topic, until Ctrl-C, as `ros2 topic echo` does.',
    )
    parser.add_argument('topic', metavar='TOPIC', help='such as z_vhcl or /car2/z_vhcl')
    count = parser.add_mutually_exclusive_group()
    count.add_argument(
        '--once', dest='count', action='store_const', const=1, help='print one message'
    )
    count.add_argument(
        '-n', dest='count', type=_whole(1), metavar='N', help='print so many messages'
    )
    parser.add_argument('--field', metavar='FIELD', help='print this only, such as header.stamp')
    parser.add_argument('--csv', action='store_true', help='print a line of values for a message')
    parser.add_argument('--no-arr', action='store_true', help='print no elements of arrays')
    parser.add_argument('--no-str', action='store_true', help='print no strings')
    length = parser.add_mutually_exclusive_group()
    length.add_argument(
        '-f', '--full-length', action='store_true', help='print all of long arrays and strings'
    )
    length.add_argument(
        '-l',
        '--truncate-length',
        type=_whole(0),
        default=TRUNCATE,
        metavar='N',
        help=f'print so many of their elements and characters ({TRUNCATE})',
    )
    quality = parser.add_argument_group('quality of service', 'without these, the most on offer')
    quality.add_argument('--qos-reliability', choices=('reliable', 'best_effort'))
    quality.add_argument('--qos-durability', choices=('transient_local', 'volatile'))
    quality.add_argument(
        '--qos-depth', type=_whole(1), metavar='N', help='messages that may wait to be printed'
    )
    return parser.parse_args(argv)


def echo(options: Namespace) -> int:
    """Print messages until there were enough, or the process is asked to stop.

    Raises
    ------
    UserError
        where there is no such topic or field, or its type isn't installed.
    """
    from barc_sim.ros.introspection.observer import looking  # noqa: PLC0415 (--help need not wait for ROS)

    with looking('echo') as look:
        return _echo(look, options)


def _echo(look: Look, options: Namespace) -> int:
    from rclpy.serialization import deserialize_message  # noqa: PLC0415

    from barc_sim.ros.introspection.messages import DEPTH, Messages, message_class, quality  # noqa: PLC0415

    topic = look.topic(options.topic)
    kind = message_class(look.topics(hidden=True)[topic][0])
    text = _text(options)
    if options.field is not None:
        field_of(kind(), options.field.partition('.')[0])  # before a message has to arrive
    if not look.until(lambda: look.node.count_publishers(topic)):
        print(f'{PROG}: nobody publishes {topic} yet', file=sys.stderr)  # noqa: T201
    messages = Messages(
        look.node,
        topic,
        kind,
        quality(
            look.node,
            topic,
            depth=options.qos_depth or DEPTH,
            reliability=options.qos_reliability,
            durability=options.qos_durability,
        ),
    )
    with suppress(KeyboardInterrupt):  # which is how it is meant to end
        _print(look, messages, lambda taken: text(deserialize_message(taken.data, kind)), options)
    return 0


def _print(
    look: Look, messages: Messages, text: Callable[[Taken], str], options: Namespace
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
            print(f'{PROG}: {lost} messages were lost', file=sys.stderr)  # noqa: T201
        look.pause(_PERIOD)


def _text(options: Namespace) -> Callable[[Any], str]:
    """Return what turns a message into what is printed."""
    style = Style(
        truncate=None if options.full_length else options.truncate_length,
        arrays=not options.no_arr,
        strings=not options.no_str,
    )

    def convert(message: Any) -> str:  # noqa: ANN401 (generated classes)
        value = message if options.field is None else field_of(message, options.field)
        return f'{to_csv(value, style)}\n' if options.csv else f'{to_yaml(value, style)}---\n'

    return convert


def _whole(least: int) -> Callable[[str], int]:
    def convert(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise ArgumentTypeError(f'{text!r} is not a whole number from {least} on')
        return int(text)

    return convert


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = parse(argv)
    return call(PROG, lambda: echo(options))


if __name__ == '__main__':
    sys.exit(main())
