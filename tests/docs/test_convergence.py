"""The study of the explanation: each integrator has the order that it is known for."""

from __future__ import annotations

import pytest
from convergence import (
    REFERENCE_DRIVES,
    ReferenceDrive,
    Study,
    final_state,
    studies,
)

#: The integrators' own tests are quick.
pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def all_studies() -> list[Study]:
    return [*studies()]


def test_errors_fall_with_the_integrators_order_where_the_grade_does_not_change(
    all_studies: list[Study],
) -> None:
    smooth = [study for study in all_studies if study.test_drive.name != "lab's road"]
    for study in smooth:
        expected = {'euler': 1, 'rk4': 4}[study.integrator]
        assert study.order == pytest.approx(expected, abs=0.1 * expected), study


def test_rk4_errors_are_far_smaller_where_the_grade_does_not_change(
    all_studies: list[Study],
) -> None:
    for euler, rk4 in zip(all_studies[::2], all_studies[1::2], strict=True):
        assert rk4.errors[0] < euler.errors[0]
        if euler.test_drive.name != "lab's road":
            assert rk4.errors[0] < 1e-4 * euler.errors[0]


def test_jumps_of_the_grade_reduce_the_order_of_both_integrators(all_studies: list[Study]) -> None:
    lab = [study for study in all_studies if study.test_drive.name == "lab's road"]
    assert lab
    for study in lab:
        assert 0.3 < study.order < 1.5
        assert study.errors[-1] > 1e-3


@pytest.mark.parametrize('drive', REFERENCE_DRIVES, ids=lambda drive: drive.name)
@pytest.mark.parametrize('share', [0.1, 0.55, 1.0])
def test_closed_form_equals_a_solution_in_short_steps(drive: ReferenceDrive, share: float) -> None:
    if drive.exact:
        part = drive._replace(duration=share * drive.duration)
        end = final_state(part, 'kinematic', 'rk4', 1e-3)
        # On the lab's road a step of 1 ms at 10 m/s is 1 cm of the wrong grade, at each jump.
        tolerance = 2e-2 if drive.name == "lab's road" else 1e-8
        assert end[:2] == pytest.approx(drive.exact(part), abs=tolerance)
