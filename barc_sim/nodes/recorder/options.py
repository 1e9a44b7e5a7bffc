"""What to record, and how: the options of a run and of `python -m barc_sim record` alike."""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass, fields
from math import inf
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_MEBIBYTE = 2**20


@dataclass(frozen=True, kw_only=True)
class Recording:
    """The options of a recording."""

    topics: re.Pattern[str] | None = None  #: found in the names of those wanted; None: all
    exclude: re.Pattern[str] | None = None  #: found in the names of those not wanted
    include_hidden_topics: bool = False
    max_bag_size: float = inf  #: [B] of a file
    max_bag_duration: float = inf  #: [s] of a file
    on_write_error: str = 'stop'  #: or `continue`
    min_free_space: float = 64.0  #: [MiB] that recording leaves free
    use_sim_time: bool = False  #: whether the bag's time is that of `/clock`

    def wants(self, topic: str) -> bool:
        """Return whether a topic is to be recorded, by its full name."""
        if '/_' in topic and not self.include_hidden_topics:
            return False
        if self.exclude and self.exclude.search(topic):
            return False
        return not self.topics or bool(self.topics.search(topic))

    @property
    def reserve(self) -> int:
        """Space that recording leaves free [B]."""
        return int(self.min_free_space * _MEBIBYTE)


def from_options(options: argparse.Namespace) -> Recording:
    """Return what the command line says; what it does not have is as by default."""
    given = vars(options)
    names = {field.name for field in fields(Recording)}
    return Recording(**{name: value for name, value in given.items() if name in names})


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    group = parser.add_argument_group('recording')
    group.add_argument(
        '--topics', type=_pattern, metavar='REGEX', help='only topics in whose name it is found'
    )
    group.add_argument(
        '--exclude', type=_pattern, metavar='REGEX', help='no topic in whose name it is found'
    )
    group.add_argument(
        '--include-hidden-topics',
        action='store_true',
        help="also those with a name part that begins with '_', as services' events have",
    )
    group.add_argument(
        '--max-bag-size',
        type=_positive('bytes'),
        default=inf,
        metavar='BYTES',
        help='begin a new file in the bag where one has reached it',
    )
    group.add_argument(
        '--max-bag-duration',
        type=_positive('seconds'),
        default=inf,
        metavar='S',
        help='begin a new file in the bag where one has reached it',
    )
    group.add_argument(
        '--on-write-error',
        choices=('stop', 'continue'),
        default='stop',
        help="where the bag can't be written: stop, or go on and write again when it can (stop); "
        'the exit code is 1 either way',
    )
    group.add_argument(
        '--min-free-space',
        type=_positive('MiB', zero=True),
        default=Recording.min_free_space,
        metavar='MIB',
        help=f'what recording leaves free on the disk ({Recording.min_free_space:g})',
    )


def _pattern(text: str) -> re.Pattern[str]:
    try:
        return re.compile(text)
    except re.error as error:
        raise argparse.ArgumentTypeError(f'{text!r} is not a regular expression: {error}') from None


def _positive(unit: str, *, zero: bool = False) -> Callable[[str], float]:
    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = -1.0
        if not (0.0 <= value < inf if zero else 0.0 < value < inf):
            raise argparse.ArgumentTypeError(f'{text!r} is not a positive number of {unit}')
        return value

    return convert
