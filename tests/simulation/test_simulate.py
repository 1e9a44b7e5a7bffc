"""`simulate`: a run by keywords."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from barc_sim.control.pid import speed_controller
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import closed_loop, simulate
from barc_sim.simulation.metrics import summary
from barc_sim.vehicle.actuators import Actuator
from barc_sim.vehicle.bike_model import Vehicle, bikeFE
from barc_sim.vehicle.parameters import PARAMETERS, plant
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.sensor import NoiseLevels

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.simulation.log import Log


def test_a_step_counts_in_whole_nanoseconds_as_the_nodes_rate_does() -> None:
    plant_of_node = plant({row.name: row.default for row in PARAMETERS} | {'rate': 333.0})
    assert simulate(ts=1 / 333, distance=30.0) == closed_loop(plant_of_node, distance=30.0)


def assert_same(left: Log, right: Log) -> None:
    for ours, theirs in zip(left.columns().values(), right.columns().values(), strict=True):
        assert ours.tobytes() == theirs.tobytes()


def test_keywords_make_plant_and_controller() -> None:
    vehicle = Vehicle(mass=1000.0)
    ours = simulate(
        10.0,
        20.0,
        0.5,
        road='flat',
        vehicle=vehicle,
        noise=0.1,
        delay=0.04,
        speed_reference=5.0,
        distance=30.0,
        seed=3,
        acceleration_limit=4.0,
        integrator='rk4',
        ts=0.01,
    )
    plant = Plant(
        road=Road.flat(),
        vehicle=vehicle,
        noise=NoiseLevels(v_x=0.1),
        seed=3,
        motor=Actuator(delay=0.04),
        integrator='rk4',
        ts=0.01,
    )
    pid = speed_controller(10.0, 20.0, 0.5, limit=4.0)
    assert_same(ours, closed_loop(plant, pid, speed_reference=5.0, distance=30.0))


def test_a_road_is_an_object_a_name_or_a_file(tmp_path: Path) -> None:
    file = tmp_path / 'hills.csv'
    file.write_text('start_m,grade_deg\n0,0\n10,5\n')
    road = Road((0.0, 10.0), (0.0, 5.0))
    assert_same(simulate(road=file, distance=30.0), simulate(road=road, distance=30.0))
    assert_same(simulate(road=str(file), distance=30.0), simulate(road=road, distance=30.0))
    with pytest.raises(UserError, match=r"road 'nowhere.csv' is neither"):
        simulate(road='nowhere.csv')


class LabPid:
    """As students write it."""

    def __init__(self) -> None:
        self.integral = 0.0

    def acc_calculate(self, speed_reference: float, speed_current: float) -> float:
        """Return the acceleration."""
        error = speed_reference - speed_current
        self.integral += 20.0 * error * 0.02
        return 10.0 * error + self.integral


def test_a_controller_of_two_arguments_drives_within_the_limit_from_its_beginning() -> None:
    own = LabPid()
    first, second = simulate(controller=own), simulate(controller=own)
    assert first.x[-1] >= 180.0
    assert np.abs(first.motor).max() == 8.0
    assert_same(first, second)


def test_gains_beside_a_controller_are_refused() -> None:
    with pytest.raises(UserError, match=r'kp, kd are gains of the PID'):
        simulate(kp=1.0, kd=2.0, controller=LabPid())


def test_a_vehicle_that_is_none_is_refused() -> None:
    with pytest.raises(UserError, match="vehicle 'x' must be of type Vehicle"):
        simulate(vehicle='x')  # type: ignore[arg-type]


def test_a_model_is_called_as_bikefe() -> None:
    def lab_model(*args: float) -> list[float]:
        return bikeFE(*args)

    def with_options(*args: float, l_f: float, l_r: float, g: float) -> list[float]:
        return bikeFE(*args, l_f=l_f, l_r=l_r, g=g)

    expected = simulate(distance=30.0)
    assert_same(simulate(model=lab_model, distance=30.0), expected)
    assert_same(simulate(model=with_options, distance=30.0), expected)


# A reference that changes, a disturbance, a late sensor


def test_the_log_and_the_scores_follow_a_reference_over_time(tmp_path: Path) -> None:
    file = tmp_path / 'reference.csv'
    file.write_text('time_s,speed_mps\n0,4\n5,4\n5,9\n8,6\n', encoding='utf-8')
    log = simulate(reference=file)
    assert log.reference[[0, 249, 250, 325, -1]].tolist() == [4.0, 4.0, 9.0, 7.5, 6.0]
    assert np.abs(log.speed_error[log.t > 9.0]).max() < 0.2
    before = log.map(lambda column: column[:250])
    assert summary(log).overshoot == summary(before).overshoot < 0.05
    assert (summary(log).max_error, summary(before).max_error) == (5.0, 4.0)


def test_a_function_of_the_measured_place_is_a_reference(tmp_path: Path) -> None:
    file = tmp_path / 'reference.csv'
    file.write_text('distance_m,speed_mps\n0,4\n50,4\n50,6\n', encoding='utf-8')
    log = simulate(reference=lambda _, x: 4.0 if x < 50.0 else 6.0, noise=NoiseLevels(s=0.5))
    assert log == simulate(reference=file, noise=NoiseLevels(s=0.5))
    assert (log.reference == np.where(log.x < 50.0, 4.0, 6.0)).all()


def test_a_constant_function_is_the_number() -> None:
    assert simulate(reference=lambda *_: 5.0) == simulate(speed_reference=5.0)
    wind = simulate(disturbance=-900.0)
    assert wind == simulate(disturbance=lambda *_: -900.0)
    assert wind != simulate()


def test_a_late_sensor_makes_the_loop_swing() -> None:
    punctual, late = simulate(road='flat'), simulate(road='flat', sensor_delay=0.06)
    assert summary(late).overshoot > 2.0 * summary(punctual).overshoot
    assert late.speed[4:-3].tolist() == pytest.approx(late.v_x[7:].tolist())
