"""A hidden node that observes the running system; its waits end when the process must stop."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.exceptions import InvalidTopicNameException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden
from rclpy.validate_full_topic_name import validate_full_topic_name

from barc_sim.cli.parser import did_you_mean
from barc_sim.cli.signals import StopSignals
from barc_sim.errors import UserError
from barc_sim.ros.peers import others_here
from barc_sim.ros.process import ros

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from rclpy.task import Future
    from rclpy.topic_endpoint_info import TopicEndpointInfo

#: [s] to wait for something that is not there.
_PATIENCE = 3.0
#: [s] to wait for the first other node: discovery on a busy machine can take this long.
_BUSY = 8.0
#: [s] the same where no other process of this machine takes part: others are on the network.
_ALONE = 1.2
#: [s] without a change, after which the system counts as stable.
_STEADY = 0.5
_POLL_PERIOD = 0.02  #: [s]
#: [s] to wait for a response before the request is sent again. The client can discover a service
#: before the service discovers the client; a response is lost then.
_RESPONSE_PATIENCE = 2.0
_ATTEMPTS = 3


@contextmanager
def observe(name: str) -> Iterator[GraphObserver]:
    """Start ROS and give an observer with the hidden node `_name`; both end with the block."""
    with StopSignals() as stop, ros([]):
        node = Node(f'_{name}', enable_rosout=False, start_parameter_services=False)
        try:
            yield GraphObserver(node, stop)
        finally:
            node.destroy_node()


class GraphObserver:
    """The ROS graph as `node` discovers it.

    Every wait raises KeyboardInterrupt after a signal that ends the process.
    """

    def __init__(self, node: Node, stop: StopSignals) -> None:
        """Observe with `node`, which no executor spins."""
        self.node = node
        self.domain = node.context.get_domain_id()
        self._stop = stop

    def pause(self, seconds: float) -> None:
        """Wait for this time [s]."""
        if self._stop.requested.wait(seconds):
            raise KeyboardInterrupt

    def wait_for(self, condition: Callable[[], object], patience: float | None = None) -> bool:
        """Wait for `condition`; return False if it is not true within some seconds."""
        end = time.monotonic() + (_PATIENCE if patience is None else patience)
        while not condition():
            if time.monotonic() > end:
                return False
            self.pause(_POLL_PERIOD)
        return True

    def wait_until_stable(self, read: Callable[[], Any]) -> Any:  # noqa: ANN401 (of any type)
        """Call `read` until its result is not empty and no longer changes; return that."""
        seen, begin = read(), time.monotonic()
        changed = begin
        while (now := time.monotonic()) - changed < (_STEADY if seen else self._patience()):
            if now - begin > _BUSY:
                break
            self.pause(_POLL_PERIOD)
            new = read()
            if new != seen:
                seen, changed = new, time.monotonic()
        return seen

    def topics(self, *, hidden: bool = False) -> dict[str, list[str]]:
        """Return the present topics in order, and their types."""
        return {
            name: types
            for name, types in sorted(self.node.get_topic_names_and_types())
            if hidden or not topic_or_service_is_hidden(name)
        }

    def find_topic(self, name: str) -> str:
        """Wait for a topic with a publisher or a subscriber; return its full name."""
        # Without another node, the topics are this one's own.
        return self._find(name, 'topic', self.topics, lambda: self.topics() if self.nodes() else ())

    def find_node(self, name: str) -> str:
        """Wait for the node `name`; return its full name."""
        return self._find(name, 'node', self.nodes, self.nodes)

    def _find(
        self,
        name: str,
        what: str,
        present: Callable[..., Iterable[str]],
        known: Callable[[], Iterable[str]],
    ) -> str:
        """Wait for what has this name, longer while there is no other node."""
        try:
            full = str(expand_topic_name(name, self.node.get_name(), self.node.get_namespace()))
            validate_full_topic_name(full)
        except (InvalidTopicNameException, ValueError) as error:
            # Without the line of rcl's source.
            reason = str(error).splitlines()[0].partition(', at /')[0].rstrip(':')
            reason = reason.removeprefix('Invalid topic name: ').replace('topic name', 'a name')
            raise UserError(f'{name!r} cannot be a {what}: {reason}') from None

        def is_there() -> bool:
            return full in present(hidden=True)

        someone = self.wait_for(lambda: is_there() or self.nodes(hidden=True), self._patience())
        if someone and self.wait_for(is_there):
            return full
        others = [*known()]
        if not others:
            hint = f', nor any other in ROS domain {self.domain}: start a run first'
        else:
            hint = did_you_mean(full, others) or (
                f' in ROS domain {self.domain}: there are {", ".join(others)}'
            )
        raise UserError(f'there is no {what} {full}{hint}')

    def endpoints(self, topic: str) -> tuple[list[TopicEndpointInfo], list[TopicEndpointInfo]]:
        """Return the publishers and the subscriptions of a topic, except those of this node."""
        here = self.node.get_name()
        publishers = self.node.get_publishers_info_by_topic(topic)
        subscriptions = self.node.get_subscriptions_info_by_topic(topic)
        return (
            [end for end in publishers if end.node_name != here],
            [end for end in subscriptions if end.node_name != here],
        )

    def nodes(self, *, hidden: bool = False) -> list[str]:
        """Return the full names of the present nodes, except this one, in order."""
        here = self.node.get_name()
        return sorted(
            f'{namespace.rstrip("/")}/{name}'
            for name, namespace in self.node.get_node_names_and_namespaces()
            if name != here and (hidden or not name.startswith('_'))
        )

    def no_node(self, hint: str = '') -> UserError:
        """Return the error that no node is running."""
        return UserError(f'no node is running in ROS domain {self.domain}: start a run first{hint}')

    def request(self, send: Callable[[], Future], node: str) -> Any:  # noqa: ANN401 (a service's own)
        """Send a request to `node` and return its response.

        `send` sends it and returns the future of the response.
        """
        for _ in range(_ATTEMPTS):
            future = send()
            end = time.monotonic() + _RESPONSE_PATIENCE
            while time.monotonic() < end:
                rclpy.spin_once(self.node, timeout_sec=_POLL_PERIOD)
                if future.done():
                    return future.result()
                self.pause(0.0)
        raise UserError(f'{node} does not respond: it is busy or it hangs; check it, and try again')

    def _patience(self) -> float:
        """Return how long to wait for the first other node [s]."""
        return _BUSY if others_here(self.domain) else _ALONE
