"""The search for the minimum cost, and the cost over two gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from barc_sim.commands.tune import GAINS
from barc_sim.errors import UserError
from barc_sim.tuning.batch import Course
from barc_sim.tuning.goal import Cost, Goal
from barc_sim.tuning.search import free_axes, rounded, search, surface

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


LOW, HIGH = np.array([-5.12] * 3), np.array([5.12] * 3)


def rastrigin(places: Floats) -> Floats:
    """Return a bowl with a thousand local minima in the range; the least, 0, is at (1, 1, 1)."""
    x = places - 1.0
    return np.asarray(np.sum(x**2 + 10.0 - 10.0 * np.cos(2.0 * np.pi * x), axis=1))


@pytest.mark.parametrize('seed', range(3))
def test_the_least_of_many_minima_is_found(seed: int) -> None:
    found = search(rastrigin, LOW, HIGH, LOW, seed=seed, population=128, generations=200)
    assert found.gains == pytest.approx([1.0] * 3, abs=0.01)
    assert found.cost == rastrigin(found.gains[np.newaxis])[0]


def test_the_same_seed_gives_the_same_and_another_another() -> None:
    one, same, other = (
        search(rastrigin, LOW, HIGH, LOW, seed=seed, generations=3) for seed in (1, 1, 2)
    )
    assert one.gains.tolist() == same.gains.tolist()
    assert one.gains.tolist() != other.gains.tolist()


def test_no_gains_beyond_the_ranges_are_tried_and_no_others_twice() -> None:
    tried: list[Floats] = []

    def cost(places: Floats) -> Floats:
        tried.append(places.copy())
        return np.asarray(np.sum(places, axis=1))  # least in a corner

    low, high = np.array([1.0, 2.0, 3.0]), np.array([4.0, 2.0, 30.0])
    found = search(cost, low, high, np.zeros(3), population=32)
    everywhere = np.concatenate(tried)
    assert (everywhere >= low).all()
    assert (everywhere <= high).all()
    assert found.gains.tolist() == [1.0, 2.0, 3.0]
    assert found.evaluations == len(everywhere)


def test_infinite_costs_are_passed_by() -> None:
    def cost(places: Floats) -> Floats:
        return np.where(places[:, 0] > 0.0, np.sum(places**2, axis=1), np.inf)

    found = search(cost, LOW, HIGH, LOW, population=32)
    assert 0.0 < found.gains[0] < 0.01


def test_it_ends_where_all_cost_the_same() -> None:
    calls: list[int] = []
    search(
        lambda places: np.zeros(len(places)),
        LOW,
        HIGH,
        LOW,
        on_generation=lambda number, _: calls.append(number),
    )
    assert calls == [0]


def test_gains_have_four_significant_digits() -> None:
    gains = np.array([[1.23456, 0.000123456, 123456.0]])
    assert rounded(gains).tolist() == [[1.235, 0.0001235, 123500.0]]


def test_the_labs_road_is_held_to_8_5_mm_s_and_no_better_than_can_be() -> None:
    goal = Goal((Course(),), Cost())
    start, high = np.array([*GAINS.values()]).T
    found = search(goal, np.zeros(3), high, start, seed=1)
    assert 0.0066 <= found.cost <= 0.0085


def test_a_goal_over_several_courses_is_their_mean() -> None:
    courses = (Course(), Course(noise=0.1), Course(delay=0.04))
    gains = np.array([[20.0, 100.0, 0.1], [10.0, 20.0, 0.0]])
    cost = Cost('max', 0.1)
    alone = [Goal((course,), cost)(gains) for course in courses]
    assert Goal(courses, cost)(gains) == pytest.approx(np.mean(alone, axis=0))


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
