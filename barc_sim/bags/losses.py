"""Counts lost messages, by the sequence numbers that publishers give them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

#: The number of a message that the middleware does not number.
UNNUMBERED = 2**64 - 1


class Losses:
    """The lost messages of one topic, for each publisher.

    A publisher numbers its messages one by one, so that a gap is a loss, wherever it happened: in
    the subscription, on the way, or in a publisher whose queue was too short. Losses before the
    first received message of a publisher, or after its last one, are not counted.

    Examples
    --------
    >>> losses = Losses()
    >>> for number in (1, 2, 5):
    ...     losses.count(b'publisher', number)
    >>> losses.by_publisher
    {b'publisher': 2}
    """

    def __init__(self) -> None:
        """Begin with no messages."""
        self._last: dict[bytes, int] = {}
        self.by_publisher: dict[bytes, int] = {}  #: where any were lost, by the publisher's GID
        self.unnumbered = False  #: whether a message had no number, so that losses are unknown

    def count(self, publisher: bytes, number: int) -> None:
        """Count a received message, by its publisher's GID and its number."""
        last = self._last.get(publisher, number - 1)
        self._last[publisher] = number
        if number == UNNUMBERED:
            self.unnumbered = True
        elif number > last + 1:
            self.by_publisher[publisher] = self.by_publisher.get(publisher, 0) + number - last - 1


def as_metadata(lost: Mapping[str, Mapping[str, int] | None]) -> dict[str, str]:
    """Return the metadata entries of a bag about lost messages.

    Parameters
    ----------
    lost
        By topic, the number of lost messages by the publisher's node; None where the middleware
        does not number messages.

    Examples
    --------
    >>> as_metadata({'/ecu': {'controller': 2}})
    {'lost_messages': '2', 'lost /ecu': '2 (2 of controller)'}
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


def left_out(unrecorded: Mapping[str, str]) -> dict[str, str]:
    """Return the topics that cannot be recorded, and why, as metadata."""
    return {f'not recorded {topic}': why for topic, why in sorted(unrecorded.items())}


def summary(
    counts: Mapping[str, int],
    lost: Mapping[str, Mapping[str, int] | None],
    unrecorded: Mapping[str, str],
) -> str:
    """Return lines with the numbers of recorded and lost messages, and with what is left out.

    `lost` is as in `as_metadata`, `unrecorded` as in `left_out`.

    Examples
    --------
    >>> print(summary({'ecu': 98}, {'ecu': {'controller': 2}}, {}))
    recorded 98 messages, lost 2
    lost ecu: 2 (2 of controller)
    """
    entries = as_metadata(lost)
    total = entries.pop('lost_messages')
    first = f'recorded {sum(counts.values())} messages, lost {total}'
    entries |= left_out(unrecorded)
    return '\n'.join([first, *(f'{topic}: {what}' for topic, what in entries.items())])
