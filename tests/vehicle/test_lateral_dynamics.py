"""The linear bicycle: against a textbook's car, and its eigenvalues against their matrix."""

from __future__ import annotations

import pytest

from barc_sim.vehicle.bicycles import (
    LateralParameters,
    eigenvalues,
    lateral_matrix,
    understeer_gradient,
)
from barc_sim.vehicle.bike_model import Vehicle

#: Rajamani's passenger car, 80,000 N/rad to a tyre.
BOOK = Vehicle(mass=1573.0, l_f=1.1, l_r=1.58)
BOOK_HANDLING = LateralParameters(2873.0, 160e3, 160e3)


def test_defaults_understeer_and_equal_axles_are_neutral() -> None:
    assert understeer_gradient(Vehicle(), LateralParameters()) > 0.0
    assert understeer_gradient(Vehicle(), LateralParameters(4000.0, 140e3, 140e3)) == 0.0


def test_textbook_car_has_the_gradient_of_the_textbooks_formula() -> None:
    front, rear = 1573.0 * 1.58 / 2.68, 1573.0 * 1.1 / 2.68  # [kg] on each axle
    expected = front / (2.0 * 80e3) - rear / (2.0 * 80e3)
    assert understeer_gradient(BOOK, BOOK_HANDLING) == pytest.approx(expected)


@pytest.mark.parametrize('v', [3.0, 15.0, 40.0])
def test_eigenvalues_have_the_matrixs_trace_and_determinant(v: float) -> None:
    (a, b), (c, d) = lateral_matrix(BOOK, BOOK_HANDLING, v)
    first, second = eigenvalues(BOOK, BOOK_HANDLING, v)
    assert first + second == pytest.approx(a + d)
    assert first * second == pytest.approx(a * d - b * c)
    assert first.real >= second.real
