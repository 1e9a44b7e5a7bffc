"""The plant: the vehicle on its road or track, with its actuators and its sensor.

Actuators delay, limit and lag a command; each is off by default. The sensor adds noise, and can
measure late.

`acting` is always the present value of the actuators, which moves the car. The command that the
simulator holds is another thing: it is the input of the actuators, and with a delay it does not act
yet.
"""

from __future__ import annotations

from collections import deque
from math import copysign, cos, expm1, floor, inf, isnan, nan, sin
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import limited
from barc_sim.interfaces.records import (
    Command,
    MeasurementError,
    Surroundings,
    TrackState,
    VehicleState,
)
from barc_sim.vehicle.bicycles import (
    NO_SLIP,
    Bicycle,
    LateralParameters,
    Slip,
    bicycle_motion,
    bicycle_of,
    bicycle_step,
    check_step,
    model_step,
)
from barc_sim.vehicle.bike_model import BicycleState, Model, Vehicle, bikeFE, surroundings
from barc_sim.vehicle.law import law
from barc_sim.vehicle.road import Inclines, Road, stretch_at
from barc_sim.vehicle.track import CentreLine, Frenet, Pose, Segment, nearest, project, segment_at

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.vehicle.road import Signal
    from barc_sim.vehicle.track import Track

    Floats = NDArray[np.float64]
    Column = Any  #: a list of numbers in Python, an array in compiled code


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
    # The lag alone changes the value by error / lag: faster than `rate` where there is an excess.
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

    # The mean over the step weighs the means of ramp and decay by their durations.
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
        return value, mean + 0.0  # -0.0 becomes 0.0, as in the sum below
    first = limit_command(actuator, older)
    value, early_mean = actuator_response(actuator, value, first, early * ts)
    value, late_mean = actuator_response(actuator, value, target, (1.0 - early) * ts)
    return value, early * early_mean + (1.0 - early) * late_mean


def in_steps(delay: float, ts: float) -> tuple[int, float]:
    """Return a delay in whole steps of `ts` seconds, and the share of a step beyond them."""
    whole, share = divmod(delay / ts, 1.0)
    if _WHOLE < share < 1.0 - _WHOLE:
        return int(whole), share
    return int(whole + round(share)), 0.0


class Channel(NamedTuple):
    """An actuator in steps of a fixed length."""

    actuator: Actuator
    whole: int  #: steps from a command to its effect
    early: float  #: share of a step for which the older command still acts
    is_ideal: bool  #: each command takes effect at once


def channel_of(actuator: Actuator, ts: float) -> Channel:
    """Return an actuator in steps of `ts` seconds."""
    whole, early = in_steps(actuator.delay, ts)
    return Channel(actuator, whole, early, actuator == Actuator())


def queue_room(channel: Channel) -> int:
    """Return how many commands the queue of an actuator has at least."""
    return channel.whole + 2


@law
def act(
    channel: Channel, value: float, queue: Column, k: int, command: float, ts: float
) -> tuple[float, float]:
    """Return an actuator's value after its step number `k` with a command, and its mean.

    `queue` is a ring of the latest commands: the command of step `k` is at `k` modulo its length.
    """
    room = len(queue)
    queue[k % room] = command
    if channel.is_ideal:
        return command, command
    newer = queue[(k - channel.whole) % room]
    older = newer
    if channel.early:
        older = queue[(k - channel.whole - 1) % room]
    return actuate(channel.actuator, value, older, newer, channel.early, ts)


def latest_commands(queue: Column, k: int, count: int) -> list[float]:
    """Return this number of the commands before step `k`, the oldest first."""
    return [queue[(k - age) % len(queue)] for age in range(count, 0, -1)]


def requeued(queue: Column, k: int, before: Channel, after: Channel) -> list[float]:
    """Return the queue of another actuator, in which the commands before step `k` wait.

    If the delay is shorter, the oldest commands are dropped; if it is longer, the command that acts
    now acts until the next one is due.
    """
    room = queue_room(after)
    commands = latest_commands(queue, k, before.whole + 1)
    acting = commands[0]
    history = ([acting] * room + commands)[-room:]

    ring = [0.0] * room
    for age, command in enumerate(reversed(history), 1):
        ring[(k - age) % room] = command
    return ring


