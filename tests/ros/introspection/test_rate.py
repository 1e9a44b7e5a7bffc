"""Rates in words."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy')

from barc_sim.ros.introspection.messages import describe_rate


@pytest.mark.parametrize(
    ('times', 'words'),
    [
        ([], 'no message'),
        ([5], '1 message'),
        (
            [0, 10_000_000, 30_000_000],
            'average rate: 66.667 min: 0.010s max: 0.020s std dev: 0.00500s window: 2',
        ),
        ([5, 5], 'average rate: 0.000 min: 0.000s max: 0.000s std dev: 0.00000s window: 1'),
    ],
)
def test_rate_is_printed_as_by_ros2_topic_hz(times: list[int], words: str) -> None:
    assert describe_rate(times) == words
