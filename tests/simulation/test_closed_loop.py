"""The closed loop without ROS."""

from __future__ import annotations

from math import radians
from typing import TYPE_CHECKING

import numpy as np
import pytest

from barc_sim.control.pid import FIRST_DT, PID, speed_controller
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.metrics import summary
from barc_sim.vehicle.bike_model import Vehicle, bikeFE
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.sensor import NoiseLevels

if TYPE_CHECKING:
    from barc_sim.simulation.log import Log


@pytest.fixture(scope='module')
def lab_run() -> Log:
    return closed_loop()


# The defaults


def test_default_gains_hold_the_speed_within_the_goal(lab_run: Log) -> None:
    told = summary(lab_run)
    assert told.rms_error_after_run_up <= 0.035
    assert told.max_error_after_run_up <= 0.17
    # The least that any controller of this loop can reach.
    assert told.rms_error_after_run_up >= 0.0066
    assert told.max_error_after_run_up >= 0.098


def test_closed_loop_is_the_lab_templates_loop(lab_run: Log) -> None:
    """A user's plain loop over bikeFE and the controller, with nothing else of ours."""
    x = y = psi = v = 0.0
    pid, road, vehicle = speed_controller(), Road.lab(), Vehicle()
    states, commands = [], []
    while True:
        a = pid.acc_calculate(8.0, v)
        states.append((x, y, psi, v))
        commands.append(a)
        if x >= 180.0:
            break
        theta = radians(road.grade_deg(x))
        x, y, psi, v = bikeFE(
            x, y, psi, v, a, 0.0, vehicle.air_drag_coeff, 2000.0, vehicle.friction, theta, 0.02
        )
    columns = [lab_run.x, lab_run.y, lab_run.psi, lab_run.v_x]
    assert np.array_equal(np.column_stack(columns), np.array(states))
    assert np.array_equal(lab_run.motor, np.array(commands))


# What the log holds


def test_log_has_road_forces_and_terms_of_each_state(lab_run: Log) -> None:
    road = Road.lab()
    s = lab_run.x.tolist()
    assert lab_run.theta_deg.tolist() == [road.grade_deg(x) for x in s]
    assert lab_run.elevation.tolist() == [road.elevation(x) for x in s]
    assert lab_run.gravity == pytest.approx(-19600.0 * np.sin(np.radians(lab_run.theta_deg)))
    assert lab_run.drag == pytest.approx(-0.01308 * lab_run.v_x**2)
    assert lab_run.friction == pytest.approx(-0.01711 * (lab_run.v_x > 0.0))
    assert lab_run.proportional == pytest.approx(30.0 * (8.0 - lab_run.v_x))
    assert lab_run.derivative[1:] == pytest.approx(-0.1 * np.diff(lab_run.v_x) / 0.02)
    steps = 200.0 * 0.02 * (8.0 - lab_run.v_x)
    integrated = ~lab_run.saturated[1:]
    assert np.diff(lab_run.integral)[integrated] == pytest.approx(steps[1:][integrated], abs=1e-9)
    total = lab_run.proportional + lab_run.integral + lab_run.derivative
    free = ~lab_run.saturated
    assert lab_run.motor[free] == pytest.approx(total[free])
    for still in (lab_run.y, lab_run.psi, lab_run.v_y, lab_run.psi_dot, lab_run.servo):
        assert not still.any()
    for error in (lab_run.e_s, lab_run.e_ey, lab_run.e_epsi, lab_run.e_v_x, lab_run.e_v_y):
        assert not error.any()
    assert not lab_run.e_psi_dot.any()
    assert not lab_run.missed.any()


def test_controller_sees_what_the_sensor_measures() -> None:
    log = closed_loop(Plant(noise=NoiseLevels(v_x=0.5)), PID(1.0, 0.0, 0.0), distance=20.0)
    assert log.e_v_x.any()
    assert log.motor == pytest.approx(8.0 - log.v_x)


# Where it ends


@pytest.mark.parametrize('distance', [5.0, 42.0, 180.0])
def test_last_row_is_the_first_state_at_or_beyond_the_distance(distance: float) -> None:
    log = closed_loop(distance=distance)
    assert log.x[-1] >= distance > log.x[-2]


def test_true_position_ends_the_run() -> None:
    plant = Plant(noise=NoiseLevels(s=5.0), seed=1)
    log = closed_loop(plant, distance=30.0)
    assert log.distance[-1] >= 30.0
    assert log.distance[-2] < 30.0 < log.x[:-1].max()


@pytest.mark.parametrize(('duration', 'states'), [(0.0, 1), (0.06, 4), (1.0, 51)])
def test_run_that_does_not_arrive_ends_after_its_longest_duration(
    duration: float, states: int
) -> None:
    log = closed_loop(max_duration=duration)
    assert len(log) == states
    assert log.t[-1] == pytest.approx(duration)


# What it is given


def test_interval_is_that_of_stamps_in_whole_nanoseconds() -> None:
    seen: list[float | None] = []

    class Spy(PID):
        def acc_calculate(
            self, speed_reference: float, speed_current: float, dt: float | None = None
        ) -> float:
            seen.append(dt)
            return super().acc_calculate(speed_reference, speed_current, dt)

    log = closed_loop(Plant(ts=1.0 / 30.0), Spy(1.0, 0.0, 0.0), max_duration=0.1)
    assert seen == [FIRST_DT] + [33_333_333 / 1e9] * 3
    assert log.t[3] == 99_999_999 / 1e9


# Driving by hand