@limited
class NoiseLevels(NamedTuple):
    """The standard deviation of each measured signal, in the vehicle's true frame."""

    s: Annotated[float, 'standard deviation of the longitudinal position [m]', 0.0, 1e3] = 0.0
    ey: Annotated[float, 'standard deviation of the lateral position [m]', 0.0, 1e3] = 0.0
    epsi: Annotated[float, 'standard deviation of heading [rad]', 0.0, 1e3] = 0.0
    v_x: Annotated[float, 'standard deviation of v_x [m/s]', 0.0, 1e3] = 0.0
    v_y: Annotated[float, 'standard deviation of v_y [m/s]', 0.0, 1e3] = 0.0
    psi_dot: Annotated[float, 'standard deviation of yaw rate [rad/s]', 0.0, 1e3] = 0.0


_NO_ERROR = MeasurementError()


class Sensor:
    """Measures a motion late, and adds white Gaussian noise; one seed gives the same noise.

    Without a delay the measurement y_k of state k is x_k plus noise. With a delay of n whole steps
    and a share r of a step, the state at the time t_k - delay is measured, on the line between two
    states:

        y_k = x_(k-n) + r · (x_(k-n-1) - x_(k-n)) + noise_k

    Before the first state, and where a longer delay has just been set, it is the oldest state that
    is remembered.

    The generator is NumPy's PCG64. Every measurement takes six of its normal numbers: the noise of
    one signal does not depend on whether another has any. A live sensor draws the numbers of 64
    measurements at a time, as a call of the generator takes much longer than a number. `errors` and
    `normals` return the same noise for a whole run at once.
    """

    def __init__(
        self,
        noise: NoiseLevels | None = None,
        seed: int = 0,
        *,
        delay: float = 0.0,
        ts: float = 0.02,
    ) -> None:
        """Measure states that are `ts` [s] apart, `delay` [s] late.

        `noise` has the standard deviations, zero unless given; `seed` is at least 0.
        """
        self.noise = noise or NoiseLevels()
        self._seed = int(seed)
        self._generator: np.random.Generator | None = None
        self._normals: list[list[float]] = []  # of the next measurements, the last one first
        self._ts = ts
        self._past: deque[VehicleState] = deque()  # of the states before the present one
        self.delay = delay

    @property
    def delay(self) -> float:
        """The age of a measurement at its stamp [s]; it can be set between steps."""
        return self._delay

    @delay.setter
    def delay(self, delay: float) -> None:
        self._delay = delay
        self.is_late = delay > 0.0
        self._whole, self._share = in_steps(delay, self._ts)
        if not delay:
            self.forget()

    @property
    def is_noisy(self) -> bool:
        """Whether any signal has noise."""
        return any(self.noise)

    def measure(self, true: VehicleState) -> tuple[VehicleState, MeasurementError]:
        """Return the motion as measured, and its error: measured minus true."""
        if self._delay:
            return self._measure_late(true)
        if not self.is_noisy:
            return true, _NO_ERROR
        error = self._draw_error()
        return with_error(true, error, cos(true.psi), sin(true.psi)), error

    def remember(self, motion: VehicleState) -> None:
        """Keep the motion of a state that the car leaves, for later measurements."""
        self._past.append(motion)
        while len(self._past) > self._whole + 1:
            self._past.popleft()

    def forget(self) -> None:
        """Forget the motions so far, as the car was placed elsewhere."""
        self._past.clear()

    def _measure_late(self, true: VehicleState) -> tuple[VehicleState, MeasurementError]:
        """Return the motion of `delay` seconds ago as measured, and its error against `true`."""
        newer = self._before(true, self._whole)
        older = self._before(true, self._whole + 1)
        measured = motion_between(newer, older, self._share)
        if self.is_noisy:
            error = self._draw_error()
            measured = with_error(measured, error, cos(measured.psi), sin(measured.psi))
        return measured, error_between(true, measured)

    def _before(self, true: VehicleState, steps: int) -> VehicleState:
        """Return the motion this many steps before `true`, or the oldest that is kept."""
        steps = min(steps, len(self._past))
        return self._past[-steps] if steps else true

    def _draw_error(self) -> MeasurementError:
        """Return the noise of the next measurement."""
        if not self._normals:
            self._normals = self._draw_normals(_BLOCK)[::-1].tolist()
        return error_of(self.noise, self._normals.pop())

    def draw_from(self, generator: np.random.Generator) -> None:
        """Take the noise of the next measurements from this generator."""
        self._generator = generator
        self._normals = []

    def new_copy(self) -> Sensor:
        """Return a new sensor with the same levels, seed and delay."""
        return Sensor(self.noise, self._seed, delay=self._delay, ts=self._ts)

    def errors(self, n: int) -> Floats:
        """Return the errors of the first `n` measurements, shape `(n, 6)`."""
        return self.normals(n) * self.noise

    def normals(self, n: int) -> Floats:
        """Return the standard normal numbers of the first `n` measurements, shape `(n, 6)`.

        `error_of` makes errors of them.
        """
        return self.new_copy()._draw_normals(n)  # noqa: SLF001 (of this class)

    def _draw_normals(self, n: int) -> Floats:
        """Return the standard normal numbers of the next `n` measurements, shape `(n, 6)`."""
        import numpy as np  # noqa: PLC0415 (a sensor without noise does not need it)

        if self._generator is None:
            self._generator = np.random.Generator(np.random.PCG64(self._seed))
        return self._generator.standard_normal((n, len(self.noise)))


