"""The cost over two of the gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from barc_sim.errors import UserError
from barc_sim.tuning.search import free_axes, surface

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


def encoded(gains: Floats) -> Floats:
    """Return a cost that tells which gains it is of."""
    return np.asarray(gains @ [1.0, 1e3, 1e6])


def test_a_point_of_the_map_has_the_cost_of_its_gains() -> None:
    low, high = np.zeros(3), np.array([10.0, 100.0, 1.0])
    start, found = np.array([9.0, 90.0, 0.2]), np.array([5.0, 50.0, 0.5])
    plane = surface(encoded, low, high, start, found, 11)
    assert plane.axes == (0, 1)
    assert plane.right.tolist() == pytest.approx(np.linspace(0.0, 10.0, 11))
    assert plane.up.tolist() == pytest.approx(np.linspace(0.0, 100.0, 11))
    for row, ki in enumerate(plane.up):
        for column, kp in enumerate(plane.right):
            assert plane.cost[row, column] == pytest.approx(kp + 1e3 * ki + 0.5e6)


def test_a_map_reaches_no_farther_than_shows_its_points_well() -> None:
    low, high = np.zeros(3), np.array([100.0, 1000.0, 2.0])
    plane = surface(encoded, low, high, np.array([10.0, 1.0, 0.0]), np.array([4.0, 2.0, 0.0]), 3)
    assert plane.right[-1] == 25.0
    assert plane.up[-1] == 50.0


@pytest.mark.parametrize(
    ('fixed', 'axes'), [((), (0, 1)), ((0,), (1, 2)), ((1,), (0, 2)), ((2,), (0, 1))]
)
def test_the_map_is_over_gains_that_are_free(fixed: tuple[int, ...], axes: tuple[int, int]) -> None:
    low, high = np.zeros(3), np.ones(3)
    high[list(fixed)] = 0.0
    assert free_axes(low, high) == axes


def test_fewer_than_two_free_gains_make_no_map() -> None:
    with pytest.raises(UserError, match='give two of --kp-range'):
        free_axes(np.zeros(3), np.array([0.0, 1.0, 0.0]))
