"""Counts the messages that a subscription missed, by the numbers that publishers give them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

#: Of a message that the middleware has not numbered.
UNNUMBERED = 2**64 - 1


class Losses:
    """Of one topic, for each publisher: what is missing between messages that were received.

    A publisher numbers its messages one by one, so that a gap is a loss, wherever it happened: in
    the subscription, on the way, or in a publisher whose queue was too short. What came before a
    publisher's first message and after its last one cannot be told.
    """

    def __init__(self) -> None:
        """Nothing was received."""
        self._last: dict[bytes, int] = {}
        self.by_publisher: dict[bytes, int] = {}  #: where any were lost, by the publisher's GID
        self.unnumbered = False  #: whether a message had no number, so that nothing can be told

    def count(self, publisher: bytes, number: int) -> None:
        """Take note of a message that was received."""
        last = self._last.get(publisher, number - 1)
        self._last[publisher] = number
        if number == UNNUMBERED:
            self.unnumbered = True
        elif number > last + 1:
            self.by_publisher[publisher] = self.by_publisher.get(publisher, 0) + number - last - 1


def as_metadata(lost: Mapping[str, Mapping[str, int] | None]) -> dict[str, str]:
    """Return what a bag says of losses.

    Parameters
    ----------
    lost
        By topic, the messages lost of each publisher's node that lost any; None where the
        middleware does not number messages.
    """
    total = sum(sum(by_node.values()) for by_node in lost.values() if by_node)
    entries = {'lost_messages': str(total)}
    for topic, by_node in sorted(lost.items()):
        if by_node is None:
            entries[f'lost {topic}'] = 'unknown: the middleware does not number its messages'
        elif by_node:
            parts = ', '.join(f'{count} of {node}' for node, count in sorted(by_node.items()))
            entries[f'lost {topic}'] = f'{sum(by_node.values())} ({parts})'
    return entries


def in_words(counts: Mapping[str, int], lost: Mapping[str, Mapping[str, int] | None]) -> str:
    """Return in lines how many messages were recorded and lost; `lost` as for `as_metadata`."""
    entries = as_metadata(lost)
    total = entries.pop('lost_messages')
    first = f'recorded {sum(counts.values())} messages, lost {total}'
    return '\n'.join([first, *(f'{topic}: {what}' for topic, what in entries.items())])
