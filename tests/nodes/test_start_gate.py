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
