"""The plant: the vehicle on its road or track, with its actuators and its sensor.

Actuators delay, limit and lag a command; each is off by default. The sensor adds noise.
"""

from __future__ import annotations

from collections import deque
from math import copysign, cos, expm1, floor, inf, radians, sin
from operator import mul
from typing import TYPE_CHECKING, Annotated, NamedTuple

from barc_sim.errors import limited
from barc_sim.vehicle.bicycles import DynamicBicycle, bicycle, check_step
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
from barc_sim.vehicle.law import law
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.vehicle.bicycles import LateralParameters
    from barc_sim.vehicle.road import Signal
    from barc_sim.vehicle.track import Frenet, Track

    Floats = NDArray[np.float64]


#: Share of a step within which a delay counts as whole steps.
_WHOLE = 1e-6
_BLOCK = 64  #: measurements whose noise is drawn at once


@limited
class Actuator(NamedTuple):
    """An actuator's parameters; with the defaults a command takes effect at once.

    A command u takes effect `delay` later, clipped to ±`limit`. The value w follows it by

        dw/dt = (u - w) / lag, clipped to ±rate

    The unit is the command's: [m/s²] for the motor, [rad] for the servo.

    Examples
    --------
    >>> from barc_sim import Actuator, LaneLQR, simulate
    >>> late = Actuator(delay=0.1, rate=1.0)
    >>> log = simulate(track='oval', lane=LaneLQR(), servo=late, distance=60.0)
    >>> print(f'{abs(log.e_y).max():.2f} m off the lane at most')
    0.05 m off the lane at most
    """

    delay: Annotated[float, 'time from a command to its effect [s]', 0.0, 10.0] = 0.0
    lag: Annotated[float, 'time constant [s]', 0.0, 100.0] = 0.0
    rate: Annotated[float, 'maximum change [unit/s]', 1e-300, inf] = inf
    limit: Annotated[float, 'maximum absolute value [unit]', 0.0, inf] = inf


@law
def actuator_response(
    actuator: Actuator, value: float, target: float, t: float
) -> tuple[float, float]:
    """Return an actuator's value after `t` > 0 seconds of a constant `target`, and its mean.

    The solution is exact: a ramp at `rate` while the lag alone would be faster, and an exponential
    from there on.
    """
    lag = actuator.lag
    rate = actuator.rate
    error = target - value
    excess = abs(error)
    if lag:
        excess -= rate * lag
    ramp = min(excess / rate, t) if excess > 0.0 else 0.0
    ramp_end = value + copysign(rate, error) * ramp if ramp else value
    remaining = t - ramp
    if not remaining:
        return ramp_end, 0.5 * (value + ramp_end)

    error = target - ramp_end
    decayed = -expm1(-remaining / lag) if lag else 1.0
    mean_of_decay = target - error * decayed * lag / remaining
    ramp_share = ramp / t
    mean = ramp_share * 0.5 * (value + ramp_end) + (1.0 - ramp_share) * mean_of_decay
    return target - error * (1.0 - decayed), mean


@law
def limit_command(actuator: Actuator, command: float) -> float:
    """Return a command within the limit of an actuator."""
    within = -actuator.limit <= command <= actuator.limit
    return command if within else copysign(actuator.limit, command)


@law
def actuate(
    actuator: Actuator, value: float, older: float, newer: float, early: float, ts: float
) -> tuple[float, float]:
    """Return an actuator's value after a step of `ts` seconds, and its mean over the step.

    The command `older` acts for the share `early` of the step, and `newer` for the rest: so a delay
    that is not a multiple of the step is exact, too (Åström and Wittenmark, "Computer-Controlled
    Systems", 3rd ed., section 2.3).
    """
    target = limit_command(actuator, newer)
    if not early:
        value, mean = actuator_response(actuator, value, target, ts)
        return value, mean + 0.0
    first = limit_command(actuator, older)
    value, early_mean = actuator_response(actuator, value, first, early * ts)
    value, late_mean = actuator_response(actuator, value, target, (1.0 - early) * ts)
    return value, early * early_mean + (1.0 - early) * late_mean


