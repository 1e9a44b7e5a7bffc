"""Subscriptions to every topic that is wanted, and what they have received."""

from __future__ import annotations

import importlib
import threading
import time
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy

from barc_sim.bags.losses import Losses
from barc_sim.ros import offers
from barc_sim.ros.polled import PolledCallbackGroup
from barc_sim.ros.serialized import Taker

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rclpy.node import Node
    from rclpy.subscription import Subscription
    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from barc_sim.bags.metadata import Topic

# Messages that may wait: what a stall of a second brings at 10,000 a second.
_DEPTH = 10_000
# [s] A latched message that has not come by then never will.
_LATCHED_PATIENCE = 1.0


class Message(NamedTuple):
    """A message to write."""

    topic: Topic
    data: bytes  #: in CDR, with its header
    received: int  #: [ns] since the epoch
    published: int  #: [ns] since the epoch
    number: int  #: the publisher's count


@dataclass
class _Heard:
    """A topic that is listened to."""

    topic: Topic
    publishers: int = 0
    since: float = field(default_factory=time.monotonic)
    subscriptions: list[Subscription] = field(default_factory=list)
    #: Which subscription each publisher is heard through: the first that had a message of it.
    through: dict[bytes, int] = field(default_factory=dict)
    losses: Losses = field(default_factory=Losses)
    names: dict[bytes, str] = field(default_factory=dict)  # of the publishers' nodes

    def hears(self, publisher: TopicEndpointInfo) -> bool:
        """Return whether one of the subscriptions matches the publisher."""
        return any(
            offers.fits(publisher, subscription.qos_profile) for subscription in self.subscriptions
        )

    @property
    def latched(self) -> bool:
        """Whether publishers keep messages for subscriptions that come late."""
        profile = self.subscriptions[0].qos_profile
        return bool(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL)

    def lost(self) -> dict[str, int] | None:
        """Return the messages lost, by the names of the publishers' nodes."""
        if self.losses.unnumbered:
            return None
        by_node: dict[str, int] = {}
        for publisher, count in self.losses.by_publisher.items():
            node = self.names.get(publisher, publisher.hex())
            by_node[node] = by_node.get(node, 0) + count
        return by_node


class Listener:
    """Hears all publishers of the topics that are wanted.

    A publisher that offers less than the first ones did gets a subscription of its own, which
    asks for less; the others are heard as before.

    Parameters
    ----------
    node
        Whose subscriptions they are.
    wants
        Whether a topic is, by its full name.
    """

    def __init__(self, node: Node, wants: Callable[[str], bool]) -> None:
        self._node = node
        self._wants = wants
        self._polled = PolledCallbackGroup()
        self._taker = Taker()
        self._heard: dict[str, _Heard] = {}
        self._lock = threading.Lock()  # of `_heard`
        self._definitions: dict[str, str] = {}
        self.unknown: dict[str, str] = {}  #: why a topic cannot be recorded, by its name

    def discover(self) -> Iterator[tuple[str, Sequence[TopicEndpointInfo]]]:
        """Listen to every wanted topic that has a publisher by now, as far as not done yet.

        Yields
        ------
            Name and publishers of topics that turn out to be impossible to record.
        """
        for name, _ in self._node.get_topic_names_and_types():
            heard = self._heard.get(name)
            known = heard.publishers if heard else 0
            if name in self.unknown or self._node.count_publishers(name) == known:
                continue
            if self._wants(name):
                publishers = self._node.get_publishers_info_by_topic(name)
                if publishers and not self.hear(name, publishers):
                    yield name, publishers

    def hear(self, name: str, publishers: Sequence[TopicEndpointInfo]) -> bool:
        """Subscribe so that all publishers of a topic are heard; return whether they can be.

        Where publishers do not agree on the topic's type, the first one's counts.
        """
        heard = self._heard.get(name)
        count = len(publishers)
        type_name = heard.topic.type if heard else publishers[0].topic_type
        for other in {publisher.topic_type for publisher in publishers} - {type_name}:
            self.unknown[f'{name} as {other}'] = f'its type is {type_name}'
        publishers = [publisher for publisher in publishers if publisher.topic_type == type_name]
        try:
            heard = heard or _Heard(offers.describe(name, publishers, self._definitions))
            unheard = [publisher for publisher in publishers if not heard.hears(publisher)]
            if unheard:
                subscription = self._subscribe(name, unheard)
                with self._lock:
                    heard.subscriptions.append(subscription)
        except LookupError as error:
            self.unknown[name] = f'{type_name}: {error}'
            return False
        self.unknown.pop(name, None)
        heard.publishers = count
        heard.names |= {
            bytes(publisher.endpoint_gid): publisher.node_name for publisher in publishers
        }
        with self._lock:
            self._heard[name] = heard
        return True

    def define(self, type_name: str, definition: str) -> None:
        """Take the `ros2msg` schema of a type that is installed without one."""
        self._definitions[type_name] = definition

    def _subscribe(self, name: str, publishers: Sequence[TopicEndpointInfo]) -> Subscription:
        return self._node.create_subscription(
            _class(publishers[0].topic_type),
            name,
            _never,
            offers.request(publishers, _DEPTH),
            callback_group=self._polled,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )

    def take(self) -> list[Message]:
        """Return what waits, topic by topic; for one thread."""
        with self._lock:
            return [message for heard in self._heard.values() for message in self._take(heard)]

    def _take(self, heard: _Heard) -> Iterator[Message]:
        topic, through, losses = heard.topic, heard.through, heard.losses
        for index, subscription in enumerate(heard.subscriptions):
            for taken in islice(self._taker.take(subscription), _DEPTH):
                data, published, received, number, publisher = taken
                if through.setdefault(publisher, index) == index:
                    losses.count(publisher, number)
                    yield Message(topic, data, received, published, number)

    def lost(self) -> dict[str, dict[str, int] | None]:
        """Return by topic the messages lost of each publisher's node; None where that is unknown.

        A publisher that was gone before it was seen has its GID for a name.
        """
        with self._lock:
            return {name: heard.lost() for name, heard in self._heard.items()}

    @property
    def expects_latched(self) -> bool:
        """Whether a latched message may still be on its way to a subscription that is new."""
        newest = time.monotonic() - _LATCHED_PATIENCE
        with self._lock:
            return any(
                heard.since > newest and heard.latched and not heard.through
                for heard in self._heard.values()
            )

    def close(self) -> None:
        """End; what was lost can still be asked for."""
        with self._lock:
            for heard in self._heard.values():
                for subscription in heard.subscriptions:
                    self._node.destroy_subscription(subscription)
        self._taker.close()


def _class(type_name: str) -> type[Any]:
    """Return the class of a type.

    Raises
    ------
    LookupError
        It is not installed.
    """
    package, module, base = type_name.split('/')
    try:
        return getattr(importlib.import_module(f'{package}.{module}'), base)  # type: ignore[no-any-return]
    except (ImportError, AttributeError) as error:
        raise LookupError(str(error)) from None


def _never(_: bytes) -> None:
    """Be never called."""
