"""Driving by velocity without ROS: the relay of the engine `local` has the same law."""

from __future__ import annotations

from math import atan, tan
from typing import TYPE_CHECKING

import pytest

from barc_sim.control.driver import DriverInput
from barc_sim.runs.local.engine import LocalEngine
from barc_sim.vehicle.bike_model import bikeFE
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from barc_sim.vehicle.plant import Observation


@pytest.mark.slow
def test_car_reaches_speed_and_yaw_rate_and_a_zero_twist_stops_it() -> None:
    engine = LocalEngine(['--ros-args', '-p', 'relay:input:=velocity', '-p', 'stale_after:=60.0'])
    relay = engine.relay(None, {})
    steady: list[Observation] = []
    stopped: list[Observation] = []

    def on_step(t: float, seen: Observation) -> None:
        if t == 0.0:
            relay.receive(DriverInput(forward=1.0, turn=0.1))
        elif not steady and t > 2.5:
            steady.append(seen)
            relay.receive(DriverInput())
        elif t > 4.0:
            stopped.append(seen)
            simulator.finish()

    simulator = engine.simulator(
        road=Road.flat(), on_step=on_step, model=bikeFE, given={'command_timeout': 0.5}
    )
    engine.spin()
    engine.close()
    true = steady[0].true
    assert true.v_x == pytest.approx(1.0, abs=0.05)
    assert true.psi_dot == pytest.approx(true.v_x * tan(atan(0.3)) / 3.0, abs=1e-4)
    assert stopped[0].true.v_x == pytest.approx(0.0, abs=0.05)
