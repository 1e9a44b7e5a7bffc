"""The conditions of every loop of a search: road, speed, noise and delay."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import inf
from typing import TYPE_CHECKING

from barc_sim.control.pid import ACCELERATION_LIMIT, SPEED_REFERENCE
from barc_sim.simulation.closed_loop import DISTANCE, closed_loop
from barc_sim.simulation.metrics import RUN_UP
from barc_sim.simulation.straight_loop import Setting, Stretches
from barc_sim.vehicle.actuators import Actuator
from barc_sim.vehicle.bike_model import Motion, Vehicle
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.sensor import NoiseLevels, Sensor

if TYPE_CHECKING:
    from barc_sim.control.controller import Controller
    from barc_sim.simulation.log import Log

#: A loop fails to arrive where it takes longer than this many times the expected duration.
_PATIENCE = 3.0


@dataclass(frozen=True)
class Course:
    """A road to drive at a speed, with noise and delay.

    Examples
    --------
    >>> Course(distance=40.0).max_duration
    18.0
    """

    road: Road = field(default_factory=Road.lab)
    speed: float = SPEED_REFERENCE  #: [m/s] to hold, positive
    distance: float = DISTANCE  #: [m] beyond the run-up
    noise: float = 0.0  #: [m/s] standard deviation of the measured speed
    seed: int = 0  #: of the noise, as in a run
    delay: int = 0  #: steps from a command to its effect
    limit: float = ACCELERATION_LIMIT  #: [m/s²] of the command, either way
    vehicle: Vehicle = field(default_factory=Vehicle)
    ts: float = 0.02  #: [s]

    @property
    def max_duration(self) -> float:
        """[s] after which a loop counts as failing to arrive."""
        return _PATIENCE * (self.distance / self.speed + self.speed / self.limit)

    @property
    def steps(self) -> int:
        """The greatest number of steps, as `closed_loop` counts them."""
        return round(self.max_duration / self.ts)

    def drive(self, controller: Controller) -> Log:
        """Return the log of a run of `controller` over the course."""
        plant = Plant(
            road=self.road,
            vehicle=self.vehicle,
            ts=self.ts,
            noise=NoiseLevels(v_x=self.noise),
            seed=self.seed,
            motor=Actuator(delay=self.delay * self.ts),
        )
        return closed_loop(
            plant,
            controller,
            speed_reference=self.speed,
            distance=self.distance,
            max_duration=self.max_duration,
        )

    @cached_property
    def setting(self) -> Setting:
        """The numbers that all loops have in common."""
        road = self.road
        changes = (
            start
            for start, grade in zip(road.starts, road.grades_deg, strict=True)
            if grade != road.grades_deg[0]
        )
        return Setting(
            reference=self.speed,
            low=-self.limit,
            high=self.limit,
            vehicle=self.vehicle,
            ts=self.ts,
            dt=round(self.ts * 1e9) / 1e9,
            distance=self.distance,
            run_up=RUN_UP,
            first_end=next(changes, inf),
        )

    @cached_property
    def stretches(self) -> Stretches:
        """The road as the loops read it."""
        return Stretches.of(self.road, self.vehicle)

    @cached_property
    def errors(self) -> tuple[float, ...]:
        """The measurement error [m/s] of each state's speed: the same for all loops."""
        if not self.noise:
            return (0.0,) * (self.steps + 1)
        sensor = Sensor(NoiseLevels(v_x=self.noise), self.seed)
        still = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        return tuple(sensor.measure(still)[1].v_x for _ in range(self.steps + 1))
