"""The closed forms of the linear bicycle: against one another, limits, and a textbook's car."""

from __future__ import annotations

from math import inf

import pytest

from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.lateral_dynamics import (
    LateralParameters,
    characteristic_speed,
    critical_speed,
    eigenvalues,
    lateral_matrix,
    side_slip_gain,
    understeer_gradient,
    yaw_gain,
)

#: Rajamani's passenger car, 80,000 N/rad to a tyre.
BOOK = Vehicle(mass=1573.0, l_f=1.1, l_r=1.58)
BOOK_HANDLING = LateralParameters(2873.0, 160e3, 160e3)
OVERSTEERING = LateralParameters(4000.0, 160e3, 120e3)
NEUTRAL = LateralParameters(4000.0, 140e3, 140e3)
CAR = Vehicle()


def test_defaults_understeer() -> None:
    assert understeer_gradient(CAR, LateralParameters()) > 0.0


def test_textbook_car_has_the_gradient_of_the_textbooks_formula() -> None:
    front, rear = 1573.0 * 1.58 / 2.68, 1573.0 * 1.1 / 2.68  # [kg] on each axle
    expected = front / (2.0 * 80e3) - rear / (2.0 * 80e3)
    assert understeer_gradient(BOOK, BOOK_HANDLING) == pytest.approx(expected)


@pytest.mark.parametrize(
    ('vehicle', 'lateral'), [(CAR, LateralParameters()), (BOOK, BOOK_HANDLING), (CAR, OVERSTEERING)]
)
@pytest.mark.parametrize('v', [2.0, 8.0, 20.0])
def test_gains_solve_the_linear_equations(
    vehicle: Vehicle, lateral: LateralParameters, v: float
) -> None:
    (a, b), (c, d) = lateral_matrix(vehicle, lateral, v)
    v_y, psi_dot = side_slip_gain(vehicle, lateral, v), yaw_gain(vehicle, lateral, v)
    per_steer = lateral.front_stiffness
    assert a * v_y + b * psi_dot == pytest.approx(-per_steer / vehicle.mass)
    moment = vehicle.l_f * per_steer / lateral.yaw_inertia
    assert c * v_y + d * psi_dot == pytest.approx(-moment)


def test_yaw_gain_is_greatest_at_the_characteristic_speed() -> None:
    v = characteristic_speed(CAR, LateralParameters())
    assert yaw_gain(CAR, LateralParameters(), v) == pytest.approx(v / (2.0 * 3.0))
    for other in (0.9 * v, 1.1 * v):
        assert yaw_gain(CAR, LateralParameters(), other) < yaw_gain(CAR, LateralParameters(), v)


def test_critical_speed_is_where_stability_ends() -> None:
    v = critical_speed(CAR, OVERSTEERING)
    assert eigenvalues(CAR, OVERSTEERING, 0.99 * v)[0].real < 0.0
    assert eigenvalues(CAR, OVERSTEERING, 1.01 * v)[0].real > 0.0
    assert abs(eigenvalues(CAR, OVERSTEERING, v)[0]) < 1e-9


def test_neutral_car_has_neither_speed() -> None:
    assert understeer_gradient(CAR, NEUTRAL) == 0.0
    assert characteristic_speed(CAR, NEUTRAL) == critical_speed(CAR, NEUTRAL) == inf
    assert (
        critical_speed(CAR, LateralParameters()) == characteristic_speed(CAR, OVERSTEERING) == inf
    )


@pytest.mark.parametrize('v', [3.0, 15.0, 40.0])
def test_eigenvalues_have_the_matrixs_trace_and_determinant(v: float) -> None:
    (a, b), (c, d) = lateral_matrix(BOOK, BOOK_HANDLING, v)
    first, second = eigenvalues(BOOK, BOOK_HANDLING, v)
    assert first + second == pytest.approx(a + d)
    assert first * second == pytest.approx(a * d - b * c)
    assert first.real >= second.real
