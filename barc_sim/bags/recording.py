"""What a recorder records: topics, sizes of files, and what to do when writing fails."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

from barc_sim.vehicle.parameters import Parameter

if TYPE_CHECKING:
    import re

_MEBIBYTE = 2**20
BAG_DIR = Parameter(
    'bag_dir', 'bags', 'folder to make the bag in, as a directory <date>_<time>', read_only=True
)


@dataclass(frozen=True, kw_only=True)
class Recording:
    """The settings of a recording.

    Examples
    --------
    >>> import re
    >>> recording = Recording(topics=re.compile('/car1/.*'))
    >>> recording.wants('/car1/ecu'), recording.wants('/car2/ecu')
    (True, False)
    """

    topics: re.Pattern[str] | None = None  #: record only topics whose name contains it
    exclude: re.Pattern[str] | None = None  #: record no topic whose name contains it
    include_hidden_topics: bool = False
    max_bag_size: float = inf  #: [B] of a file
    max_bag_duration: float = inf  #: [s] of a file
    depth: int = 10_000  #: queue length of a subscription: one second at 10,000 messages a second
    on_write_error: str = 'stop'  #: or `continue`
    min_free_space: float = 64.0  #: [MiB] to leave free on the disk
    use_sim_time: bool = False  #: stamp messages with `/clock`

    def wants(self, topic: str) -> bool:
        """Return whether to record a topic, given its full name."""
        if '/_' in topic and not self.include_hidden_topics:
            return False
        if self.exclude and self.exclude.search(topic):
            return False
        return not self.topics or bool(self.topics.search(topic))

    @property
    def reserve(self) -> int:
        """Space to leave free on the disk [B]."""
        return int(self.min_free_space * _MEBIBYTE)
