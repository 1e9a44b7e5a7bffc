"""The options of a recording: which topics to record, and how."""

from __future__ import annotations

import argparse
import re
from dataclasses import fields

from barc_sim.bags.recording_settings import Recording
from barc_sim.cli.parser import number

_MAX_SIZE = 2.0**60  #: [B]


def add_recording_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a recording, in a group of their own."""
    group = parser.add_argument_group('recording')
    add_topic_choice(group, 'record', ", also hidden ones such as '/_service_event'")
    group.add_argument(
        '--min-free-space',
        type=number(0, _MAX_SIZE / 2**20),
        default=Recording.min_free_space,
        metavar='MIB',
        help=f'space to leave free on the disk ({Recording.min_free_space:g} MiB)',
    )


def add_topic_choice(parser: argparse._ActionsContainer, verb: str, hidden: str = '') -> None:
    """Add `--topics` and `--exclude`; each can be given several times."""
    _add_patterns(
        parser,
        '--topics',
        help=f'{verb} only topics whose name contains one of these patterns{hidden}',
    )
    _add_patterns(
        parser,
        '-x',
        '--exclude',
        help=f'{verb} no topics whose name contains one of these patterns',
    )


def _add_patterns(parser: argparse._ActionsContainer, *names: str, help: str) -> None:  # noqa: A002 (argparse's)
    parser.add_argument(
        *names,
        type=pattern,
        nargs='+',
        action='extend',
        default=[],
        metavar='REGEX',
        help=help,
    )


def recording(options: argparse.Namespace) -> Recording:
    """Return the settings on the command line; an option that it lacks has its default."""
    names = [field.name for field in fields(Recording) if hasattr(options, field.name)]
    return Recording(**{name: getattr(options, name) for name in names})


def pattern(text: str) -> re.Pattern[str]:
    """Return a regular expression of the command line."""
    try:
        return re.compile(text)
    except re.error as error:
        raise argparse.ArgumentTypeError(f'{text!r} is not a regular expression: {error}') from None