def in_steps(delay: float, ts: float) -> tuple[int, float]:
    """Return a delay in whole steps of `ts` seconds, and the share of a step beyond them."""
    whole, share = divmod(delay / ts, 1.0)
    return (
        (int(whole), share) if _WHOLE < share < 1.0 - _WHOLE else (int(whole + round(share)), 0.0)
    )


class ActuatorState:
    """The state of one actuator, in steps of a fixed length.

    Commands wait in a queue, one per step; `actuate` has the law.
    """

    early: float  #: share of a step for which the older command still acts

    def __init__(self, actuator: Actuator, ts: float) -> None:
        """Begin at zero, in steps of `ts` seconds, with only zeros commanded before."""
        self._ts = ts
        self.value = 0.0  #: where the actuator is now
        self._queue = deque([0.0, 0.0])
        self.replace(actuator)

    @property
    def waiting(self) -> list[float]:
        """The commands that have not acted yet; the oldest acts in the early part of a step."""
        return [*self._queue][1:]

    def replace(self, actuator: Actuator) -> None:
        """Use the parameters of `actuator` from now on; waiting commands stay.

        If the delay is shorter, the oldest commands are dropped; if it is longer, the command that
        acts now acts until the next one is due.
        """
        self.actuator = actuator
        self.is_ideal = actuator == Actuator()  #: each command takes effect at once
        whole, self.early = in_steps(actuator.delay, self._ts)
        size = whole + 2
        _, acting, *waiting = self._queue
        self._queue = deque([*[acting] * (size - len(waiting)), *waiting], maxlen=size)

    def advance(self, command: float) -> float:
        """Take a step with `command`; return the mean of the value over the step."""
        self._queue.append(command)
        if self.is_ideal:
            self.value = command
            return command
        older, newer = self._queue[0], self._queue[1]
        self.value, mean = actuate(self.actuator, self.value, older, newer, self.early, self._ts)
        return mean

    def hold(self, value: float) -> None:
        """Set the value, as if it had been commanded for a long time."""
        self.value = value
        self._queue.extend([value] * len(self._queue))


class Actuators:
    """Motor and servo: from the commanded to the actual acceleration and steering."""

    def __init__(self, motor: Actuator, servo: Actuator, ts: float) -> None:
        """Begin at rest, in steps of `ts` seconds."""
        self.motor, self.servo = ActuatorState(motor, ts), ActuatorState(servo, ts)
        self.is_ideal = motor == servo == Actuator()

    @property
    def now(self) -> Command:
        """The present acceleration and steering angle."""
        return Command(self.motor.value, self.servo.value)

    def advance(self, command: Command) -> Command:
        """Take a step with `command`; return mean acceleration and steering angle over it."""
        if self.is_ideal:
            self.motor.value, self.servo.value = command
            return command
        return Command(self.motor.advance(command.motor), self.servo.advance(command.servo))

    def replace(self, motor: Actuator, servo: Actuator) -> None:
        """Use the parameters of these actuators from now on; waiting commands stay."""
        if self.is_ideal:  # the queues have had no part so far
            self.motor.hold(self.motor.value)
            self.servo.hold(self.servo.value)
        self.motor.replace(motor)
        self.servo.replace(servo)
        self.is_ideal = motor == servo == Actuator()

    def stop(self) -> None:
        """Set both to zero, and drop the waiting commands."""
        self.motor.hold(0.0)
        self.servo.hold(0.0)


@limited
class NoiseLevels(NamedTuple):
    """The standard deviation of each measured signal, in the vehicle's true frame."""

    s: Annotated[float, 'standard deviation of the longitudinal position [m]', 0.0, 1e3] = 0.0
    ey: Annotated[float, 'standard deviation of the lateral position [m]', 0.0, 1e3] = 0.0
    epsi: Annotated[float, 'standard deviation of heading [rad]', 0.0, 1e3] = 0.0
    v_x: Annotated[float, 'standard deviation of v_x [m/s]', 0.0, 1e3] = 0.0
    v_y: Annotated[float, 'standard deviation of v_y [m/s]', 0.0, 1e3] = 0.0
    psi_dot: Annotated[float, 'standard deviation of yaw rate [rad/s]', 0.0, 1e3] = 0.0


