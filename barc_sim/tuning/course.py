"""What every loop of a search is driven on: road, speed, noise and delay."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import inf, radians, sin
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.control.pid import ACCELERATION_LIMIT, SPEED_REFERENCE
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.metrics import RUN_UP
from barc_sim.vehicle.actuators import Actuator
from barc_sim.vehicle.bike_model import Motion, Vehicle
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.sensor import Deviation, Sensor

if TYPE_CHECKING:
    from barc_sim.control.controller import Controller
    from barc_sim.simulation.log import Log

#: A loop that takes longer than this many times what it should counts as one that never arrives.
_PATIENCE = 3.0


class Stretches(NamedTuple):
    """A road as the loops read it: stretch `i` reaches from `begins[i]` up to `ends[i]` [m]."""

    begins: tuple[float, ...]
    ends: tuple[float, ...]
    pushes: tuple[float, ...]  #: [N] gravity along the road


class Constants(NamedTuple):
    """The numbers that all loops over a course have in common."""

    reference: float  #: [m/s]
    limit: float  #: [m/s²] of the command, either way
    drag: float  #: [N s²/m²]
    friction: float  #: [N]
    mass: float  #: [kg]
    ts: float  #: [s] of the vehicle's steps
    dt: float  #: [s] as the controller sees it: whole nanoseconds
    distance: float  #: [m]
    run_up: float  #: [m]
    first_end: float  #: [m] where the first change of grade is


class Result(NamedTuple):
    """What a loop leaves for its scores; of many loops, an array of each."""

    steps: Any  #: from the first state to the one at the distance; -1 for one that never arrived
    squares: Any  #: [m²/s²] sum of the squared speed errors after the run-up
    count: Any  #: how many they are
    greatest: Any  #: [m/s] greatest absolute one of them
    peak: Any  #: [m/s] greatest speed on the first stretch
    effort: Any  #: [m²/s⁴] sum of the squared commands


@dataclass(frozen=True)
class Course:
    """A road to drive at a speed, and what makes it harder."""

    road: Road = field(default_factory=Road.lab)
    speed: float = SPEED_REFERENCE  #: [m/s] to hold, positive
    distance: float = 180.0  #: [m] beyond the run-up
    noise: float = 0.0  #: [m/s] standard deviation of the measured speed
    seed: int = 0  #: of the noise, as in a run
    delay: int = 0  #: steps from a command to its effect
    limit: float = ACCELERATION_LIMIT  #: [m/s²] of the command, either way
    vehicle: Vehicle = field(default_factory=Vehicle)
    ts: float = 0.02  #: [s]

    @property
    def max_duration(self) -> float:
        """[s] after which a loop counts as one that never arrives."""
        return _PATIENCE * (self.distance / self.speed + self.speed / self.limit)

    @property
    def steps(self) -> int:
        """The greatest number of steps, as `closed_loop` counts them."""
        return round(self.max_duration / self.ts)

    def drive(self, pid: Controller) -> Log:
        """Return the run of `pid` over the course, by `closed_loop`."""
        plant = Plant(
            road=self.road,
            vehicle=self.vehicle,
            ts=self.ts,
            noise=Deviation(v_x=self.noise),
            seed=self.seed,
            motor=Actuator(delay=self.delay * self.ts),
        )
        return closed_loop(
            plant,
            pid,
            speed_reference=self.speed,
            distance=self.distance,
            max_duration=self.max_duration,
        )

    @cached_property
    def constants(self) -> Constants:
        """The numbers that all loops have in common."""
        vehicle, road = self.vehicle, self.road
        return Constants(
            reference=self.speed,
            limit=self.limit,
            drag=vehicle.air_drag_coeff,
            friction=vehicle.friction,
            mass=vehicle.mass,
            ts=self.ts,
            dt=round(self.ts * 1e9) / 1e9,
            distance=self.distance,
            run_up=RUN_UP,
            first_end=next(
                (
                    start
                    for start, grade in zip(road.starts, road.grades_deg, strict=True)
                    if grade != road.grades_deg[0]
                ),
                inf,
            ),
        )

    @cached_property
    def stretches(self) -> Stretches:
        """The road as the loops read it."""
        inner = self.road.starts[1:]
        weight = -self.vehicle.mass * self.vehicle.gravity
        return Stretches(
            begins=(-inf, *inner),
            ends=(*inner, inf),
            pushes=tuple(weight * sin(radians(grade)) for grade in self.road.grades_deg),
        )

    @cached_property
    def errors(self) -> tuple[float, ...]:
        """The measurement error [m/s] of each state's speed: the same for all loops."""
        if not self.noise:
            return (0.0,) * (self.steps + 1)
        sensor = Sensor(Deviation(v_x=self.noise), self.seed)
        still = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        return tuple(sensor.measure(still)[1].v_x for _ in range(self.steps + 1))
