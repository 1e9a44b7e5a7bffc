"""The search for the minimum cost, what it minimises, and `sweep`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim.commands.research import GAINS
from barc_sim.control.lane import LaneLQR
from barc_sim.control.speed import LQR
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import simulate
from barc_sim.simulation.metrics import summary
from barc_sim.tuning.search import rounded, search
from barc_sim.tuning.sweep import SCORES, sweep

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

LOW, HIGH = np.array([-5.12] * 3), np.array([5.12] * 3)


def rastrigin(places: Floats) -> Floats:
    """Return a bowl with a thousand local minima in the range; the least, 0, is at (1, 1, 1)."""
    x = places - 1.0
    return np.asarray(np.sum(x**2 + 10.0 - 10.0 * np.cos(2.0 * np.pi * x), axis=1))


@pytest.mark.parametrize('seed', range(3))
def test_the_search_finds_the_lowest_of_many_minima(seed: int) -> None:
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


def test_the_search_ends_where_all_costs_are_equal() -> None:
    found = search(lambda places: np.zeros(len(places)), LOW, HIGH, LOW, population=24)
    assert found.evaluations == 24


def test_gains_have_four_significant_digits() -> None:
    gains = np.array([[1.23456, 0.000123456, 123456.0]])
    assert rounded(gains).tolist() == [[1.235, 0.0001235, 123500.0]]


def test_the_labs_road_is_held_to_8_5_mm_s_and_no_better_than_can_be() -> None:
    start, high = np.array([*GAINS.values()]).T
    found = search(lambda gains: sweep(*gains.T).rms_error, np.zeros(3), high, start, seed=1)
    assert 0.0066 <= found.cost <= 0.0085


@pytest.mark.parametrize(
    'options',
    [
        {},
        {'noise': 0.05, 'seed': 2, 'delay': 0.04, 'ts': 1 / 333},
        {'delay': 0.03, 'integrator': 'rk4', 'acceleration_limit': 3.0},
        {'sensor_delay': 0.05, 'noise': 0.05},
        {'dynamics': 'dynamic', 'disturbance': -300.0, 'noise': 0.05},
        {'disturbance': lambda _, x: -300.0 if x > 20.0 else 0.0},
        {'track': 'oval', 'lane': LaneLQR()},
        {'track': 'oval', 'lane': LaneLQR(), 'sensor_delay': 0.05},
    ],
)
def test_a_sweep_scores_the_runs_of_simulate(options: dict[str, Any]) -> None:
    found = sweep([10.0, 30.0], ki=100.0, distance=60.0, **options)
    for each in found:
        log = simulate(each.kp, each.ki, each.kd, distance=60.0, **options)
        expected = summary(log)
        assert each.rms_error == pytest.approx(expected.rms_error_after_run_up)
        assert each.max_error == pytest.approx(expected.max_error_after_run_up)
        assert each.overshoot == pytest.approx(expected.overshoot)
        assert each.effort == pytest.approx(np.sqrt(np.mean(log.motor**2)))


@pytest.mark.parametrize('options', [{}, {'integrator': 'rk4'}])
def test_each_seed_scores_the_run_of_simulate_with_it(options: dict[str, Any]) -> None:
    seeds = np.array([[3], [0], [3]])
    found = sweep([10.0, 30.0], noise=0.1, seed=seeds, distance=30.0, **options)
    assert found.shape == (3, 2)
    assert found.seed[:, 0].tolist() == [3, 0, 3]
    for each in found.flat:
        log = simulate(each.kp, seed=int(each.seed), noise=0.1, distance=30.0, **options)
        assert each.rms_error == pytest.approx(summary(log).rms_error_after_run_up)
    assert found.rms_error[0].tolist() == found.rms_error[2].tolist()


def test_runs_that_take_long_have_the_noise_of_simulate_to_their_end() -> None:
    options: dict[str, Any] = {'noise': 0.1, 'distance': 30.0, 'ts': 0.001}
    found = sweep([5.0, 30.0], seed=[4, 4], **options)
    for each in found:
        log = simulate(each.kp, seed=4, **options)
        assert len(log) > 2048
        assert each.effort == pytest.approx(np.sqrt(np.mean(log.motor**2)))


@pytest.mark.parametrize('seed', [[1.5], [-1], ['a'], [2**60]])
def test_an_impossible_seed_is_refused(seed: Sequence[object]) -> None:
    with pytest.raises(UserError, match='seed'):
        sweep(noise=0.1, seed=seed)


def test_gains_are_broadcast_and_the_best_is_found_by_name() -> None:
    kp, ki = np.linspace(0.0, 60.0, 20), np.linspace(0.0, 400.0, 10)
    found = sweep(kp[:, np.newaxis], ki, 0.0, distance=40.0)
    assert found.shape == (20, 10)
    assert all(np.isinf(found[score][0, 0]) for score in SCORES)  # it never arrives
    best = found.flat[found.rms_error.argmin()]
    assert (best.kp, best.ki) == (60.0, 400.0)
    assert best.rms_error == found.rms_error.min()


def test_a_sweep_of_another_controller_is_a_table_of_its_gains() -> None:
    frame = sweep(controller=LQR(), speed_weight=[100.0, 400.0], distance=30.0).to_frame()
    assert [*frame] == [*LQR.gains, 'rms_error', 'max_error', 'overshoot', 'effort']
    assert frame.speed_weight.tolist() == [100.0, 400.0]
    expected = summary(simulate(controller=LQR(speed_weight=100.0), distance=30.0))
    assert frame.rms_error[0] == expected.rms_error_after_run_up


class WithoutGains:
    """A controller without gains."""

    def acc_calculate(self, _reference: float, _current: float, /) -> float:
        """Return no acceleration."""
        return 0.0


@pytest.mark.parametrize(
    ('gains', 'complaint'),
    [
        ({'kp': [1.0, np.nan]}, 'kp: nan is not a number from'),
        (
            {'kp': 1.0, 'controller': LQR()},
            'kp: this controller has no such gain, but speed_weight',
        ),
        ({'controller': LQR(), 'observer_gain': [0.5, 2.0]}, 'observer_gain: 2 is not a number'),
        ({'controller': WithoutGains()}, 'the controller has no gains to sweep'),
    ],
)
def test_gains_that_a_controller_cannot_have_are_refused(
    gains: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(UserError, match=complaint):
        sweep(**gains)
