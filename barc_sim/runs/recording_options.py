"""The options of a recording: which topics to record, and how."""

from __future__ import annotations

import argparse
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

from barc_sim.bags.file_format import COMPRESSION_FORMATS, STORAGE_PRESETS
from barc_sim.bags.qos_overrides import read_qos_overrides
from barc_sim.bags.recording_settings import Recording
from barc_sim.cli.parser import number, whole
from barc_sim.errors import UserError

_MAX_SIZE = 2**60  #: [B]
_MIN_SPLIT = 1024  #: [B] as rosbag2 has it
_MAX_DURATION = 1e9  #: [s]
_TYPE_NAME = re.compile(r'\w+/(msg|srv|action)/\w+')


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

    _add_splitting(group)
    _add_storage(group)


def _add_splitting(parser: argparse._ActionsContainer) -> None:
    """Add when to begin the next file."""
    parser.add_argument(
        '-b',
        '--max-bag-size',
        type=split_size,
        default=Recording.max_bag_size,
        metavar='BYTES',
        help='begin a new file when one has this size (0: never)',
    )

    parser.add_argument(
        '-d',
        '--max-bag-duration',
        type=number(0.0, _MAX_DURATION),
        default=Recording.max_bag_duration,
        metavar='S',
        help='begin a new file when the messages of one last so long [s] (0: never)',
    )


def _add_storage(parser: argparse._ActionsContainer) -> None:
    """Add the cache and the compression."""
    parser.add_argument(
        '--max-cache-size',
        type=whole(0, _MAX_SIZE),
        default=Recording.max_cache_size,
        metavar='BYTES',
        help='memory for messages while the disk is slow; beyond it they are lost, and counted; '
        f'0: they wait in DDS ({Recording.max_cache_size})',
    )

    parser.add_argument(
        '--compression-format',
        choices=COMPRESSION_FORMATS,
        default=Recording.compression_format,
        help=f'compression of the messages ({Recording.compression_format})',
    )
    parser.add_argument(
        '--storage-preset-profile',
        choices=[name for name in STORAGE_PRESETS if name],
        default=Recording.storage_preset_profile,
        help="rosbag2's settings of an MCAP file; they replace --compression-format",
    )


def add_selection_options(parser: argparse._ActionsContainer) -> None:
    """Add the choice of topics by type, and hidden ones."""
    _add_types(parser, '--topic-types', 'record topics of these types, beside those of --topics')
    _add_types(parser, '--exclude-topic-types', 'record no topics of these types')
    parser.add_argument(
        '--include-hidden-topics',
        action='store_true',
        help="record hidden topics, too: feedback of actions, events of services, '/_…'",
    )


def _add_types(parser: argparse._ActionsContainer, name: str, description: str) -> None:
    parser.add_argument(
        name,
        type=type_name,
        nargs='+',
        action='extend',
        default=[],
        metavar='TYPE',
        help=f'{description}, as in std_msgs/msg/String',
    )


def add_control_options(parser: argparse._ActionsContainer) -> None:
    """Add when messages are written."""
    parser.add_argument(
        '--start-paused', action='store_true', help='begin paused; a service or a key resumes'
    )
    parser.add_argument(
        '--snapshot-mode',
        action='store_true',
        help='keep the newest messages in memory, up to --max-cache-size, and write them at each '
        'call of the service bag_recorder/snapshot',
    )


def add_qos_overrides(parser: argparse._ActionsContainer, verb: str) -> None:
    """Add the file with the quality of service of topics."""
    parser.add_argument(
        '--qos-profile-overrides-path',
        dest='qos_overrides',
        type=qos_overrides,
        default={},
        metavar='FILE',
        help=f'YAML file with the quality of service to {verb} topics with',
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


def split_size(text: str) -> int:
    """Return the size of a file [B] on the command line; 0: there is no limit."""
    size = whole(0, _MAX_SIZE)(text)
    if 0 < size < _MIN_SPLIT:
        raise argparse.ArgumentTypeError(f'{size} is too small: give 0 or at least {_MIN_SPLIT}')
    return size


def pattern(text: str) -> re.Pattern[str]:
    """Return a regular expression of the command line."""
    try:
        return re.compile(text)
    except re.error as error:
        raise argparse.ArgumentTypeError(f'{text!r} is not a regular expression: {error}') from None


def key_and_value(text: str) -> tuple[str, str]:
    """Return the name and the text of an entry of the bag's metadata on the command line."""
    key, separator, value = text.partition('=')
    if not (key and separator):
        raise argparse.ArgumentTypeError(f'{text!r} is not KEY=VALUE')
    return key, value


def type_name(text: str) -> str:
    """Return the name of a type on the command line."""
    if not _TYPE_NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f'{text!r} is not the name of a type, as in std_msgs/msg/String'
        )
    return text


def qos_overrides(text: str) -> dict[str, dict[str, Any]]:
    """Return the quality of service of topics in a file that the command line names."""
    try:
        return read_qos_overrides(Path(text))
    except UserError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
