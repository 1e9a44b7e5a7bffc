"""The record of a run: what it takes, what it refuses, and that runs and nodes derive from it."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError, fields, replace
from inspect import signature
from math import inf
from typing import TYPE_CHECKING, Any

import pytest

from barc_sim.control.lane import LaneLQR, Stanley
from barc_sim.control.speed import LQR
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import lap, simulate
from barc_sim.simulation.scenario import Scenario
from barc_sim.simulation.stepper import parameters
from barc_sim.tuning.sweep import sweep
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.parameters import SERVO
from barc_sim.vehicle.plant import Actuator, NoiseLevels
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from pathlib import Path

FIELDS = [each.name for each in fields(Scenario)]
#: Of each argument of `simulate`, a value that is not its default.
OPTIONS: dict[str, Any] = {
    'kp': 10.0,
    'ki': 20.0,
    'kd': 0.0,
    'road': Road((0.0, 10.0), (1.0, 2.0)),
    'vehicle': Vehicle(mass=1500.0),
    'noise': NoiseLevels(ey=0.01),
    'delay': 0.04,
    'sensor_delay': 0.03,
    'disturbance': -50.0,
    'speed_reference': 4.0,
    'reference': 5.0,
    'distance': 20.0,
    'max_duration': 50.0,
    'seed': 3,
    'acceleration_limit': 4.0,
    'integrator': 'rk4',
    'dynamics': 'dynamic',
    'lateral': LateralParameters(yaw_inertia=3000.0),
    'ts': 0.01,
    'track': 'oval',
    'lane': LaneLQR(),
    'servo': Actuator(lag=0.05),
    'e_y': 0.5,
}


def test_simulate_has_the_fields_as_arguments_with_their_defaults() -> None:
    arguments = signature(simulate).parameters
    assert set(FIELDS) - set(arguments) == {'motor', 'laps'}
    assert set(arguments) - set(FIELDS) == {'scenario'}
    for field in fields(Scenario):
        if field.name in arguments:
            assert arguments[field.name].default == field.default, field.name


def test_a_scenario_gives_the_run_of_its_fields() -> None:
    scenario = Scenario(**OPTIONS)
    assert scenario.changes().keys() == OPTIONS.keys()
    log = simulate(**OPTIONS)
    assert len(log) > 100
    assert simulate(scenario=scenario) == log
    assert simulate(scenario=replace(scenario, seed=4)) != log


@pytest.mark.parametrize('options', [{}, {'controller': LQR(), 'road': 'flat'}])
def test_a_scenario_on_a_road_gives_the_run_of_its_fields(options: dict[str, Any]) -> None:
    assert simulate(scenario=Scenario(**options)) == simulate(**options)


def test_a_lap_of_a_scenario_without_a_steering_law_uses_the_default_one() -> None:
    scenario = Scenario(track='oval', laps=1, distance=0.0, speed_reference=6.0)
    assert lap(scenario=scenario) == lap(track='oval', laps=1)
    stanley = Stanley()
    assert lap(scenario=replace(scenario, lane=stanley)) == lap(stanley, 'oval', laps=1)


def test_a_run_stops_at_the_first_of_its_ends() -> None:
    oval = Track.named('oval')
    scenario = Scenario(track=oval, laps=2, distance=0.0, lane=LaneLQR())
    assert scenario.end == 2.0 * oval.length
    assert replace(scenario, distance=30.0).end == 30.0
    assert replace(scenario, laps=0).end == inf
    assert simulate(scenario=replace(scenario, distance=30.0)).distance[-1] < 31.0


def test_a_sweep_takes_a_scenario() -> None:
    scenario = Scenario(kp=20.0, noise=0.05, seed=2, distance=40.0, max_duration=30.0)
    table = sweep(ki=[10.0, 20.0], scenario=scenario)
    same = sweep(20.0, [10.0, 20.0], noise=0.05, seed=2, distance=40.0, max_duration=30.0)
    assert table.tolist() == same.tolist()
    by_law = sweep(speed_weight=[100.0], scenario=replace(scenario, kp=None, controller=LQR()))
    assert by_law.speed_weight.tolist() == [100.0]


def test_a_file_is_read_once(tmp_path: Path) -> None:
    road, wind, speed = (tmp_path / name for name in ('road.csv', 'wind.csv', 'speed.csv'))
    road.write_text('start_m,grade_deg\n0,0\n10,5\n', 'utf-8')
    wind.write_text('time_s,force_n\n0,-100\n', 'utf-8')
    speed.write_text('distance_m,speed_mps\n0,5\n', 'utf-8')
    scenario = Scenario(road=road, disturbance=wind, reference=str(speed), distance=20.0)
    expected = simulate(road=road, disturbance=wind, reference=speed, distance=20.0)
    for file in (road, wind, speed):
        file.unlink()
    again = pickle.loads(pickle.dumps(replace(scenario, seed=1)))  # noqa: S301 (our own)

    assert again == replace(scenario, seed=1) != scenario
    assert simulate(scenario=again) == expected  # there is no noise


def test_a_scenario_cannot_be_changed_and_its_text_makes_an_equal_one() -> None:
    scenario = Scenario(
        track='L', road='flat', laps=2, vehicle=Vehicle(mass=1500.0), motor=Actuator(lag=0.1)
    )
    with pytest.raises(FrozenInstanceError):
        scenario.seed = 1  # type: ignore[misc]

    text = repr(scenario)
    assert text.startswith("Scenario(road='flat', track='L', vehicle=Vehicle(mass=1500.0,")
    assert eval(text) == scenario  # noqa: S307 (our own)
    assert repr(Scenario()) == 'Scenario()'
    assert {scenario: 1}[replace(scenario)] == 1


def test_a_delay_is_that_of_both_actuators_unless_one_is_given() -> None:
    def actuators(**options: Any) -> tuple[Actuator, Actuator]:  # noqa: ANN401
        model = Scenario(**options).plant().model
        return model.motor.actuator, model.servo.actuator

    assert actuators(delay=0.1) == (Actuator(delay=0.1), Actuator())
    assert actuators(delay=0.1, track='L') == (Actuator(delay=0.1), SERVO._replace(delay=0.1))
    motor_actuator = Actuator(lag=0.3)
    assert actuators(delay=0.1, track='L', servo=motor_actuator) == (
        Actuator(delay=0.1),
        motor_actuator,
    )
    assert actuators(motor=motor_actuator, track='L') == (motor_actuator, SERVO)


@pytest.mark.parametrize(
    ('options', 'complaint'),
    [
        ({'motor': Actuator(), 'delay': 0.1}, 'delay=0.1 and motor=.* contradict each other'),
        ({'kp': 1.0, 'controller': LQR()}, 'kp are gains of the PID, which controller='),
        ({'lane': LaneLQR()}, "needs a track: give one, such as track='L'"),
        ({'track': Track((10.0,), (0.0,)), 'laps': 2}, "'track' is not closed: expected laps 1"),
        ({'lateral': 4000.0}, 'lateral 4000.0 must be of type LateralParameters, such as'),
        ({'servo': Actuator()._replace(lag=-1.0)}, 'lag: -1 is not a number from 0 to 100'),
        ({'track': 'L', 'e_y': 1e4}, 'e_y: 10000 is not a number from -1000 to 1000'),
    ],
)
def test_fields_that_contradict_are_refused(options: dict[str, Any], complaint: str) -> None:
    with pytest.raises(UserError, match=complaint):
        Scenario(**options)


def test_options_that_do_not_fit_a_scenario_are_refused() -> None:
    with pytest.raises(UserError, match=r'kp beside a scenario: .*replace\(scenario, kp=…\)'):
        simulate(1.0, scenario=Scenario())
    with pytest.raises(UserError, match='laps beside a scenario'):
        lap(laps=1, scenario=Scenario(track='L'))
    with pytest.raises(UserError, match='noise beside a scenario'):
        sweep(scenario=Scenario(), noise=0.1)
    with pytest.raises(UserError, match="scenario 'L' must be of type Scenario, such as Scenario"):
        simulate(scenario='L')  # type: ignore[arg-type]
    with pytest.raises(UserError, match='lap needs a track'):
        lap(scenario=Scenario())
    with pytest.raises(UserError, match='speed_reference -1 leads away from the distance, 225'):
        lap(track='oval', speed=-1.0, laps=1)
    with pytest.raises(UserError, match='laps=2 needs a track'):
        simulate(scenario=Scenario(laps=2))


def test_the_nodes_parameters_are_the_fields() -> None:
    rows = {each.name: each for each in parameters()}
    scenario = Scenario.of_parameters({name: each.default for name, each in rows.items()})
    car = replace(scenario, laps=0, distance=Scenario.distance).plant()
    assert car.vehicle == Vehicle()
    assert car.ts == Scenario.ts == 1.0 / rows['rate'].default  # type: ignore[operator]
    assert car.road == Scenario().plant().road
    for name in ('seed', 'disturbance', 'integrator', 'dynamics'):
        assert rows[name].default == getattr(Scenario, name)