class MeasurementError(NamedTuple):
    """Measured minus true, of each signal of `NoiseLevels`."""

    s: float = 0.0
    ey: float = 0.0
    epsi: float = 0.0
    v_x: float = 0.0
    v_y: float = 0.0
    psi_dot: float = 0.0


_NO_ERROR = MeasurementError()


class Sensor:
    """Adds white Gaussian noise to a motion; one seed gives the same errors.

    The generator is NumPy's PCG64. Every measurement takes six of its normal numbers: the noise of
    one signal does not depend on whether another has any.
    """

    def __init__(self, noise: NoiseLevels | None = None, seed: int = 0) -> None:
        """Measure with these standard deviations, zero unless given; `seed` is at least 0."""
        self.noise = noise or NoiseLevels()
        self._seed = int(seed)
        self._generator: np.random.Generator | None = None
        self._normals: list[list[float]] = []  # of the next measurements, the last one first

    @property
    def is_noisy(self) -> bool:
        """Whether any signal has noise."""
        return any(self.noise)

    def measure(self, true: Motion) -> tuple[Motion, MeasurementError]:
        """Return the motion as measured, and its error: measured minus true."""
        if not self.is_noisy:
            return true, _NO_ERROR
        if not self._normals:
            self._normals = self._draw_normals(_BLOCK)[::-1].tolist()
        error = MeasurementError(*map(mul, self.noise, self._normals.pop()))
        return with_error(true, error, cos(true.psi), sin(true.psi)), error

    def again(self) -> Sensor:
        """Return a new sensor with the same levels and seed."""
        return Sensor(self.noise, self._seed)

    def draw(self, n: int) -> Floats:
        """Return the errors of the first `n` measurements, shape `(n, 6)`."""
        normals: Floats = self.again()._draw_normals(n)  # noqa: SLF001 (of this class)
        return normals * self.noise

    def _draw_normals(self, n: int) -> Floats:
        """Return the standard normal numbers of the next `n` measurements, shape `(n, 6)`."""
        import numpy as np  # noqa: PLC0415 (a sensor without noise does not need it)

        if self._generator is None:
            self._generator = np.random.Generator(np.random.PCG64(self._seed))
        return self._generator.standard_normal((n, len(self.noise)))


def with_error(true: Motion, error: MeasurementError, cos_psi: float, sin_psi: float) -> Motion:
    """Return the motion as measured, of numbers or arrays, with cosine and sine of the heading."""
    return true._replace(
        x=true.x + error.s * cos_psi + error.ey * -sin_psi,
        y=true.y + error.s * sin_psi + error.ey * cos_psi,
        psi=true.psi + error.epsi,
        v_x=true.v_x + error.v_x,
        v_y=true.v_y + error.v_y,
        psi_dot=true.psi_dot + error.psi_dot,
    )


class TrackState(NamedTuple):
    """The position of the car on its track."""

    s: float  #: [m] along the centre line; it grows over the laps
    e_y: float  #: [m] to the left of the centre line
    e_psi: float  #: [rad] heading minus the heading of the centre line
    curvature: float  #: [1/m] of the centre line there
    width: float  #: [m] of the track there, from edge to edge
    lap: int  #: laps before this one; the car has passed their end, s = k · length
    lap_time: float  #: [s] since the lap began, between two states


class Observation(NamedTuple):
    """One state: true, measured, with forces and actuators."""

    true: Motion
    measured: Motion
    error: MeasurementError  #: measured minus true
    surroundings: Surroundings
    acting: Command  #: the present values of the actuators
    on_track: TrackState | None = None  #: true; None without a track


