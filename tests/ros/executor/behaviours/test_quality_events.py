"""Events of quality of service: each kind, whenever the endpoints came to be."""

from __future__ import annotations

from collections import defaultdict
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.event_handler import QoSPublisherMatchedInfo as MatchedInfo
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile
from std_msgs.msg import Int32

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.executors import Executor
    from rclpy.node import Node

    Until = Callable[[Callable[[], object]], None]

pytestmark = pytest.mark.timeout(60)

#: The changes that a first event reports.
FIRST = {
    'publisher matched': {'total_count_change': 1, 'current_count_change': 1},
    'publisher incompatible': {'total_count_change': 1},
    'publisher deadline': {'total_count_change': 1},
    'publisher liveliness': {'total_count_change': 1},
    'subscription matched': {'total_count_change': 1, 'current_count_change': 1},
    'subscription incompatible': {'total_count_change': 1},
    'subscription deadline': {'total_count_change': 1},
    'subscription liveliness': {'alive_count_change': 1},
}


class Endpoints:
    """Publishers and subscriptions with an event of each kind, and what is reported of them."""

    def __init__(self, publishing: Node, subscribing: Node) -> None:
        self.events: dict[str, list[Any]] = defaultdict(list)
        self._publishing = publishing
        self._subscribing = subscribing
        self._publishers: list[Any] = []

        self._connect('matched', QoSProfile(depth=10))
        self._connect(
            'incompatible',
            QoSProfile(depth=10),
            QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL),
        )
        self._connect('deadline', QoSProfile(depth=10, deadline=Duration(seconds=0.05)))
        self._connect(
            'liveliness',
            QoSProfile(
                depth=10,
                liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
                liveliness_lease_duration=Duration(seconds=0.2),
            ),
        )
        for publisher in self._publishers:
            publisher.publish(Int32())

    def _connect(self, kind: str, offered: QoSProfile, requested: QoSProfile | None = None) -> None:
        name = {'incompatible': 'incompatible_qos'}.get(kind, kind)
        of_publisher = PublisherEventCallbacks(**{name: self.events[f'publisher {kind}'].append})
        of_subscription = SubscriptionEventCallbacks(
            **{name: self.events[f'subscription {kind}'].append}
        )
        self._publishers.append(
            self._publishing.create_publisher(Int32, kind, offered, event_callbacks=of_publisher)
        )
        self._subscribing.create_subscription(
            Int32, kind, lambda _: None, requested or offered, event_callbacks=of_subscription
        )

    def missing(self) -> list[str]:
        """Return the kinds without an event so far."""
        return [kind for kind in FIRST if not self.events[kind]]


@pytest.mark.parametrize('before', [True, False], ids=['before attaching', 'after attaching'])
@pytest.mark.parametrize('nodes', [1, 2])
def test_each_kind_of_event_is_reported(
    executor: Executor,
    make_node: Callable[[], Node],
    until: Until,
    nodes: int,
    *,
    before: bool,
) -> None:
    publishing = make_node()
    subscribing = publishing if nodes == 1 else make_node()
    made = []
    if before:
        for node in {publishing, subscribing}:
            executor.remove_node(node)
        endpoints = Endpoints(publishing, subscribing)
        made.append(endpoints)
        for node in {publishing, subscribing}:
            executor.add_node(node)
    else:

        def make() -> None:
            timer.cancel()
            made.append(Endpoints(publishing, subscribing))

        timer = publishing.create_timer(0.001, make)
    until(lambda: made and not made[0].missing())
    for kind, changes in FIRST.items():
        event = made[0].events[kind][0]
        counts = [getattr(event, name) for name in dir(event) if name.endswith('_count')]
        assert any(counts), kind
        for name in changes:
            if kind != 'subscription liveliness' and 'deadline' not in kind:  # may be several
                assert getattr(event, name) == changes[name], kind

    assert isinstance(made[0].events['publisher matched'][0], MatchedInfo)


def test_an_event_is_reported_once(
    executor: Executor,
    node: Node,
    until: Until,
    spin_for: Callable[[float], None],
) -> None:
    """Also when the node leaves the executor and comes back."""
    counts: list[tuple[str, int, int]] = []

    def note(side: str, event: Any) -> None:  # noqa: ANN401
        counts.append((side, event.total_count, event.current_count))

    node.create_publisher(
        Int32,
        'number',
        10,
        event_callbacks=PublisherEventCallbacks(matched=partial(note, 'publisher')),
    )

    def subscribe() -> Any:  # noqa: ANN401
        return node.create_subscription(Int32, 'number', lambda _: None, 10)

    first = subscribe()
    until(lambda: counts)
    executor.remove_node(node)
    executor.add_node(node)
    spin_for(0.02)
    second = subscribe()
    until(lambda: len(counts) == 2)
    node.destroy_subscription(second)
    until(lambda: len(counts) == 3)
    spin_for(0.02)
    assert counts == [('publisher', 1, 1), ('publisher', 2, 2), ('publisher', 2, 1)]

    del first


@pytest.mark.parametrize('before', [True, False], ids=['before attaching', 'after attaching'])
def test_rclpy_warns_of_incompatible_quality_by_itself(
    executor: Executor,
    node: Node,
    until: Until,
    monkeypatch: pytest.MonkeyPatch,
    *,
    before: bool,
) -> None:
    warnings: list[str] = []
    monkeypatch.setattr(
        'rclpy.impl.rcutils_logger.RcutilsLogger.warn',
        lambda _, text, *__, **___: warnings.append(text),
    )
    if before:
        executor.remove_node(node)
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(Int32, 'number', 10)
    node.create_subscription(Int32, 'number', lambda _: None, latched)
    if before:
        executor.add_node(node)
    until(lambda: len(warnings) == 2)
    of_subscription, of_publisher = sorted(warnings)

    assert of_subscription.startswith('New publisher discovered')
    assert of_publisher.startswith('New subscription discovered')
    assert all('DURABILITY' in text for text in warnings)
