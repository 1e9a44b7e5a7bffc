"""What a node refuses: each is counted, and one in a second warned of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from rclpy.node import Node

from barc_sim.ros import warnings as refusals
from barc_sim.ros.warnings import Refusals

if TYPE_CHECKING:
    from rclpy.context import Context


def test_all_are_counted_and_one_in_a_second_is_told(
    ros: Context, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    node = Node('car', context=ros)
    clock = iter((100.0, 100.1, 100.9, 101.0, 101.5))
    monkeypatch.setattr(refusals.time, 'monotonic', lambda: next(clock))
    refused, asked = Refusals(node), []

    def what() -> str:
        asked.append(refused.count)
        return 'nonsense'

    for _ in range(5):
        refused.add(what)
    monkeypatch.undo()
    node.destroy_node()
    assert refused.count == 5
    assert asked == [1, 4]
    told = capfd.readouterr().err
    assert told.count('refused nonsense') == 2
    assert 'refused nonsense (4 refused up to now)' in told
