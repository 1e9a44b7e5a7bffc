"""The closed forms that errors are judged against, checked by what they solve."""

from __future__ import annotations

from math import radians, sin

import pytest

from barc_sim.simulation.convergence import drive
from barc_sim.simulation.reference_drives import REFERENCE_DRIVES, ReferenceDrive
from barc_sim.vehicle.bike_model import Command, State

EXACT = [test_drive for test_drive in REFERENCE_DRIVES if test_drive.exact]


@pytest.mark.parametrize('test_drive', EXACT, ids=lambda test_drive: test_drive.name)
@pytest.mark.parametrize('share', [0.1, 0.55, 1.0])
def test_closed_form_is_where_a_fine_solution_goes(
    test_drive: ReferenceDrive, share: float
) -> None:
    assert test_drive.exact
    part = test_drive._replace(duration=share * test_drive.duration)
    found = drive(part, 'kinematic', 'rk4', 1e-3)
    # On the lab's road a step of 1 ms at 10 m/s is 1 cm of the wrong grade, at each jump.
    tolerance = 2e-2 if test_drive.name == "lab's road" else 1e-8
    assert found[:2] == pytest.approx(test_drive.exact(part), abs=tolerance)


def test_car_on_the_labs_road_is_where_its_stretches_take_it() -> None:
    (lab,) = (test_drive for test_drive in REFERENCE_DRIVES if test_drive.name == "lab's road")
    assert lab.exact
    unresisted = lab._replace(start=State(v=10.0), held=Command(0.01711 / 2000.0))
    assert lab.exact(unresisted._replace(duration=1.5)) == pytest.approx((15.0, 0.0))
    climbed = 10.0 - 0.5 * 9.8 * sin(radians(10.0))
    assert lab.exact(unresisted._replace(duration=3.0)) == pytest.approx((20.0 + climbed, 0.0))
    assert lab.exact(lab)[0] > 100.0


def test_dynamic_bicycle_stays_dynamic_in_its_drive() -> None:
    for test_drive in REFERENCE_DRIVES:
        if 'dynamic' in test_drive.models:
            for share in (0.0, 0.5, 1.0):
                part = test_drive._replace(duration=share * test_drive.duration)
                assert drive(part, 'dynamic', 'rk4', 0.01).v > 3.0
