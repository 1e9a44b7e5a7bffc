"""The plant: the vehicle on its road, with actuators and sensors."""

from __future__ import annotations

from math import radians, sin
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.vehicle.actuators import Actuator, Actuators
from barc_sim.vehicle.bicycles import bicycle
from barc_sim.vehicle.bike_model import (
    Command,
    Model,
    Motion,
    State,
    Surroundings,
    Vehicle,
    bikeFE,
    surroundings,
)
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.sensor import MeasurementError, NoiseLevels, Sensor

if TYPE_CHECKING:
    from barc_sim.vehicle.bicycles import LateralParameters
    from barc_sim.vehicle.profile import Signal


class Observation(NamedTuple):
    """One state: true, measured, and what acts on it."""

    true: Motion
    measured: Motion
    error: MeasurementError  #: measured minus true
    surroundings: Surroundings
    acting: Command  #: what the actuators do at this instant


class Plant:
    """Holds the state and the last command; `vehicle` may be replaced between steps."""

    def __init__(
        self,
        *,
        road: Road | None = None,
        vehicle: Vehicle | None = None,
        ts: float = 0.02,
        noise: NoiseLevels | None = None,
        seed: int = 0,
        sensor_delay: float = 0.0,
        force: float = 0.0,
        disturbance: Signal | None = None,
        model: Model = bikeFE,
        motor: Actuator | None = None,
        servo: Actuator | None = None,
        integrator: str = 'euler',
        dynamics: str = 'kinematic',
        lateral: LateralParameters | None = None,
    ) -> None:
        """Start at rest at the beginning of `road` (the lab's), in steps of `ts` seconds.

        Over a step acceleration and steering are held: at the mean of what the actuators do in it.
        So is the force on the car, positive forwards: `force` [N], and that of `disturbance`.
        UserError: the names are unknown, do not go together, or the step is too long.
        """
        self.road = road or Road.lab()
        self.vehicle = vehicle or Vehicle()
        self.ts = ts
        self.state = State()
        self._held = Command()
        self.sensor = Sensor(noise, seed, delay=sensor_delay, ts=ts)
        self.force, self.disturbance = force, disturbance
        self._steps = 0
        self.actuators = Actuators(motor or Actuator(), servo or Actuator(), ts)
        self._bicycle = bicycle(dynamics, integrator, model, lateral)
        self._bicycle.check(self.vehicle, ts)

    @property
    def period_ns(self) -> int:
        """The step in whole nanoseconds, as the stamps of states have it."""
        return round(self.ts * 1e9)

    @property
    def has_fast_path(self) -> bool:
        """Whether `bikeFE` moves the car straight ahead, by commands that act unchanged."""
        actuators = self.actuators
        return (
            type(self) is Plant
            and self._bicycle.is_lab
            and not (self.sensor.delay or self.force or self.disturbance)
            and self.state.psi == actuators.now.servo == 0.0
            and (
                actuators.is_ideal
                or (actuators.motor.only_delays and not any(actuators.servo.waiting))
            )
        )

    def observe(self) -> Observation:
        """Measure the present state; each call draws new measurement noise."""
        state = self.state
        acting = self.actuators.now
        true = self._bicycle.motion(state, acting.servo, self.vehicle)
        measured, error = self.sensor.measure(true)
        around = surroundings(state.v, self.road.at(state.x), self.vehicle)
        return Observation(true, measured, error, around, acting)

    def advance(self, command: Command | None = None) -> None:
        """Go one step with `command`; without one, the last holds."""
        if command is not None:
            self._held = command
        self._step(self.actuators.advance(self._held))

    def retune(
        self,
        noise: NoiseLevels,
        motor: Actuator,
        servo: Actuator,
        sensor_delay: float = 0.0,
        force: float = 0.0,
    ) -> None:
        """Replace what can change while the car drives; commands on their way stay on it."""
        self.sensor.noise, self.sensor.delay = noise, sensor_delay
        self.force = force
        self.actuators.replace(motor, servo)

    def place(self, state: State) -> None:
        """Put the car there, with no command held or on its way."""
        self.state = state
        self._held = Command()
        self.actuators.stop()
        self.sensor.forget()
        self._bicycle.reset()

    def brake(self, deceleration: float) -> None:
        """Go one step towards a standstill, at up to `deceleration` [m/s²], as steered last.

        On a hill it takes part of that to keep the car from rolling. The brakes act at once,
        without the motor's actuator, which restarts from zero.
        """
        pull = self.vehicle.gravity * sin(self._grade(self.state.x))
        motor = max(-deceleration, min(pull - self.state.v / self.ts, deceleration))
        self._held = self._held._replace(motor=motor)
        self._step(self.actuators.brake(self._held))

    def _grade(self, x: float) -> float:
        """Return the incline [rad] at `x`."""
        return radians(self.road.grades_deg[self.road.stretch(x)])

    def _step(self, held: Command) -> None:
        if self.force or self.disturbance:
            force = self.force
            if self.disturbance:
                force += self.disturbance(self._steps * self.ts, self.state.x)
                self._steps += 1
            held = held._replace(motor=held.motor + force / self.vehicle.mass)
        self.state = self._bicycle.step(self.state, held, self._grade, self.vehicle, self.ts)
