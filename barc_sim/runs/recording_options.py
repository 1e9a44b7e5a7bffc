"""Options of a recording: those of a run, and of `barc record`."""

from __future__ import annotations

import argparse
import re
from dataclasses import fields
from math import inf

from barc_sim.bags.recording import Recording
from barc_sim.cli.parser import number

_MAX_SIZE = 2.0**60  #: [B]
_MAX_DURATION = 1e9  #: [s]


def add_recording_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a recording, in a group of their own."""
    group = parser.add_argument_group('recording')
    group.add_argument(
        '--topics',
        type=_pattern,
        metavar='REGEX',
        help='record only topics whose name contains it',
    )
    group.add_argument(
        '--exclude', type=_pattern, metavar='REGEX', help='record no topic whose name contains it'
    )
    group.add_argument(
        '--include-hidden-topics',
        action='store_true',
        help="record topics with a name part that begins with '_', such as services' events",
    )
    group.add_argument(
        '--max-bag-size',
        type=number(1, _MAX_SIZE),
        default=inf,
        metavar='BYTES',
        help='begin a new file of the bag at this size, exceeded by a chunk of 768 KiB at most',
    )
    group.add_argument(
        '--max-bag-duration',
        type=number(0.001, _MAX_DURATION),
        default=inf,
        metavar='S',
        help='begin a new file of the bag after this time',
    )
    group.add_argument(
        '--on-write-error',
        choices=('stop', 'continue'),
        default='stop',
        help='when the bag cannot be written: stop, or continue and write again when it can be '
        '(stop); the exit code is 1 either way',
    )
    group.add_argument(
        '--min-free-space',
        type=number(0, _MAX_SIZE / 2**20),
        default=Recording.min_free_space,
        metavar='MIB',
        help=f'space to leave free on the disk ({Recording.min_free_space:g})',
    )


def recording(options: argparse.Namespace) -> Recording:
    """Return the settings on the command line; an option that it does not have is the default.

    Examples
    --------
    >>> parser = argparse.ArgumentParser()
    >>> add_recording_options(parser)
    >>> wanted = recording(parser.parse_args(['--exclude', 'camera']))
    >>> wanted.wants('/z_vhcl'), wanted.wants('/camera/image')
    (True, False)
    """
    given = vars(options)
    names = {field.name for field in fields(Recording)}
    return Recording(**{name: value for name, value in given.items() if name in names})


def _pattern(text: str) -> re.Pattern[str]:
    try:
        return re.compile(text)
    except re.error as error:
        raise argparse.ArgumentTypeError(f'{text!r} is not a regular expression: {error}') from None
