"""A node that looks at the running system, and waits that end when the process is to stop."""

from __future__ import annotations

import time
from contextlib import contextmanager
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.exceptions import InvalidTopicNameException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden
from rclpy.validate_full_topic_name import validate_full_topic_name

from barc_sim.cli.signals import StopSignals
from barc_sim.errors import UserError
from barc_sim.ros.process import ros

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from rclpy.task import Future
    from rclpy.topic_endpoint_info import TopicEndpointInfo

#: [s] for which something that is not there is waited for.
PATIENCE = 3.0
#: [s] while nobody at all is seen: a busy machine may take so long to see the first.
_ALONE = 8.0
#: [s] The system is looked at until it has stayed the same for so long.
_STEADY = 0.5
_LOOK_PERIOD = 0.02  #: [s]
#: [s] for an answer, after which it is asked for again: a service may be seen before it sees who
#: calls it, and its answer is lost then.
_ANSWER_PATIENCE = 2.0
_ATTEMPTS = 3


@contextmanager
def looking(name: str) -> Iterator[Look]:
    """Start ROS and return a look at the system by a hidden node `_name`; end both at the end."""
    with StopSignals() as stop, ros([]):
        node = Node(f'_{name}', enable_rosout=False, start_parameter_services=False)
        try:
            yield Look(node, stop)
        finally:
            node.destroy_node()


class Look:
    """What `node` sees.

    Every wait raises KeyboardInterrupt when the process is asked to stop, by whatever signal.
    """

    def __init__(self, node: Node, stop: StopSignals) -> None:
        """Look as `node`, which nobody spins."""
        self.node = node
        self.domain = node.context.get_domain_id()
        self._stop = stop

    def pause(self, seconds: float) -> None:
        """Wait for a while [s]."""
        if self._stop.requested.wait(seconds):
            raise KeyboardInterrupt

    def until(self, condition: Callable[[], object], seconds: float = PATIENCE) -> bool:
        """Wait for `condition`; return whether it came true within `seconds`."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                return False
            self.pause(_LOOK_PERIOD)
        return True

    def settled(self, look: Callable[[], Any]) -> Any:  # noqa: ANN401 (as it is looked at)
        """Return what `look` returns once it is something, and the same for a while."""
        seen, begin = look(), time.monotonic()
        changed = begin
        while (now := time.monotonic()) - changed < (_STEADY if seen else _ALONE):
            if now - begin > _ALONE:
                break
            self.pause(_LOOK_PERIOD)
            new = look()
            if new != seen:
                seen, changed = new, time.monotonic()
        return seen

    def topics(self, *, hidden: bool = False) -> dict[str, list[str]]:
        """Return the topics that there are now, in order, and their types."""
        return {
            name: types
            for name, types in sorted(self.node.get_topic_names_and_types())
            if hidden or not topic_or_service_is_hidden(name)
        }

    def topic(self, name: str) -> str:
        """Return the full name of a topic that has a publisher or a subscriber, waiting for it.

        Raises
        ------
        UserError
            where it isn't there, or can't be the name of a topic.
        """
        try:
            full = expand_topic_name(name, self.node.get_name(), self.node.get_namespace())
            validate_full_topic_name(full)
        except (InvalidTopicNameException, ValueError) as error:
            raise UserError(f'{name!r} cannot be a topic: {_first_words(error)}') from None
        if not self._appears(lambda: full in self.topics(hidden=True)):
            raise UserError(f'there is no topic {full}{self._instead(full, self.topics())}')
        return str(full)

    def ends(self, topic: str) -> tuple[list[TopicEndpointInfo], list[TopicEndpointInfo]]:
        """Return the publishers and the subscriptions of a topic, but those of this node."""
        here = self.node.get_name()
        publishers = self.node.get_publishers_info_by_topic(topic)
        subscriptions = self.node.get_subscriptions_info_by_topic(topic)
        return (
            [end for end in publishers if end.node_name != here],
            [end for end in subscriptions if end.node_name != here],
        )

    def nodes(self, *, hidden: bool = False) -> list[str]:
        """Return the full names of the nodes that there are now, but this one, in order."""
        here = self.node.get_name()
        return sorted(
            f'{namespace.rstrip("/")}/{name}'
            for name, namespace in self.node.get_node_names_and_namespaces()
            if name != here and (hidden or not name.startswith('_'))
        )

    def peer(self, name: str) -> str:
        """Return the full name of the node `name`, waiting for it.

        Raises
        ------
        UserError
            where it isn't there.
        """
        full = f'/{name.lstrip("/")}'
        try:
            validate_full_topic_name(full)  # which tells more than the check of a node's name
        except InvalidTopicNameException as error:
            raise UserError(f'{name!r} cannot be a node: {_first_words(error)}') from None
        if not self._appears(lambda: full in self.nodes(hidden=True)):
            raise UserError(f'there is no node {full}{self._instead(full, self.nodes())}')
        return full

    def answer(self, ask: Callable[[], Future], whom: str) -> Any:  # noqa: ANN401 (a service's own)
        """Return the response that the future of `ask` brings.

        Raises
        ------
        UserError
            where none comes from `whom`.
        """
        for _ in range(_ATTEMPTS):
            future = ask()
            end = time.monotonic() + _ANSWER_PATIENCE
            while time.monotonic() < end:
                rclpy.spin_once(self.node, timeout_sec=_LOOK_PERIOD)
                if future.done():
                    return future.result()
                self.pause(0.0)
        raise UserError(
            f'{whom} does not answer: it is busy or stands still; look at it, and try again'
        )

    def _appears(self, condition: Callable[[], object]) -> bool:
        """Wait for `condition`, for longer while there is nobody."""
        self.until(lambda: condition() or self.nodes(hidden=True), _ALONE)
        return self.until(condition)

    def _instead(self, name: str, names: Iterable[str]) -> str:
        """Say, after a name that isn't there, which are."""
        known = list(names)
        if not known:
            return f', nor any other in ROS domain {self.domain}: start a run first'
        close = get_close_matches(name, known, n=3)
        if close:
            return f': did you mean {" or ".join(close)}?'
        return f' in ROS domain {self.domain}: there are {", ".join(known)}'


def _first_words(error: Exception) -> str:
    """Return what is wrong with a name, without where rcl's source says so."""
    reason = str(error).splitlines()[0].partition(', at /')[0].rstrip(':')
    return reason.removeprefix('Invalid topic name: ').replace('topic name', 'a name')
