"""The fast loop: the same as the general one, to the last bit."""

from __future__ import annotations

from math import inf, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.control.pid import PID
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.actuators import Actuator
from barc_sim.vehicle.bike_model import State, Vehicle
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.sensor import NoiseLevels

NOISE = NoiseLevels(s=0.1, ey=0.05, epsi=0.01, v_x=0.05, v_y=0.02)


class General(PID):
    """A PID that the general loop drives: it is not exactly `PID`."""


roads = st.lists(st.tuples(st.floats(0.5, 20.0), st.floats(-60.0, 60.0)), min_size=1, max_size=5)


@settings(max_examples=60, deadline=None)
@given(
    stretches=roads,
    state=st.builds(
        State,
        st.floats(-5.0, 5.0),
        st.floats(-2.0, 2.0).map(lambda y: y or 0.0),
        st.just(0.0),
        st.floats(-5.0, 12.0),
    ),
    resistance=st.tuples(st.floats(500.0, 3000.0), st.floats(0.0, 50.0), st.floats(0.0, 500.0)),
    gains=st.tuples(st.floats(-2.0, 80.0), st.floats(0.0, 3000.0), st.floats(0.0, 3.0)),
    low=st.sampled_from([-8.0, -1.0, -inf]),
    high=st.sampled_from([8.0, 2.0, inf]),
    reference=st.floats(-3.0, 12.0),
    ts=st.sampled_from([0.02, 0.013, 1.0 / 30.0]),
    noise=st.sampled_from([NoiseLevels(), NoiseLevels(v_x=0.3), NOISE]),
    delay=st.just(0.0) | st.floats(0.0, 0.2) | st.integers(1, 5).map(lambda n: n * 0.02),
)
def test_the_log_is_that_of_the_general_loop(
    stretches: list[tuple[float, float]],
    state: State,
    resistance: tuple[float, float, float],
    gains: tuple[float, float, float],
    low: float,
    high: float,
    reference: float,
    ts: float,
    noise: NoiseLevels,
    delay: float,
) -> None:
    starts = [sum(length for length, _ in stretches[:i]) for i in range(len(stretches))]
    road = Road(tuple(starts), tuple(grade for _, grade in stretches))
    found = []
    for make in (PID, General):
        plant = Plant(
            road=road,
            vehicle=Vehicle(*resistance),
            ts=ts,
            noise=noise,
            seed=3,
            motor=Actuator(delay=delay),
        )
        plant.place(state)
        pid = make(*gains, output_min=low, output_max=high)
        log = closed_loop(plant, pid, speed_reference=reference, distance=20.0, max_duration=8.0)
        found.append([each.tobytes() for each in log.columns().values()])
    assert found[0] == found[1]


def test_numbers_that_grow_without_bound_are_left_to_the_general_loop() -> None:
    controllers = [PID(), General()]
    for each in controllers:
        each.kp = -1e200
    logs = [closed_loop(controller=each, max_duration=1.0) for each in controllers]
    left, right = ([each.tobytes() for each in log.columns().values()] for log in logs)
    assert left == right


def test_a_controller_without_a_number_brings_the_car_nowhere() -> None:
    pid = PID()
    pid.kp = nan
    assert len(closed_loop(controller=pid, max_duration=0.2)) == 11


@pytest.mark.parametrize(
    'plant',
    [
        Plant(integrator='rk4'),
        Plant(dynamics='dynamic'),
        Plant(model=lambda *_, **__: (0.0,) * 4),
        Plant(motor=Actuator(lag=0.1)),
    ],
)
def test_only_the_labs_model_has_fast_path(plant: Plant) -> None:
    assert not plant.has_fast_path
    assert Plant(noise=NOISE, motor=Actuator(delay=0.03)).has_fast_path
