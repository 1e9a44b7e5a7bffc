"""The plant: the vehicle on its road, with actuators and sensors."""

from __future__ import annotations

from math import floor, radians, sin
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
    from barc_sim.vehicle.track import Track


class TrackState(NamedTuple):
    """Where the car is on its track."""

    s: float  #: [m] along the centre line; it grows over the laps
    e_y: float  #: [m] to the left of the centre line
    e_psi: float  #: [rad] heading less that of the centre line
    curvature: float  #: [1/m] of the centre line there
    width: float  #: [m] of the track there, from edge to edge
    lap: int  #: laps before this one; the car has passed their end, s = k · length
    lap_time: float  #: [s] since the lap began, between two states


class Observation(NamedTuple):
    """One state: true, measured, and what acts on it."""

    true: Motion
    measured: Motion
    error: MeasurementError  #: measured minus true
    surroundings: Surroundings
    acting: Command  #: what the actuators do at this instant
    on_track: TrackState | None = None  #: true; None without a track


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
        track: Track | None = None,
    ) -> None:
        """Start at rest at the beginning of `road` (the lab's), in steps of `ts` seconds.

        On a `track` the road, flat unless given, counts along it, anew in each lap.

        Over a step acceleration and steering are held: at the mean of what the actuators do in it.
        So is the force on the car, positive forwards: `force` [N], and that of `disturbance`.
        UserError: the names are unknown, do not go together, or the step is too long.
        """
        self.road = road or (Road.flat() if track else Road.lab())
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
        self.track = track
        self.on_track: TrackState | None = None
        self._lap_began = 0.0  # [s]
        if track:
            self.state = State(*track.place(0.0))
            self._locate(near=0.0)

    @property
    def distance(self) -> float:
        """The way so far [m]: along the track, or along the road."""
        return self.on_track.s if self.on_track else self.state.x

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
            and not self.track
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
        true = self.motion()
        measured, error = self.sensor.measure(true)
        around = surroundings(state.v, self.road.at(self._on_road(state.x)), self.vehicle)
        return Observation(true, measured, error, around, self.actuators.now, self.on_track)

    def motion(self) -> Motion:
        """Return the true state, with the velocities in the vehicle's frame."""
        return self._bicycle.motion(self.state, self.actuators.now.servo, self.vehicle)

    def advance(self, command: Command | None = None) -> None:
        """Go one step with `command`; without one, the last holds."""
        if command is not None:
            self._held = command
        self._step(self.actuators.advance(self._held))

    def place(self, state: State, near: float | None = None) -> None:
        """Put the car there, on a track `near` that s [m], with no command held or on its way."""
        self.state = state
        self._held = Command()
        self.actuators.stop()
        self.sensor.forget()
        self._bicycle.reset()
        if self.track:
            self.on_track = None
            self._locate(near)

    def brake(self, deceleration: float) -> None:
        """Go one step towards a standstill, at up to `deceleration` [m/s²], as steered last.

        On a hill it takes part of that to keep the car from rolling. The brakes act at once,
        without the motor's actuator, which restarts from zero.
        """
        pull = self.vehicle.gravity * sin(self._grade(self.state.x))
        motor = max(-deceleration, min(pull - self.state.v / self.ts, deceleration))
        self._held = self._held._replace(motor=motor)
        self._step(self.actuators.brake(self._held))

    def _on_road(self, x: float) -> float:
        """Return where the road is read [m] for a car at `x`: on a track, where the step began."""
        if not self.track:
            return x
        return self.distance % self.track.length if self.track.is_closed else self.distance

    def _grade(self, x: float) -> float:
        """Return the incline [rad] at `x`."""
        grades_deg = self.road.grades_deg
        if len(grades_deg) == 1:
            return radians(grades_deg[0])
        return radians(grades_deg[self.road.stretch(self._on_road(x))])

    def _locate(self, near: float | None) -> None:
        """Find the car on the track, `near` that s [m]; where it was nowhere, a lap begins."""
        track, state, t, before = self.track, self.state, self._steps * self.ts, self.on_track
        assert track  # noqa: S101 (a caller has checked)
        found = track.frenet(state.x, state.y, state.psi, near)
        s, e_y, e_psi, curvature = found
        lap = floor(s / track.length)
        if before is None:
            lap, self._lap_began = max(lap, 0), t
        elif lap > before.lap:
            self._lap_began = t - (s - lap * track.length) / (s - before.s) * self.ts
        else:
            lap = before.lap
        width = track.width
        self.on_track = TrackState(s, e_y, e_psi, curvature, width, lap, t - self._lap_began)

    def _step(self, held: Command) -> None:
        if self.force or self.disturbance:
            force = self.force
            if self.disturbance:
                force += self.disturbance(self._steps * self.ts, self.distance)
            held = held._replace(motor=held.motor + force / self.vehicle.mass)
        self.state = self._bicycle.step(self.state, held, self._grade, self.vehicle, self.ts)
        self._steps += 1
        if self.on_track:
            self._locate(self.on_track.s)