@law
def error_of(noise: NoiseLevels, normals: Column) -> MeasurementError:
    """Return the error of a measurement, from a standard normal number for each signal."""
    return MeasurementError(
        noise.s * normals[0],
        noise.ey * normals[1],
        noise.epsi * normals[2],
        noise.v_x * normals[3],
        noise.v_y * normals[4],
        noise.psi_dot * normals[5],
    )


@law
def with_error(
    true: VehicleState, error: MeasurementError, cos_psi: float, sin_psi: float
) -> VehicleState:
    """Return the motion as measured, with cosine and sine of the heading.

    They rotate the position's error from the vehicle's frame into that of the road. A log passes
    records of arrays.
    """
    return VehicleState(
        true.x + error.s * cos_psi + error.ey * -sin_psi,
        true.y + error.s * sin_psi + error.ey * cos_psi,
        true.psi + error.epsi,
        true.v_x + error.v_x,
        true.v_y + error.v_y,
        true.psi_dot + error.psi_dot,
    )


@law
def motion_between(newer: VehicleState, older: VehicleState, share: float) -> VehicleState:
    """Return the motion that is a share of the way from a newer to an older one."""
    return VehicleState(
        newer.x + share * (older.x - newer.x),
        newer.y + share * (older.y - newer.y),
        newer.psi + share * (older.psi - newer.psi),
        newer.v_x + share * (older.v_x - newer.v_x),
        newer.v_y + share * (older.v_y - newer.v_y),
        newer.psi_dot + share * (older.psi_dot - newer.psi_dot),
    )


@law
def measured_late(
    motions: Column, k: int, true: VehicleState, steps: int, share: float
) -> VehicleState:
    """Return the motion that a late sensor measures in state `k`, and keep the present one.

    It is that of `steps` whole steps and a share of a step before, or that of the first state.
    `motions` is a ring of rows with the latest true motions: that of state `k` is at `k` modulo its
    length, which is at least `steps` + 2.
    """
    _store_motion(motions[k % len(motions)], true)
    newer = _motion_of(motions[max(k - steps, 0) % len(motions)])
    older = _motion_of(motions[max(k - steps - 1, 0) % len(motions)])
    return motion_between(newer, older, share)


@law
def _store_motion(row: Column, motion: VehicleState) -> None:
    row[0] = motion.x
    row[1] = motion.y
    row[2] = motion.psi
    row[3] = motion.v_x
    row[4] = motion.v_y
    row[5] = motion.psi_dot


