"""Limits of axes and readings of instruments."""

from __future__ import annotations

import numpy as np
import pytest

from barc_sim.look import limits, reading


@pytest.mark.parametrize(
    ('values', 'expected'),
    [
        ([0.0, 100.0], (-10.0, 110.0)),
        ([-100.0, 0.0], (-110.0, 10.0)),
        ([50.0, 100.0], (-10.0, 110.0)),  # zero is always in sight
        ([-30.0, 30.0], (-36.0, 36.0)),
        ([0.0, 0.0], (-5.0, 5.0)),
        ([np.nan, np.nan], (-5.0, 5.0)),
        ([np.nan, 100.0], (-10.0, 110.0)),
    ],
)
def test_limits_leave_room_around_the_values_and_zero(
    values: list[float], expected: tuple[float, float]
) -> None:
    assert limits(np.array(values), share=0.1, least=5.0) == pytest.approx(expected)


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        (8.004, '8.00 m/s'),
        (-8.0, '\N{MINUS SIGN}8.00 m/s'),
        (-0.001, '0.00 m/s'),
        (-0.0, '0.00 m/s'),
        (float('nan'), '\N{EN DASH}'),
    ],
)
def test_a_reading_is_rounded_with_its_unit(value: float, text: str) -> None:
    assert reading(value, 2, ' m/s') == text
