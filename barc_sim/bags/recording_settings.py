"""The settings of a recording: which topics to record, and how."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from barc_sim.bags.directory import MEBIBYTE
from barc_sim.bags.file_format import (
    COMPRESSION_FORMATS,
    STORAGE_PRESETS,
    FileFormat,
    file_format,
)
from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import ParameterDeclaration
from barc_sim.interfaces.topics import CLOCK

if TYPE_CHECKING:
    import re
    from collections.abc import Mapping, Sequence

BAG_DIR = ParameterDeclaration(
    'bag_dir', 'bags', 'folder to make the bag in, as a directory <date>_<time>', read_only=True
)


def selected(
    names: Sequence[str], topics: Sequence[re.Pattern[str]], exclude: Sequence[re.Pattern[str]]
) -> list[str]:
    """Return the names that contain one of `topics`, by default all, and none of `exclude`."""
    return [
        name
        for name in names
        if (not topics or _contains_any(name, topics)) and not _contains_any(name, exclude)
    ]


def _contains_any(name: str, patterns: Sequence[re.Pattern[str]]) -> bool:
    return any(pattern.search(name) for pattern in patterns)


#: [B] The default size of the cache, as in rosbag2.
CACHE_SIZE = 100 * MEBIBYTE


@dataclass(frozen=True, kw_only=True)
class Recording:
    """The settings of a recording; the names and meanings are those of rosbag2, where it has them.

    Raises
    ------
    UserError
        Two settings exclude each other, or one has no such value.
    """

    #: See `wants`; with `topics`, hidden ones are recorded, too.
    topics: Sequence[re.Pattern[str]] = field(default_factory=list)
    exclude: Sequence[re.Pattern[str]] = field(default_factory=list)
    topic_types: Sequence[str] = field(default_factory=list)  #: as in `std_msgs/msg/Header`
    exclude_topic_types: Sequence[str] = field(default_factory=list)
    include_hidden_topics: bool = False
    #: The profile of a topic's subscription instead of what its publishers offer, by topic.
    qos_overrides: Mapping[str, Any] = field(default_factory=dict)
    depth: int = 10_000  #: queue length of a subscription: one second at 10,000 messages a second
    min_free_space: float = 64.0  #: [MiB] to leave free on the disk
    use_sim_time: bool = False  #: stamp messages with `/clock`; record none before the first one
    start_paused: bool = False

    #: [B] A file of this size is closed, and the next message begins a new one; 0: never.
    max_bag_size: int = 0
    #: [s] Likewise once a message is received so long after the first one of a file; 0: never.
    max_bag_duration: float = 0.0
    #: [B] of the messages that wait for the disk in memory. 0: a message is taken from DDS when the
    #: last one is written.
    max_cache_size: int = CACHE_SIZE
    #: Keep only the latest `max_cache_size` of messages, and write them when they are asked for.
    snapshot_mode: bool = False

    compression_format: str = COMPRESSION_FORMATS[0]  #: of chunks, without a preset
    storage_preset_profile: str = STORAGE_PRESETS[0]

    def __post_init__(self) -> None:
        """Check the settings."""
        _check_choice('compression format', self.compression_format, COMPRESSION_FORMATS)
        _check_choice('storage preset profile', self.storage_preset_profile, STORAGE_PRESETS)

        limits = {
            'max_bag_size': self.max_bag_size,
            'max_bag_duration': self.max_bag_duration,
            'max_cache_size': self.max_cache_size,
        }
        for name, limit in limits.items():
            if limit < 0:
                raise UserError(f'{name} {limit} is negative: give 0 or more')
        if self.snapshot_mode and not self.max_cache_size:
            raise UserError('a snapshot needs a cache, whose size is 0: give a larger one')

    def needs(self, topic: str, types: Sequence[str] = ()) -> bool:
        """Return whether to subscribe to a topic: to record it, or for its time."""
        return self.wants(topic, types) or (self.use_sim_time and topic == CLOCK)

    def wants(self, topic: str, types: Sequence[str] = ()) -> bool:
        """Return whether to record a topic.

        By default all topics are recorded, but hidden ones; else those that contain one of `topics`
        or have one of `topic_types`, without those that `exclude` or `exclude_topic_types` names.

        Parameters
        ----------
        topic
            Its full name.
        types
            Its types.
        """
        is_hidden = '/_' in topic
        if is_hidden and not (self.include_hidden_topics or self.topics):
            return False

        if _contains_any(topic, self.exclude) or _common(types, self.exclude_topic_types):
            return False

        selects_all = not self.topics and not self.topic_types
        is_named = _contains_any(topic, self.topics)
        return selects_all or is_named or _common(types, self.topic_types)

    @property
    def reserve(self) -> int:
        """Space to leave free on the disk [B]."""
        return int(self.min_free_space * MEBIBYTE)

    @property
    def file_format(self) -> FileFormat:
        """How the bag's files store their messages."""
        return file_format(self.compression_format, self.storage_preset_profile)


def _common(types: Sequence[str], others: Sequence[str]) -> bool:
    """Return whether a type is in both."""
    return not set(types).isdisjoint(others)


def _check_choice(name: str, value: str, choices: Sequence[str]) -> None:
    if value not in choices:
        names = ', '.join(repr(choice) for choice in choices)
        raise UserError(f'there is no {name} {value!r}: choose one of {names}')