@law
def _motion_of(row: Column) -> VehicleState:
    return VehicleState(row[0], row[1], row[2], row[3], row[4], row[5])


def error_between(true: VehicleState, measured: VehicleState) -> MeasurementError:
    """Return measured minus true, in the vehicle's true frame."""
    cos_psi = cos(true.psi)
    sin_psi = sin(true.psi)
    x = measured.x - true.x
    y = measured.y - true.y
    return MeasurementError(
        x * cos_psi + y * sin_psi,
        y * cos_psi - x * sin_psi,
        measured.psi - true.psi,
        measured.v_x - true.v_x,
        measured.v_y - true.v_y,
        measured.psi_dot - true.psi_dot,
    )


class Observation(NamedTuple):
    """One state: true, measured, with forces and actuators."""

    true: VehicleState
    measured: VehicleState
    error: MeasurementError  #: measured minus true
    surroundings: Surroundings
    acting: Command  #: the present values of the actuators
    on_track: TrackState | None = None  #: true; None without a track


class LapState(NamedTuple):
    """The laps of a car on its track."""

    lap: int = 0  #: laps before this one
    began: float = 0.0  #: [s] when it began
    is_whole: bool = False  #: the car has been on all of this lap
    finished: float = nan  #: [s] that the lap before took; NaN: it was not driven whole


class PlantModel(NamedTuple):
    """The car on its road or track, without what changes in a run."""

    bicycle: Bicycle
    motor: Channel
    servo: Channel
    is_ideal: bool  #: both actuators are, and their queues are not in use
    inclines: Inclines
    line: CentreLine
    has_track: bool  #: otherwise the car drives along its road, and there is no `line`
    ts: float  #: [s] of a step


def with_arrays(model: PlantModel) -> PlantModel:
    """Return a model as compiled loops take it: its columns are arrays, and its numbers floats."""
    import numpy as np  # noqa: PLC0415 (a single run does not need it)

    inclines = model.inclines
    line = model.line
    kind = np.dtype([(name, np.float64) for name in Segment._fields], align=True)
    segments = np.array([*map(tuple, line.segments)], kind)
    vehicle = Vehicle._make(map(float, model.bicycle.vehicle))
    lateral = LateralParameters._make(map(float, model.bicycle.lateral))
    return model._replace(
        bicycle=model.bicycle._replace(vehicle=vehicle, lateral=lateral),
        motor=_with_floats(model.motor),
        servo=_with_floats(model.servo),
        inclines=inclines._replace(
            starts=np.array(inclines.starts, np.float64),
            thetas=np.array(inclines.thetas, np.float64),
        ),
        line=line._replace(
            starts=np.array(line.starts, np.float64),
            segments=segments,
            length=float(line.length),
        ),
        ts=float(model.ts),
    )


def _with_floats(channel: Channel) -> Channel:
    """Return a channel whose actuator's numbers are floats."""
    return channel._replace(actuator=Actuator._make(map(float, channel.actuator)))


class PlantState(NamedTuple):
    """The state of the car, its actuators, and its place."""

    state: BicycleState
    slip: Slip = NO_SLIP
    acting: Command = Command()  #: the present values of the actuators
    frenet: Frenet = Frenet(0.0, 0.0, 0.0, 0.0)  #: the pose on the track
    laps: LapState = LapState()
    steps: int = 0  #: since it was placed
    segment: int = 0  #: number of the track's segment of constant curvature where the car is
    stretch: int = 0  #: number of the road's stretch of constant grade where the car is


class Queues(NamedTuple):
    """The latest commands to the actuators, which `act` stores."""

    motor: Column
    servo: Column


