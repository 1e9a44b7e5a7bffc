"""Simulated time, as `/clock` tells it, for the messages of a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.bags.cdr import leading_time

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from barc_sim.ros.topic_subscriptions import Message

_CLOCK = '/clock'


class SimulatedTime:
    """Stamps messages with the latest `/clock` received before them; the first ones stay as is.

    So does `ros2 bag record --use-sim-time`, but for what the executor makes of the order: here
    it is that of reception. A clock that jumps backwards is followed.
    """

    def __init__(self) -> None:
        """No clock was heard."""
        self._now: int | None = None

    def stamped(self, messages: Iterable[Message]) -> Iterator[Message]:
        """Yield messages, given in order of reception, as received at the simulated time."""
        for message in messages:
            if message.topic.name == _CLOCK:
                self._now = leading_time(message.data)
            yield message if self._now is None else message._replace(received=self._now)
