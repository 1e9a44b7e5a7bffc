"""The settings of a recording: which topics to record, and how."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from barc_sim.bags.directory import MEBIBYTE
from barc_sim.interfaces.parameters import ParameterDeclaration
from barc_sim.interfaces.topics import CLOCK

if TYPE_CHECKING:
    import re
    from collections.abc import Sequence

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


@dataclass(frozen=True, kw_only=True)
class Recording:
    """The settings of a recording."""

    #: See `selected`; with `topics`, hidden ones are recorded, too.
    topics: Sequence[re.Pattern[str]] = field(default_factory=list)
    exclude: Sequence[re.Pattern[str]] = field(default_factory=list)
    depth: int = 10_000  #: queue length of a subscription: one second at 10,000 messages a second
    min_free_space: float = 64.0  #: [MiB] to leave free on the disk
    use_sim_time: bool = False  #: stamp messages with `/clock`; record none before the first one

    def needs(self, topic: str) -> bool:
        """Return whether to subscribe to a topic: to record it, or for its time."""
        return self.wants(topic) or (self.use_sim_time and topic == CLOCK)

    def wants(self, topic: str) -> bool:
        """Return whether to record a topic, given its full name."""
        is_hidden = '/_' in topic and not self.topics
        return not is_hidden and bool(selected([topic], self.topics, self.exclude))

    @property
    def reserve(self) -> int:
        """Space to leave free on the disk [B]."""
        return int(self.min_free_space * MEBIBYTE)
