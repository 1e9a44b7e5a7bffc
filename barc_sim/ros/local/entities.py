"""What a node has: publishers, subscriptions, clients, services and guard conditions."""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING, Any

from barc_sim.ros.local.executor import Future, not_async
from barc_sim.ros.local.world import SECOND

if TYPE_CHECKING:
    from barc_sim.ros.local.qos import QoSProfile


class Entity:
    """An entity of a node as the graph describes it, with a queue of its arrivals.

    Parameters
    ----------
    node
        The node whose entity it is.
    name
        The full name of its topic or service.
    kind
        The class of its messages, or of its service.
    qos
        The length of its queue, and whether it is latched.
    callback
        Called with each arrival.
    """

    def __init__(
        self, node: Any, name: str, kind: Any, qos: QoSProfile, callback: Any = None
    ) -> None:
        self.node = node
        self.kind = kind
        self.qos_profile = qos
        self.callback = not_async(callback)
        self.topic_name = name
        self.service_name = name
        self.node_name = node.get_name()
        self.node_namespace = node.get_namespace()
        package, interface_kind = kind.__module__.split('.')[:2]
        self.topic_type = f'{package}/{interface_kind}/{kind.__name__}'
        self.endpoint_gid = [*id(self).to_bytes(16, 'little')]
        self.queue: deque[Any] = deque(maxlen=qos.length)

    def offer(self, arrival: Any, number: int = 0) -> None:
        """Queue an arrival, in any thread; a full queue drops its oldest one."""
        del number
        queue = self.queue
        executor = self.node.executor
        is_full = len(queue) == queue.maxlen
        queue.append(arrival)
        if executor is not None and not is_full:
            executor.ready.append(self)
            if executor.waits:
                executor.awake.set()

    def destroy(self) -> None:
        self.queue.clear()


class Publisher(Entity):
    """Publishes messages on a topic.

    Attributes
    ----------
    subscriptions
        Those that get its messages.
    number
        Of the latest message; the first one has 1.
    """

    subscriptions: tuple[Subscription, ...] = ()
    number = 0

    def publish(self, msg: Any) -> None:
        """Publish a copy of a message, in this thread.

        Parameters
        ----------
        msg
            The message; it can be changed and published again.

        Raises
        ------
        TypeError
            It is of another type.
        AssertionError
            A field has a value that does not fit.
        """
        if not isinstance(msg, self.kind):
            raise TypeError(f'Expected {self.kind}, got {type(msg)}')
        self.number += 1
        if self.qos_profile.is_latched:
            self.queue.append((msg.__copy__(), self.number))
        for subscription in self.subscriptions:
            copy = msg.__serialize__() if subscription.raw else msg.__copy__()
            subscription.offer(copy, self.number)

    def get_subscription_count(self) -> int:
        """Return the number of subscriptions."""
        return len(self.subscriptions)

    def wait_for_all_acked(self, _: Any = None) -> bool:
        """Return True: each subscription has each message already."""
        return True

    def match(self) -> None:
        """Find the subscriptions that get this publisher's messages."""
        on_topic = self.node.context.all('subscriptions', self.topic_name)
        self.subscriptions = tuple(each for each in on_topic if each.kind is self.kind)

    def destroy(self) -> None:
        super().destroy()
        self.subscriptions = ()


class Subscription(Entity):
    """Receives the messages of a topic."""

    raw = False  #: whether it receives them serialized


class Client(Entity):
    """Sends requests to a service."""

    def call_async(self, request: Any) -> Future:
        """Send a request.

        Parameters
        ----------
        request
            The request; it can be changed and sent again.

        Returns
        -------
        Future
            It has the response once an executor has called the service and the client.

        Raises
        ------
        TypeError
            The request is of another type.
        """
        if not isinstance(request, self.kind.Request):
            raise TypeError(f'Expected {self.kind.Request}, got {type(request)}')
        future = Future()
        for server in self.node.context.all('services', self.topic_name)[:1]:
            server.offer((request.__copy__(), self, future))
        return future

    def service_is_ready(self) -> bool:
        """Return whether a node has the service."""
        return bool(self.node.context.all('services', self.topic_name))

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait until a node has the service.

        Parameters
        ----------
        timeout_sec
            The longest time [s]; by default there is no limit.

        Returns
        -------
        bool
            Whether it has.
        """
        world = self.node.context
        end = inf if timeout_sec is None else world.now() + timeout_sec * SECOND
        while not self.service_is_ready() and world.now() < end and world.is_ok:
            world.sleep(SECOND // 100)
        return self.service_is_ready()


def complete_request(arrival: tuple[Future, Any]) -> None:
    """Complete the future of a request with its response."""
    future, response = arrival
    future.set_result(response)


class GuardCondition(Entity):
    """Calls a callback when it is triggered."""

    def trigger(self) -> None:
        """Call the callback soon; any thread may call this."""
        self.offer(None)
