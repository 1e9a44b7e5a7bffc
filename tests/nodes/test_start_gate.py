"""When a simulator's time begins: later if a controller of another process may still be found."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from barc_sim.nodes import start_gate

if TYPE_CHECKING:
    from collections.abc import Callable


class PolledNode:
    """A node without services, whose timer is called by hand."""

    poll: Callable[[], None]

    def create_timer(self, _: float, poll: Callable[[], None], **__: object) -> SimpleNamespace:  # noqa: D102
        self.poll = poll
        return SimpleNamespace(reset=lambda: None, cancel=lambda: None)

    def count_services(self, _: str) -> int:  # noqa: D102
        return 0


def polls_until_begin(monkeypatch: pytest.MonkeyPatch, *, own: bool) -> int:
    monkeypatch.setattr(start_gate, 'publishers', lambda *_: ['a controller'])
    monkeypatch.setattr(start_gate, 'all_own', lambda *_: own)
    monkeypatch.setattr(start_gate, 'check_unique', lambda *_: None)
    node: Any = PolledNode()
    begun: list[bool] = []
    start_gate.StartGate(node, node, lambda: begun.append(True), wait=True)
    polls = 0
    while not begun:
        node.poll()
        polls += 1
    return polls


def test_a_controller_of_another_process_is_awaited_for_longer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = polls_until_begin(monkeypatch, own=True)
    assert 1 < own < polls_until_begin(monkeypatch, own=False)


def test_one_that_takes_the_place_of_a_killed_one_drives_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now, ends, warnings = [0.0], ['dead'], []
    monkeypatch.setattr(start_gate.time, 'monotonic', lambda: now[0])
    monkeypatch.setattr(
        start_gate,
        'publishers',
        lambda *_: [SimpleNamespace(endpoint_gid=name.encode()) for name in ends],
    )
    monkeypatch.setattr(start_gate, 'full_names', lambda _: ends)
    node: Any = SimpleNamespace(
        resolve_topic_name=lambda name: f'/{name}',
        get_logger=lambda: SimpleNamespace(warning=warnings.append),
    )
    stepper: Any = SimpleNamespace(states=0, missed=0, paused=False, deadline_period=0.02)
    stepper.check = lambda: None
    watch = start_gate.PeerWatch(node, stepper, lambda: None, lambda: None)

    def second(missed: int) -> None:
        now[0] += 1.0
        stepper.states += 50
        stepper.missed += missed
        watch.check()

    second(0)
    second(50)
    ends.append('new')
    second(10)
    for _ in range(19):  # DDS needs 20 s to notice that one is dead
        second(0)
    assert watch.rivals == warnings == []
    second(0)
    assert watch.rivals == ['dead', 'new']
    assert warnings == ['dead and new publish /ecu and drive together: end one']
