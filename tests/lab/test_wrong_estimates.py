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

from barc_sim.lab.grade.grade import load
from barc_sim.lab.labs.identify import NOISE, car_of, evidence_of, measured

if TYPE_CHECKING:
    from pathlib import Path

PROGRAMS = read_programs("""
right | 90 |  | right in all 5 cases
no excitation | 55 |  | the car does not move
    return 2.0⏎ -> return 0.0⏎
    return 2.0 * ( -> return 0.0 * (
beyond the limit | 85 |  | 2.5 m/s², but only 2 m/s² are allowed; it is too large from 0.00 s on
    return 2.0⏎    if -> return 2.5 if t < 4.0 else 2.0 if t < 6.0 else 0.0⏎    if
a force | 80 |  | is it a force? Return an acceleration; the car reaches 4343.2 m/s
    return 2.0⏎    if -> return 4000.0⏎    if
no number of a car | 50 |  | expected at most 1e+06
    return 2.0⏎    if -> return 1e308⏎    if
too fast | 85 |  | m/s, but only 15 m/s are allowed
    if t < 7.0 -> if t < 9.0
backwards | 85 |  | the car drives backwards
    return 0.0 -> return -1.0
too short | 50 |  | returned None; expected a finite number
    return 2.0 * ( -> return None if t > 50.0 else 2.0 * (
no command | 50 | raise | command is not written yet (TODO)
    if t < 7.0: -> raise NotImplementedError⏎    if t < 7.0:
friction by no mass | 80 |  | friction is multiplied by the mass
    friction, half[1] -> 2000 * friction, 2000 * half[1]
swapped | 82 |  | drag and friction are swapped
    return [drag, half[0], friction, half[1] -> return [friction, half[1], drag, half[0]
milliseconds | 81 |  | the delay is in milliseconds
    delay, half[2] -> 1000 * delay, 1000 * half[2]
the delay ignored | 59 |  | delay is always 0
    delay = delays[k] - p[1] / (2 * p[0]) -> delay = 0.0
a guess | 40 |  | delay is always 0.1
    return [drag, half[0], friction, half[1], delay -> return [2e-4, half[0], 0.09, half[1], 0.1
no friction | 49 |  | friction is always 0
    -moving -> 0.0 * moving
    np.linalg.inv -> np.linalg.pinv
drag that grows with v | 65 |  | drag is wrong
    smooth**2 -> smooth
one standard deviation | 84 |  | is it one standard deviation?
    1.96 * -> 1.0 *
intervals ten times as wide | 80 |  | too wide
    1.96 * -> 19.6 *
no interval | 75 |  | return intervals above 0
    1.96 * -> 0.0 *
three numbers | 40 | def estimate | six finite numbers
    return [drag, half[0], friction, half[1], delay, half[2]] -> return [drag, friction, delay]
a missing colon | 0 | def command | syntax error
    def command(t): -> def command(t)
""")
RUBRIC = load('identify')


@pytest.mark.parametrize('name', PROGRAMS)
def test_points_sentence_and_line(tmp_path: Path, name: str) -> None:
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
        found = np.array(estimate(times, measured(car, commands), commands))  # type: ignore[operator]
        errors.append(np.abs(found[::2] - car) <= found[1::2])
        ratios.append(found[1::2] / car.intervals(commands))
    assert np.mean(errors) > 0.85
    assert np.allclose(ratios, 1.0, atol=0.15)
    assert NOISE > 0.0


@pytest.mark.parametrize('found', [[1e300] * 6, [-1.0] * 6, [0.0] * 6])
def test_any_estimate_can_be_drawn(found: list[float]) -> None:
    drive = evidence_of(car_of(''), [2.0] * 100 + [0.0] * 2900, found)
    assert len(drive.figure('any').axes) == 2
    assert len(drive.rows) == 3