class Plant:
    """The car on its road or track; `vehicle` may be replaced between steps."""

    def __init__(
        self,
        *,
        road: Road | None = None,
        vehicle: Vehicle | None = None,
        ts: float = 0.02,
        noise: NoiseLevels | None = None,
        seed: int = 0,
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

        On a `track` the road, by default flat, gives the hills along it, the same in each lap.

        In a step acceleration and steering angle are constant: the mean of the actuators' values.
        So is the force on the car, positive forwards: `force` [N] plus `disturbance`. UserError: a
        name is unknown, arguments contradict one another, or the step is too long.
        """
        self.road = road or (Road.flat() if track else Road.lab())
        self.vehicle = vehicle or Vehicle()
        self.ts = ts
        self.state = State()
        self.sensor = Sensor(noise, seed)
        self.force, self.disturbance = force, disturbance
        self.steps = 0  #: since it was placed
        self.actuators = Actuators(motor or Actuator(), servo or Actuator(), ts)
        self.bicycle = bicycle(dynamics, integrator, model, lateral)
        if isinstance(self.bicycle, DynamicBicycle):
            check_step(self.bicycle.lateral, self.vehicle, ts, integrator)
        self.track = track
        self.frenet: Frenet | None = None  #: the pose on the track; None without one
        self.lap, self.lap_time, self._lap_began = 0, 0.0, 0.0  #: as in `TrackState`, [s]
        self.lap_times: tuple[float, ...] = ()  #: [s] of the laps that were driven whole
        if track:
            self.state = State(*track.place(0.0))
            self._locate(near=0.0)

    @property
    def distance(self) -> float:
        """The distance so far [m], along the track or along the road."""
        return self.frenet.s if self.frenet else self.state.x

    @property
    def on_track(self) -> TrackState | None:
        """The position of the car on its track; None without one."""
        if not (self.frenet and self.track):
            return None
        return TrackState(*self.frenet, self.track.width, self.lap, self.lap_time)

    @property
    def period_ns(self) -> int:
        """The step in whole nanoseconds, as the stamps of states have it."""
        return round(self.ts * 1e9)

    @property
    def has_fast_path(self) -> bool:
        """Whether `bikeFE` moves the car straight ahead along its road."""
        actuators = self.actuators
        return (
            type(self) is Plant
            and not self.track
            and self.bicycle.is_lab
            and not (self.force or self.disturbance)
            and self.state.psi == actuators.servo.value == 0.0
            and not any(actuators.servo.waiting)
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
        return self.bicycle.motion(self.state, self.actuators.servo.value, self.vehicle)

    def advance(self, command: Command) -> None:
        """Take one step with `command`."""
        held = self.actuators.advance(command)
        if self.force or self.disturbance:
            force = self.force
            if self.disturbance:
                force += self.disturbance(self.steps * self.ts, self.distance)
            held = held._replace(motor=held.motor + force / self.vehicle.mass)
        self.state = self.bicycle.step(self.state, held, self._grade, self.vehicle, self.ts)
        self.steps += 1
        if self.frenet:
            self._locate(self.frenet.s)

    def place(self, state: State, near: float | None = None) -> None:
        """Start a run in this state, on a track near s = `near` [m], without waiting commands."""
        self.state, self.steps = state, 0
        self.actuators.stop()
        self.bicycle.reset()
        if self.track:
            self.frenet = None
            self._locate(near)

    def _on_road(self, x: float) -> float:
        """Return the position [m] on the road of a car at `x`: on a track, where the step began."""
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
        """Project the car onto the track near s = `near` [m]; None: anywhere, and start a lap."""
        track, state, t, before = self.track, self.state, self.steps * self.ts, self.frenet
        assert track  # noqa: S101 (a caller has checked)
        self.frenet = track.frenet(state.x, state.y, state.psi, near)
        s = self.frenet.s
        lap = floor(s / track.length)
        if before is None:
            self.lap, self._lap_began, self.lap_times = max(lap, 0), t, ()
            self._is_whole = near == 0.0
        elif lap > self.lap:
            began = t - (s - lap * track.length) / (s - before.s) * self.ts
            if self._is_whole:
                self.lap_times += (began - self._lap_began,)
            self.lap, self._lap_began, self._is_whole = lap, began, True
        self.lap_time = t - self._lap_began
