"""Refused messages are counted, and few of them are logged."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.node import Node

from barc_sim.ros import refused_input
from barc_sim.ros.refused_input import RefusedInput

if TYPE_CHECKING:
    import pytest
    from rclpy.context import Context


def test_every_refusal_counts_and_one_a_second_is_logged(
    ros: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = Node('car', context=ros)
    logged: list[str] = []
    monkeypatch.setattr(node.get_logger(), 'warning', logged.append)
    clock = iter((100.0, 100.1, 100.9, 101.0, 101.5))
    monkeypatch.setattr(refused_input.time, 'monotonic', lambda: next(clock))
    refused, described = RefusedInput(node), []

    def describe() -> str:
        described.append(refused.count)
        return 'nonsense'

    for _ in range(5):
        refused.add(describe)
    monkeypatch.undo()
    node.destroy_node()
    assert refused.count == 5
    assert described == [1, 4]
    first, second = logged
    assert 'refused nonsense' in first
    assert 'refused nonsense (4 refused so far)' in second
