"""What `identify` predicts: compiled loops give the numbers of Python."""

from __future__ import annotations

import numpy as np
import pytest

from barc_sim.tuning.identification import is_worth_compiling
from barc_sim.tuning.prediction import CarModel, HeldValues, Stretch, predict
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.law import is_compiled
from barc_sim.vehicle.plant import Actuator

needs_numba = pytest.mark.skipif(not is_compiled(), reason='needs the extra fast')
CAR = Vehicle(mass=1500.0, air_drag_coeff=0.6, friction=120.0)
LATE = Actuator(delay=0.033, lag=0.12)


def drive(seed: int, *, is_steered: bool, seconds: float = 8.0) -> Stretch:
    """Return a drive with commands that change at times of their own."""
    random = np.random.default_rng(seed)
    t = np.round(np.arange(0.0, seconds, 0.02), 9)
    at = np.round(np.sort(random.uniform(0.0, seconds, 40)), 9)
    motor = HeldValues(np.append(0.0, at), np.append(3.0, random.uniform(-3.0, 3.5, 40)))
    angles = random.uniform(-0.2, 0.2, 41) if is_steered else np.zeros(41)
    servo = HeldValues(motor.t, angles)
    sines = np.sin(random.uniform(-0.05, 0.05, len(t)))
    return Stretch(t, motor, servo, sines, np.zeros((3, len(t))), True, ())


@needs_numba
@pytest.mark.parametrize('integrator', ['euler', 'rk4'])
@pytest.mark.parametrize('lateral', [None, LateralParameters()])
@pytest.mark.parametrize('servo', [None, Actuator(), LATE])
@pytest.mark.parametrize('motor', [Actuator(), LATE])
def test_compiled_predictions_are_those_of_python(
    integrator: str, lateral: LateralParameters | None, servo: Actuator | None, motor: Actuator
) -> None:
    car = CarModel(CAR, motor, servo, lateral, integrator)
    for seed in range(5):
        stretch = drive(seed, is_steered=servo is not None)
        for v in (0.0, 6.0):
            expected = predict(stretch, car, v)
            assert np.isfinite(expected).all()
            found = predict(stretch, car, v, is_fast=True)
            assert found.tobytes() == expected.tobytes()


@needs_numba
def test_a_car_that_is_unstable_has_infinite_speeds() -> None:
    stretch = drive(0, is_steered=False)
    car = CarModel(CAR._replace(air_drag_coeff=-1e9), Actuator())
    for is_fast in (False, True):
        assert np.isinf(predict(stretch, car, 5.0, is_fast=is_fast)[0]).any()


def test_compiling_is_for_drives_that_are_long_or_steered() -> None:
    straight = drive(0, is_steered=False)
    assert not is_worth_compiling([straight])
    assert is_worth_compiling([straight] * 30) == is_compiled()
    assert is_worth_compiling([drive(0, is_steered=True)]) == is_compiled()
