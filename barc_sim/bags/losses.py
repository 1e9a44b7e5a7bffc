"""The messages that a recording has lost or left out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

#: The number of a message that the middleware does not number.
UNNUMBERED = 2**64 - 1


class Losses:
    """The lost messages of one topic, for each publisher.

    A publisher numbers its messages one by one. So a gap is a loss, wherever it happened: in the
    subscription, on the way, or in a publisher whose queue was too short. Losses before a
    publisher's first received message, or after its last one, are no gap.
    """

    def __init__(self) -> None:
        self._last: dict[bytes, int] = {}
        self.by_publisher: dict[bytes, int] = {}  #: number of lost messages, by publisher's GID
        self.unnumbered = False  #: whether a message had no number, so that losses are unknown

    def count(self, publisher: bytes, numbers: Sequence[int]) -> None:
        """Count the gaps in the rising `numbers` of a publisher's messages, since the last call."""
        last = self._last.get(publisher, numbers[0] - 1)
        self._last[publisher] = numbers[-1]
        if UNNUMBERED in numbers:
            self.unnumbered = True
            return

        lost = numbers[-1] - last - len(numbers)
        if lost > 0:
            self.by_publisher[publisher] = self.by_publisher.get(publisher, 0) + lost


@dataclass(frozen=True, kw_only=True)
class Missing:
    """The messages that a bag is known to lack."""

    lost: Mapping[str, Mapping[str, int]]  #: number of lost messages, by topic and publishing node
    unknown: Mapping[str, str] = field(default_factory=dict)  #: why more may be lost, by topic
    left_out: Mapping[str, str] = field(default_factory=dict)  #: why it is not recorded, by topic
    before_clock: int = 0  #: number of messages left out, as they came before the first `/clock`

    @property
    def total(self) -> int:
        """The number of messages that are known to be lost."""
        return sum(sum(by_node.values()) for by_node in self.lost.values())

    def as_metadata(self) -> dict[str, str]:
        """Return the entries of a bag's metadata."""
        return {'lost_messages': str(self.total), **dict(self._entries())}

    def _entries(self) -> Iterator[tuple[str, str]]:
        """Yield name and text of each entry."""
        for topic in sorted(self.lost.keys() | self.unknown.keys()):
            texts = []
            by_node = self.lost.get(topic)
            if by_node:
                parts = ', '.join(f'{count} of {node}' for node, count in sorted(by_node.items()))
                texts.append(f'{sum(by_node.values())} ({parts})')
            if topic in self.unknown:
                texts.append(f'unknown: {self.unknown[topic]}')
            if texts:
                yield f'lost {topic}', '; '.join(texts)
        for topic, why in sorted(self.left_out.items()):
            yield f'not recorded {topic}', why
        if self.before_clock:
            yield 'not recorded before /clock', f'{self.before_clock} messages'

    def summary(self, counts: Mapping[str, int], files: int = 1) -> str:
        """Return lines with the numbers of recorded and lost messages, and what is left out.

        `counts` has the number of recorded messages, by topic; they are in so many `files`.
        """
        more = ' or more' if self.unknown else ''
        where = f' in {files} files' if files > 1 else ''
        first = f'recorded {sum(counts.values())} messages{where}, lost {self.total}{more}'
        return '\n'.join([first, *(f'{name}: {text}' for name, text in self._entries())])
