"""Subscriptions that no executor waits for: their owner polls them."""

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

    Waking up for each message would cost 4 % of a core at 50 Hz with 7 topics; polling all of them
    every 50 ms costs about 1 %, and nothing runs between a state and the command that answers it.
    DDS stamps the time of reception, so polling late loses nothing.
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
    """Return a subscription that keeps the newest `depth` messages until `take` takes them."""
    return node.create_subscription(
        message_type,
        topic,
        lambda _: None,
        QoSProfile(depth=depth),
        callback_group=group,
        event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
    )


def take(subscription: Subscription, limit: int) -> Iterator[tuple[Any, dict[str, int]]]:
    """Yield up to `limit` waiting messages, each with the middleware's information on it."""
    for _ in range(limit):
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, False)
        if taken is None:
            return
        yield taken
