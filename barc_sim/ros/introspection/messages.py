"""Messages of a topic as they arrive, their rate, and how many were lost."""

from __future__ import annotations

import importlib
from statistics import fmean, pstdev
from typing import TYPE_CHECKING, Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from barc_sim.bags.recording import Losses
from barc_sim.errors import UserError
from barc_sim.ros.executor import PolledCallbackGroup
from barc_sim.ros.offered_qos import matches, request
from barc_sim.ros.polled import Taker, polled

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rclpy.node import Node

    from barc_sim.ros.polled import Taken

#: Messages that can wait for the next `take`.
DEPTH = 10_000


class Messages:
    """The messages of a topic, from now on.

    Attributes
    ----------
    losses
        Gaps between the messages taken, by publisher.
    """

    def __init__(self, node: Node, topic: str, kind: type[Any], qos: QoSProfile) -> None:
        """Subscribe; `kind` is the class of the messages."""
        self.losses = Losses()
        self._taker = Taker(node)
        self._subscription = polled(node, kind, topic, qos, PolledCallbackGroup(), raw=True)

    def take(self) -> Iterator[Taken]:
        """Yield the messages that have arrived, serialized."""
        for taken in self._taker.take(self._subscription):
            self.losses.count(taken.publisher, taken.number)
            yield taken

    def close(self) -> None:
        """Unsubscribe."""
        self._taker.close()
        self._subscription.destroy()

    @property
    def lost(self) -> int:
        """Number of messages lost."""
        return sum(self.losses.by_publisher.values())


def quality(
    node: Node,
    topic: str,
    *,
    depth: int = DEPTH,
    reliability: str | None = None,
    durability: str | None = None,
) -> QoSProfile:
    """Return the strictest quality of service that all publishers of `topic` offer, or as given.

    Raises
    ------
    UserError
        where no present publisher offers what is given.
    """
    publishers = node.get_publishers_info_by_topic(topic)
    profile = request(publishers, depth)
    if not publishers:  # none to match yet: request the least
        profile.reliability = ReliabilityPolicy.BEST_EFFORT
        profile.durability = DurabilityPolicy.VOLATILE
    if reliability:
        profile.reliability = ReliabilityPolicy.get_from_short_key(reliability)
    if durability:
        profile.durability = DurabilityPolicy.get_from_short_key(durability)
    if publishers and not any(matches(publisher, profile) for publisher in publishers):
        offered = request(publishers, depth)
        raise UserError(
            f'no publisher offers {topic} as {_in_words(profile)}: request {_in_words(offered)} at '
            'most'
        )
    return profile


def describe_rate(times: Sequence[int]) -> str:
    """Return the mean rate of events at `times` [ns] in the words of `ros2 topic hz`.

    The window is the number of periods between them.
    """
    if len(times) < 2:  # noqa: PLR2004 (a period has two ends)
        return ('no message', '1 message')[len(times)]
    periods = [(new - old) * 1e-9 for old, new in zip(times, times[1:])]  # noqa: B905, RUF007
    mean = fmean(periods)
    return (
        f'average rate: {1.0 / mean if mean else 0.0:.3f} min: {min(periods):.3f}s '
        f'max: {max(periods):.3f}s std dev: {pstdev(periods):.5f}s window: {len(periods)}'
    )


def message_class(type_name: str) -> type[Any]:
    """Return the class of a type such as `std_msgs/msg/String`.

    Raises
    ------
    UserError
        where its package is not installed.
    """
    package, module, base = type_name.split('/')
    try:
        return getattr(importlib.import_module(f'{package}.{module}'), base)  # type: ignore[no-any-return]
    except (ImportError, AttributeError):
        raise UserError(
            f'the type {type_name} is not installed here: source the workspace of {package}'
        ) from None


def _in_words(profile: QoSProfile) -> str:
    return f'{profile.reliability.name.lower()} and {profile.durability.name.lower()}'
