"""The vehicle on its road with its sensors: what the simulator node and the rollout step alike."""

from __future__ import annotations

from math import radians, sin
from typing import NamedTuple

from barc_sim.bike_model import (
    Forces,
    Input,
    Model,
    Motion,
    State,
    Vehicle,
    bikeFE,
    forces,
    motion,
    step,
)
from barc_sim.road import Road
from barc_sim.sensor import Deviation, Sensor


class Observation(NamedTuple):
    """All there is to tell of one state."""

    true: Motion
    measured: Motion
    error: Deviation  #: measured minus true
    theta_deg: float  #: [deg] incline
    elevation: float  #: [m]
    forces: Forces


class Plant:
    """Holds the state and the last command; `vehicle` may be replaced between steps."""

    def __init__(
        self,
        *,
        road: Road | None = None,
        vehicle: Vehicle | None = None,
        ts: float = 0.02,
        noise: Deviation | None = None,
        seed: int = 0,
        model: Model = bikeFE,
    ) -> None:
        """Start at rest at the beginning of `road` (the lab's), in steps of `ts` seconds."""
        self.road = road or Road.lab()
        self.vehicle = vehicle or Vehicle()
        self.ts = ts
        self.state = State()
        self._held = Input()
        self._sensor = Sensor(noise, seed)
        self._model = model

    def observe(self) -> Observation:
        """Measure the present state; each call draws new measurement noise."""
        state = self.state
        theta_deg = self.road.grade_deg(state.x)
        true = motion(state, self._held.servo, self.vehicle)
        measured, error = self._sensor.measure(true)
        return Observation(
            true=true,
            measured=measured,
            error=error,
            theta_deg=theta_deg,
            elevation=self.road.elevation(state.x),
            forces=forces(state.v, radians(theta_deg), self.vehicle),
        )

    def advance(self, command: Input | None = None) -> None:
        """Go one step with `command`; without one, the last holds."""
        if command is not None:
            self._held = command
        theta = radians(self.road.grade_deg(self.state.x))
        self.state = step(self.state, self._held, theta, self.vehicle, self.ts, self._model)

    def place(self, state: State) -> None:
        """Put the car there, with no command held."""
        self.state = state
        self._held = Input()

    def brake(self, deceleration: float) -> None:
        """Go one step towards a standstill, at up to `deceleration` [m/s²], as steered last.

        On a hill it takes part of that to keep the car from rolling.
        """
        pull = self.vehicle.gravity * sin(radians(self.road.grade_deg(self.state.x)))
        motor = max(-deceleration, min(pull - self.state.v / self.ts, deceleration))
        self.advance(self._held._replace(motor=motor))
