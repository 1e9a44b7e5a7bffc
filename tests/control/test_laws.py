"""Laws of control: compiled, they give Python's numbers to the last bit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim.control.lane import (
    POINTS,
    LaneLqrGains,
    ProfileColumns,
    PursuitGains,
    StanleyGains,
    lane_lqr,
    profile_speed,
    pure_pursuit,
    pursuit_step,
    stanley,
    steady_turn,
    steering_angle,
)
from barc_sim.control.speed import (
    LqrGains,
    LqrMemory,
    PidGains,
    PidMemory,
    lqr,
    pid,
)
from barc_sim.vehicle.law import compiled, is_compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

DRAWS = 10_000
SEGMENTS = 7
#: Of each row that is drawn: the name of the value, and its limits.
VALUES = {
    'e_y': (-3.0, 3.0),
    'e_psi': (-3.2, 3.2),
    'speed': (-20.0, 50.0),
    'curvature': (-0.2, 0.2),
    'ahead': (-0.2, 0.2),
    'l_f': (0.5, 3.0),
    'l_r': (0.5, 3.0),
    'first': (1e-3, 10.0),
    'second': (1e-3, 10.0),
    'third': (0.0, 1.0),
    'limit': (0.5, 8.0),
    'dt': (-0.002, 0.05),
    'place': (0.0, 10.0),
}
#: The columns of each law among the results.
RESULTS = {
    'steady_turn': slice(0, 2),
    'lane_lqr': slice(2, 6),
    'stanley': slice(6, 10),
    'pure_pursuit': slice(10, 12),
    'profile_speed': slice(12, 13),
    'pid': slice(13, 18),
    'lqr': slice(18, 22),
}
COLUMNS = 22


def results_of(arguments: Any, profile: Any, bends: Any, results: Any) -> None:  # noqa: ANN401
    """Store what each law returns for each row, in columns as `RESULTS` has them."""
    memory = PidMemory(0.0, np.nan)
    observed = LqrMemory(0.0, 0.0, np.nan)
    for i in range(len(arguments)):
        e_y, e_psi, speed, curvature, ahead, l_f, l_r = arguments[i][:7]
        first, second, third, limit, dt, place = arguments[i][7:]
        row = results[i]

        row[0], row[1] = steady_turn(curvature, l_f, l_r)
        terms = lane_lqr(LaneLqrGains(first, second, l_f, l_r), e_y, e_psi, curvature, ahead)
        row[2], row[3], row[4] = terms
        row[5] = steering_angle(terms)

        terms = stanley(StanleyGains(first, second, l_f), e_y, e_psi, speed, curvature)
        row[6], row[7], row[8] = terms
        row[9] = steering_angle(terms)

        pursuit = PursuitGains(first, third, l_f, l_r)
        step = pursuit_step(pursuit, speed)
        row[10] = step
        row[11] = steering_angle(pure_pursuit(pursuit, e_y, e_psi, step, bends[i]))

        row[12] = profile_speed(profile, i % SEGMENTS, place)

        gains = PidGains(first, second, third, -limit, limit)
        memory, answer = pid(memory, gains, 8.0, speed, dt)
        row[13], row[14] = memory
        row[15] = answer.output
        row[16] = answer.proportional
        row[17] = answer.derivative

        weights = LqrGains(first, second, third, 0.02, -limit, limit)
        observed, answered = lqr(observed, weights, 8.0, speed, dt)
        row[18] = observed.compensation
        row[19] = observed.previous
        row[20] = answered.output
        row[21] = answered.feedback


@pytest.fixture(scope='module')
def numbers_of_both() -> tuple[Floats, Floats]:
    """Return the results in Python, and those of the compiled loop."""
    random = np.random.default_rng(43)
    low, high = np.array([*VALUES.values()]).T
    arguments = random.uniform(low, high, (DRAWS, len(VALUES)))
    bends = random.uniform(-0.2, 0.2, (DRAWS, POINTS))
    # Values at which a law takes another branch.
    for column, value in ((1, 0.0), (2, -0.0), (3, 0.0), (4, -0.0), (9, 0.0), (11, 0.0)):
        arguments[random.random(DRAWS) < 0.1, column] = value
    straight = random.random(DRAWS) < 0.1
    bends[straight] = 0.0
    arguments[:, 4] = np.where(straight, arguments[:, 3], arguments[:, 4])
    arguments[random.random(DRAWS) < 0.01, 2] = np.nan  # a measurement that is none

    lengths, limits, squares = random.uniform(1.0, 400.0, (3, SEGMENTS))
    profile = ProfileColumns(lengths, limits, squares, 2.0)
    compiled_results = np.full((DRAWS, COLUMNS), np.inf)
    compiled(results_of)(arguments, profile, bends, compiled_results)

    of_python = ProfileColumns(lengths.tolist(), limits.tolist(), squares.tolist(), 2.0)
    expected = [[np.inf] * COLUMNS for _ in range(DRAWS)]
    results_of(arguments.tolist(), of_python, bends.tolist(), expected)
    return np.array(expected), compiled_results


@pytest.mark.skipif(not is_compiled(), reason='needs the extra fast')
@pytest.mark.parametrize('name', RESULTS)
def test_a_compiled_law_gives_the_numbers_of_python(
    name: str, numbers_of_both: tuple[Floats, Floats]
) -> None:
    expected, results = (each[:, RESULTS[name]] for each in numbers_of_both)
    assert len(np.unique(expected[:, 0])) > DRAWS // 20
    np.testing.assert_array_equal(results, expected)
    assert (np.signbit(results) == np.signbit(expected))[~np.isnan(expected)].all()