@law
def start(model: PlantModel, state: BicycleState, near: float, is_whole: bool) -> PlantState:
    """Return the plant at the start of a run: in this state, with its actuators at 0.

    On a track the car is near s = `near` [m], and its first lap may count as a whole one.
    """
    frenet = Frenet(0.0, 0.0, 0.0, 0.0)
    laps = LapState(0, 0.0, is_whole, nan)
    segment = 0
    if model.has_track:
        line = model.line
        frenet, segment = project(line, state.x, state.y, state.psi, near, segment_at(line, near))
        laps = LapState(max(floor(frenet.s / line.length), 0), 0.0, is_whole, nan)

    stretch = stretch_at(model.inclines.starts, on_road(model, state.x, frenet.s), 0)
    return PlantState(state, NO_SLIP, Command(0.0, 0.0), frenet, laps, 0, segment, stretch)


@law
def with_force(motor: float, force: float, vehicle: Vehicle) -> float:
    """Return an acceleration [m/s²] plus what a force [N] other than 0 adds to it."""
    return motor + force / vehicle.mass


@law
def move_actuators(
    model: PlantModel, now: PlantState, queues: Queues, command: Command, force: float
) -> tuple[Command, Command]:
    """Return the actuators' values after a step with a command, and what moves the car in the step.

    In a step acceleration and steering angle are constant: each is the mean of its actuator's
    values. A force [N] on the car adds force / mass to the mean acceleration, and leaves the
    actuators as they are.
    """
    if model.is_ideal:
        acting = command
        mean = command
    else:
        k = now.steps
        motor, mean_motor = act(
            model.motor, now.acting.motor, queues.motor, k, command.motor, model.ts
        )
        servo, mean_servo = act(
            model.servo, now.acting.servo, queues.servo, k, command.servo, model.ts
        )
        acting = Command(motor, servo)
        mean = Command(mean_motor, mean_servo)

    if force:
        mean = Command(with_force(mean.motor, force, model.bicycle.vehicle), mean.servo)
    return acting, mean


@law
def on_road(model: PlantModel, x: float, s: float) -> float:
    """Return the position [m] on the road of a car at `x`, or on a track at `s`."""
    if not model.has_track:
        return x
    return s % model.line.length if model.line.is_closed else s


@law
def arrive(
    model: PlantModel, now: PlantState, acting: Command, state: BicycleState, slip: Slip
) -> PlantState:
    """Return the plant after a step to this state."""
    frenet = now.frenet
    laps = now.laps
    segment = now.segment
    steps = now.steps + 1

    if model.has_track:
        before = now.frenet.s
        frenet, segment = project(model.line, state.x, state.y, state.psi, before, segment)

        s = frenet.s
        length = model.line.length
        lap = floor(s / length)
        if lap > laps.lap:
            t = steps * model.ts
            began = t - (s - lap * length) / (s - before) * model.ts
            finished = began - laps.began if laps.is_whole else nan
            laps = LapState(lap, began, True, finished)

    stretch = now.stretch
    if len(model.inclines.starts) > 1:
        stretch = stretch_at(model.inclines.starts, on_road(model, state.x, frenet.s), stretch)
    return PlantState(state, slip, acting, frenet, laps, steps, segment, stretch)


@law
def advance(
    model: PlantModel, now: PlantState, queues: Queues, command: Command, force: float
) -> PlantState:
    """Return the plant after a step with a command, and with a force [N] on the car."""
    acting, mean = move_actuators(model, now, queues, command, force)
    state, slip = bicycle_step(
        model.bicycle, now.state, now.slip, mean, model.inclines, now.stretch, model.ts
    )
    return arrive(model, now, acting, state, slip)


@law
def true_motion(model: PlantModel, now: PlantState) -> VehicleState:
    """Return the true state, with the velocities in the vehicle's frame."""
    return bicycle_motion(model.bicycle, now.state, now.slip, now.acting.servo)


#: In place of the centre line of a track.
_NO_LINE = CentreLine((), (), 0.0, is_closed=False)


