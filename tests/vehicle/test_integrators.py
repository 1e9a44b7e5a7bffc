"""Forward Euler and Runge-Kutta against solutions known in closed form."""

from __future__ import annotations

from cmath import exp
from math import cos, log2, sin
from math import exp as real_exp

import pytest

from barc_sim.vehicle.integrators import INTEGRATORS


def turned(name: str, steps: int) -> float:
    """Return the error of an oscillation after 2 s."""
    state: tuple[float, ...] = (1.0, 0.0)
    for _ in range(steps):
        state = INTEGRATORS[name].step(lambda at: (at[1], -at[0]), state, 2.0 / steps)
    return abs(complex(*state) - complex(cos(2.0), -sin(2.0)))


@pytest.mark.parametrize('name', ['euler', 'rk4'])
def test_error_falls_with_the_declared_order(name: str) -> None:
    order = log2(turned(name, 256) / turned(name, 512))
    assert order == pytest.approx(INTEGRATORS[name].order, abs=0.02)


def test_euler_takes_the_slope_at_the_beginning() -> None:
    assert INTEGRATORS['euler'].step(lambda at: (at[1], 5.0), (1.0, 2.0), 0.5) == (2.0, 4.5)


@pytest.mark.parametrize('name', ['euler', 'rk4'])
@pytest.mark.parametrize('rate', [-3.0, -40.0, 2.0])
def test_amplification_is_what_a_step_does(name: str, rate: float) -> None:
    method = INTEGRATORS[name]
    (after,) = method.step(lambda at: (rate * at[0],), (1.0,), 0.05)
    assert method.amplification(rate * 0.05) == pytest.approx(abs(after))


def test_amplification_of_short_steps_is_the_true_one() -> None:
    z = complex(-0.01, 0.02)
    assert INTEGRATORS['rk4'].amplification(z) == pytest.approx(abs(exp(z)), rel=1e-9)
    assert INTEGRATORS['euler'].amplification(-1e-6) == pytest.approx(real_exp(-1e-6))


@pytest.mark.parametrize(('name', 'limit'), [('euler', 2.0), ('rk4', 2.785)])
def test_decay_becomes_growth_at_the_methods_limit(name: str, limit: float) -> None:
    method = INTEGRATORS[name]
    assert method.amplification(-0.999 * limit) < 1.0 < method.amplification(-1.001 * limit)
