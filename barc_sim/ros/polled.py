"""Subscriptions that no executor waits for: their owner polls them."""

from __future__ import annotations

import os
import select
import weakref
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rclpy.exceptions import InvalidHandle

from barc_sim.ros import endpoints
from barc_sim.ros.executor.rclpy_private import set_listener

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription

    from barc_sim.ros.executor import PolledCallbackGroup


class Arrivals:
    """Counts what arrives at polled subscriptions in one descriptor, to sleep until then.

    Examples
    --------
    >>> import rclpy
    >>> from std_msgs.msg import Float64
    >>> from barc_sim.ros.executor import PolledCallbackGroup
    >>> rclpy.init()
    >>> node, arrivals = rclpy.create_node('logger'), Arrivals()
    >>> subscription = polled(node, Float64, 'speed', 1, PolledCallbackGroup())
    >>> arrivals.listen([subscription])
    >>> node.create_publisher(Float64, 'speed', 1).publish(Float64(data=8.0))
    >>> arrivals.wait(5.0)
    >>> [message.data for message, _ in take(subscription, 1)]
    [8.0]
    >>> arrivals.listen([])
    """

    def __init__(self) -> None:
        """Listen to nothing yet."""
        self._descriptor = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._close = weakref.finalize(self, os.close, self._descriptor)
        self._subscriptions: list[Subscription] = []  # their handles are in use

    def listen(self, subscriptions: Iterable[Subscription]) -> None:
        """Count what arrives at these subscriptions, and at no others."""
        while self._subscriptions:
            subscription = self._subscriptions.pop()
            set_listener(subscription, None)
            subscription.handle.__exit__(None, None, None)
        for subscription in subscriptions:
            with suppress(InvalidHandle):
                subscription.handle.__enter__()
                self._subscriptions.append(subscription)
                if not set_listener(subscription, self._descriptor):
                    self.wake()  # the middleware has no listeners: no sleep

    def wait(self, timeout_sec: float) -> None:
        """Sleep until something has arrived, `wake` is called or the time is over."""
        poll = select.poll()
        poll.register(self._descriptor, select.POLLIN)
        if poll.poll(timeout_sec * 1e3):
            os.eventfd_read(self._descriptor)

    def wake(self) -> None:
        """End a `wait`, from any thread."""
        os.eventfd_write(self._descriptor, 1)


def polled(
    node: Node,
    message_type: type[Any],
    topic: str,
    qos: QoSProfile | int,
    group: PolledCallbackGroup,
    *,
    raw: bool = False,
) -> Subscription:
    """Return a subscription that keeps messages until `take` takes them.

    Where `qos` is a number, that is the length of the queue, which keeps the newest messages. With
    `raw`, messages stay serialized.

    Examples
    --------
    >>> import rclpy
    >>> from std_msgs.msg import Float64
    >>> from barc_sim.ros.executor import PolledCallbackGroup
    >>> rclpy.init()
    >>> node = rclpy.create_node('logger')
    >>> newest = polled(node, Float64, 'speed', 2, PolledCallbackGroup())
    >>> publisher = node.create_publisher(Float64, 'speed', 10)
    >>> for speed in (7.9, 8.0, 8.1):
    ...     publisher.publish(Float64(data=speed))
    >>> [message.data for message, _ in take(newest, limit=10)]
    [8.0, 8.1]
    """
    return endpoints.subscription(
        node, message_type, topic, lambda _: None, group, qos=qos, raw=raw
    )


def take(subscription: Subscription, limit: int) -> Iterator[tuple[Any, dict[str, int]]]:
    """Yield up to `limit` waiting messages, each with the middleware's information on it.

    Examples
    --------
    >>> import rclpy
    >>> from std_msgs.msg import Float64
    >>> from barc_sim.ros.executor import PolledCallbackGroup
    >>> rclpy.init()
    >>> node = rclpy.create_node('logger')
    >>> subscription = polled(node, Float64, 'speed', 1, PolledCallbackGroup())
    >>> node.create_publisher(Float64, 'speed', 1).publish(Float64(data=8.0))
    >>> [(message, about)] = take(subscription, limit=10)
    >>> message.data, 0 < about['source_timestamp'] <= about['received_timestamp']
    (8.0, True)
    """
    for _ in range(limit):
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, False)
        if taken is None:
            return
        yield taken