class Plant:
    """The car on its road or track; `vehicle` may be replaced between steps.

    The attribute `model` is the car without what changes in a run, a `PlantModel`. The argument of
    the same name is a user's step function in place of the bicycle, and its default, `bikeFE`,
    stands for none.
    """

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

        On a `track` the road, by default flat, gives the hills along it, the same in each lap.

        In a step acceleration and steering angle are constant: the mean of the actuators' values.
        The force on the car, positive forwards, is constant, too: `force` [N] plus `disturbance`.
        UserError: a name is unknown, arguments contradict one another, or the step is too long.
        """
        motor = motor or Actuator()
        servo = servo or Actuator()
        if road is None:
            road = Road.flat() if track else Road.lab()
        self.road = road
        self.track = track
        self.sensor = Sensor(noise, seed, delay=sensor_delay, ts=ts)
        self.force = force
        self.disturbance = disturbance
        self.lap_times: tuple[float, ...] = ()  #: [s] of the laps that were driven whole
        # By default the bicycle makes the steps: `bikeFE` itself is not called.
        self._own_model = None if model is bikeFE else model

        car = bicycle_of(dynamics, integrator, vehicle, lateral)
        if self._own_model:
            check_own_model(car)
        if car.is_dynamic:
            check_step(car.lateral, car.vehicle, ts, integrator)

        self.model = PlantModel(
            bicycle=car,
            motor=channel_of(motor, ts),
            servo=channel_of(servo, ts),
            is_ideal=motor == servo == Actuator(),
            inclines=self.road.inclines(is_held=track is not None),
            line=track.line if track else _NO_LINE,
            has_track=track is not None,
            ts=ts,
        )
        self.now: PlantState  # which `place` sets
        pose = track.place(0.0) if track else Pose(0.0, 0.0, 0.0)
        self.place(BicycleState(pose.x, pose.y, pose.psi), near=0.0)

    @property
    def ts(self) -> float:
        """The length of a step [s]."""
        return self.model.ts

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle's parameters."""
        return self.model.bicycle.vehicle

    @vehicle.setter
    def vehicle(self, vehicle: Vehicle) -> None:
        self.model = self.model._replace(bicycle=self.model.bicycle._replace(vehicle=vehicle))

    @property
    def state(self) -> BicycleState:
        """The state of the car; it can be set between steps."""
        return self.now.state

    @state.setter
    def state(self, state: BicycleState) -> None:
        self.now = self._in_stretch(self.now._replace(state=state))

    @property
    def steps(self) -> int:
        """The steps since the car was placed."""
        return self.now.steps

    @property
    def acting(self) -> Command:
        """The present acceleration and steering angle."""
        return self.now.acting

    @property
    def frenet(self) -> Frenet | None:
        """The pose on the track; None without one."""
        return self.now.frenet if self.model.has_track else None

    @property
    def lap(self) -> int:
        """The laps before this one, as in `TrackState`."""
        return self.now.laps.lap

    @property
    def lap_time(self) -> float:
        """The time since the lap began [s], as in `TrackState`."""
        return self.now.steps * self.model.ts - self.now.laps.began

    @property
    def distance(self) -> float:
        """The distance so far [m], along the track or along the road."""
        return self.now.frenet.s if self.model.has_track else self.now.state.x

    @property
    def on_track(self) -> TrackState | None:
        """The position of the car on its track; None without one."""
        if not self.track:
            return None
        place = self.now.frenet
        return TrackState(
            place.s,
            place.e_y,
            place.e_psi,
            place.curvature,
            self.track.width,
            self.lap,
            self.lap_time,
        )

    @property
    def period_ns(self) -> int:
        """The step in whole nanoseconds, as the stamps of states have it."""
        return round(self.ts * 1e9)

    @property
    def has_fast_path(self) -> bool:
        """Whether the loop of `simulation/rollout.py` can drive the car from here.

        That loop has neither steering nor a track, nor a sensor that measures late, and takes no
        user's model. So the car must head along its road with its wheels straight, and no steering
        command may wait in the queue: it would turn the wheels later.
        """
        return (
            self.has_laws
            and not (self.track or self.sensor.delay)
            and self.state.psi == self.acting.servo == 0.0
            and not any(self.waiting.servo)
        )

    @property
    def has_laws(self) -> bool:
        """Whether laws alone move the car, so that loops over many runs can be compiled."""
        return type(self) is Plant and not (self._own_model or self.disturbance)

    @property
    def waiting(self) -> Queues:
        """The commands that have not acted yet; the oldest acts in the early part of a step."""
        k = self.now.steps
        return Queues(
            latest_commands(self._queues.motor, k, self.model.motor.whole + 1),
            latest_commands(self._queues.servo, k, self.model.servo.whole + 1),
        )

    def observe(self) -> Observation:
        """Measure the present state, late if the sensor is; each call draws new noise."""
        true = self.motion()
        measured, error = self.sensor.measure(true)
        return self._observation(true, measured, error)

    def observe_exactly(self) -> Observation:
        """Return the present state as a perfect sensor measures it; this draws no noise."""
        true = self.motion()
        return self._observation(true, true, _NO_ERROR)

    def _observation(
        self, true: VehicleState, measured: VehicleState, error: MeasurementError
    ) -> Observation:
        """Return the present state with its surroundings."""
        now = self.now
        place = on_road(self.model, now.state.x, now.frenet.s)
        around = surroundings(now.state.v, self.road.at(place), self.vehicle)
        return Observation(true, measured, error, around, now.acting, self.on_track)

    def motion(self) -> VehicleState:
        """Return the true state, with the velocities in the vehicle's frame."""
        return true_motion(self.model, self.now)

    def advance(self, command: Command) -> None:
        """Take one step with `command`."""
        model = self.model
        now = self.now
        if self.sensor.is_late:
            self.sensor.remember(true_motion(model, now))

        force = self.force
        if self.disturbance:
            force += self.disturbance(now.steps * model.ts, self.distance)
        if self._own_model:
            acting, mean = move_actuators(model, now, self._queues, command, force)
            theta = model.inclines.thetas[now.stretch]
            vehicle = model.bicycle.vehicle
            state = model_step(self._own_model, now.state, mean, theta, vehicle, model.ts)
            self.now = arrive(model, now, acting, state, now.slip)
        else:
            self.now = advance(model, now, self._queues, command, force)

        laps = self.now.laps
        if laps.lap > now.laps.lap and not isnan(laps.finished):
            self.lap_times += (laps.finished,)

    def place(self, state: BicycleState, near: float | None = None) -> None:
        """Start a run in this state, on a track near s = `near` [m], without waiting commands."""
        model = self.model
        self._queues = Queues(
            motor=[0.0] * queue_room(model.motor),
            servo=[0.0] * queue_room(model.servo),
        )
        self.sensor.forget()
        self.lap_times = ()

        is_whole = near == 0.0
        if near is None:
            near = nearest(model.line, state.x, state.y) if self.track else 0.0
        self.now = start(model, state, near, is_whole)

    def replace_actuators(self, motor: Actuator, servo: Actuator) -> None:
        """Use the parameters of these actuators from now on; waiting commands stay."""
        k = self.now.steps
        before = self.model
        after = before._replace(
            motor=channel_of(motor, self.ts),
            servo=channel_of(servo, self.ts),
            is_ideal=motor == servo == Actuator(),
        )

        queues = self._queues
        if before.is_ideal:  # the queues have had no part so far
            acting = self.acting
            queues = Queues(motor=[acting.motor] * 2, servo=[acting.servo] * 2)
        self._queues = Queues(
            motor=requeued(queues.motor, k, before.motor, after.motor),
            servo=requeued(queues.servo, k, before.servo, after.servo),
        )
        self.model = after

    def _in_stretch(self, now: PlantState) -> PlantState:
        """Return the state with the number of its stretch of the road."""
        place = on_road(self.model, now.state.x, now.frenet.s)
        return now._replace(stretch=self.road.stretch(place))


def check_own_model(bicycle: Bicycle) -> None:
    """Raise UserError if a bicycle contradicts a user's own model, which makes the steps itself."""
    if bicycle.is_rk4:
        raise UserError(
            "integrator 'rk4' cannot be used with a model of your own, which makes its steps "
            "itself: leave the integrator at 'euler'"
        )
    if bicycle.is_dynamic:
        raise UserError(
            "dynamics 'dynamic' and a model of your own contradict each other: leave dynamics at "
            "'kinematic', or leave out the model"
        )
