"""Subscriptions that no executor waits for: their owner takes the messages when it suits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import QoSProfile

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.node import Node
    from rclpy.subscription import Subscription


class PolledCallbackGroup(CallbackGroup):
    """Keeps its subscriptions out of every executor's wait set.

    To be woken for each message would cost 4 % of a core at 50 Hz with 7 topics, a look at all of
    them every 50 ms about 1 %; and nothing comes between a state and the command that answers it.
    Reception is stamped in DDS, so nothing is lost by looking later.
    """

    def can_execute(self, entity: object) -> bool:  # noqa: ARG002 (rclpy's)
        """Never."""
        return False

    def beginning_execution(self, entity: object) -> bool:  # noqa: ARG002 (rclpy's)
        """Never."""
        return False

    def ending_execution(self, entity: object) -> None:
        """Do nothing, as nothing begins."""


def polled(
    node: Node, message_type: type[Any], topic: str, depth: int, group: PolledCallbackGroup
) -> Subscription:
    """Return a subscription that holds the newest `depth` messages until `take` takes them."""
    return node.create_subscription(
        message_type,
        topic,
        lambda _: None,
        QoSProfile(depth=depth),
        callback_group=group,
        event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
    )


def take(subscription: Subscription, limit: int) -> Iterator[tuple[Any, dict[str, int]]]:
    """Yield up to `limit` messages that wait, and what the middleware says of each."""
    for _ in range(limit):
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, False)
        if taken is None:
            return
        yield taken
