"""Wrong and unusual programs of Lab 5: the remark, its line, and the points.

A program is a right one, and what is replaced in it. All have 90 points at most: 10 are judged by
eye.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from user_files import IDENTIFY as RIGHT
from user_files import points_of, read_programs, replaced

from barc_sim.lab.grade.grade import load_rubric
from barc_sim.lab.labs.identify import NOISE, car_of, evidence_of, measured

if TYPE_CHECKING:
    from pathlib import Path

PROGRAMS = read_programs('wrong_estimates.txt')
RUBRIC = load_rubric('identify')


@pytest.mark.parametrize('name', PROGRAMS)
def test_a_wrong_estimate_gets_its_points_sentence_and_line(tmp_path: Path, name: str) -> None:
    program = PROGRAMS[name]
    points = points_of(program, replaced(RIGHT, *program.changes), RUBRIC, tmp_path)
    assert points == pytest.approx(program.points, abs=1.5)


def test_each_name_has_a_car_of_its_own_that_is_the_same_each_time() -> None:
    cars = [car_of(f'student {k}') for k in range(40)]
    assert len({*cars}) == 40
    assert cars[7] == car_of('student 7')
    assert all(0.04 <= car.delay <= 0.16 for car in cars)


def test_the_bound_is_that_of_a_right_estimate() -> None:
    """Of 40 estimates as many are inside as an interval of 95 % promises, and none is better."""
    names: dict[str, object] = {}
    exec(RIGHT, names)  # noqa: S102 (ours)
    estimate, command = names['estimate'], names['command']
    times = [0.02 * k for k in range(3000)]
    commands = tuple(command(t) for t in times)  # type: ignore[operator]
    errors, ratios = [], []
    for k in range(12):
        car = car_of(f'bound {k}')
        estimated = np.array(estimate(times, measured(car, commands), commands))  # type: ignore[operator]
        errors.append(np.abs(estimated[::2] - car) <= estimated[1::2])
        ratios.append(estimated[1::2] / car.intervals(commands))

    assert np.mean(errors) > 0.85
    assert np.allclose(ratios, 1.0, atol=0.15)
    assert NOISE > 0.0


@pytest.mark.parametrize('estimate', [[1e300] * 6, [-1.0] * 6, [0.0] * 6])
def test_any_estimate_can_be_drawn(estimate: list[float]) -> None:
    drive = evidence_of(car_of(''), [2.0] * 100 + [0.0] * 2900, estimate)
    assert len(drive.figure('any').axes) == 2
    assert len(drive.rows) == 3
