"""The closed loop of vehicle and controller without ROS: the nodes' trajectory bit for bit.

`simulate` takes a user's options, `closed_loop` a plant and a controller. `Progress` ends the run
of a car that never arrives.
"""

from __future__ import annotations

import inspect
from copy import deepcopy
from dataclasses import replace
from math import inf, nan
from operator import attrgetter
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.control.cruise_control import LIMIT, SPEED, reference_of
from barc_sim.control.lane import LANE, LaneKeeping, LaneLQR
from barc_sim.control.speed import (
    ACCELERATION_LIMIT,
    FIRST_DT,
    PID,
    SPEED_REFERENCE,
    as_controller,
    check_gains,
    speed_controller,
)
from barc_sim.errors import Parameter, UserError
from barc_sim.simulation.log import LANE_STATE, TrackLog, columns_of, log_of
from barc_sim.simulation.rollout import pid_log
from barc_sim.simulation.stepper import DISTANCE as END
from barc_sim.simulation.stepper import LAPS
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import Command, State, Vehicle, bikeFE
from barc_sim.vehicle.parameters import FORCE_COLUMN, NANOSECONDS, ROWS, SERVO
from barc_sim.vehicle.plant import Actuator, NoiseLevels, Plant
from barc_sim.vehicle.road import Road, signal
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    from barc_sim.control.lane import LaneController
    from barc_sim.control.speed import Controller
    from barc_sim.simulation.log import Log
    from barc_sim.vehicle.bike_model import Model
    from barc_sim.vehicle.plant import Observation, TrackState
    from barc_sim.vehicle.road import Signal

    #: Observation, command, and what the controllers computed.
    _Row = tuple[Observation, Command, tuple[float, ...]]


DISTANCE = 180.0  #: [m] of a run
MAX_DURATION = 600.0  #: [s]
#: The limits of the arguments of `simulate`: those of the nodes' parameters.
LIMITS = {
    'speed_reference': SPEED,
    'acceleration_limit': LIMIT,
    'distance': END,
    'max_duration': Parameter('max_duration', MAX_DURATION, 'simulated time [s]', (0.0, 1e5)),
    'seed': ROWS['seed'],
    'noise': ROWS['noise_v_x'],
    'delay': ROWS['motor_delay'],
    'ts': Parameter('ts', 0.02, 'step [s]', (0.001, 1.0)),
    'e_y': Parameter('e_y', 0.0, 'start of the car, to the left [m]', (-1e3, 1e3)),
}


def check_arguments(**arguments: object) -> None:
    """Raise UserError if an argument of `simulate` is beyond its limits."""
    for name, value in arguments.items():
        if not isinstance(value, NoiseLevels):  # which has checked itself
            LIMITS[name].check(value, name)


def check_ahead(speed_reference: float, distance: float) -> None:
    """Raise UserError if a car at `speed_reference` [m/s] can never arrive at `distance` [m]."""
    if speed_reference < 0.0 < distance:
        raise UserError(
            f'speed_reference {speed_reference:g} leads away from the distance, {distance:g} m '
            'ahead: give a speed above 0, or distance 0'
        )


def simulate(
    kp: float | None = None,
    ki: float | None = None,
    kd: float | None = None,
    *,
    road: Road | str | PathLike[str] | None = None,
    vehicle: Vehicle | None = None,
    noise: float | NoiseLevels = 0.0,
    delay: float = 0.0,
    disturbance: float | str | PathLike[str] | Signal = 0.0,
    controller: object | None = None,
    model: Model = bikeFE,
    speed_reference: float = SPEED_REFERENCE,
    reference: str | PathLike[str] | Signal | None = None,
    distance: float = DISTANCE,
    max_duration: float = MAX_DURATION,
    seed: int = 0,
    acceleration_limit: float = ACCELERATION_LIMIT,
    integrator: str = 'euler',
    dynamics: str = 'kinematic',
    lateral: LateralParameters | None = None,
    ts: float = 0.02,
    track: Track | str | PathLike[str] | None = None,
    lane: LaneController | None = None,
    servo: Actuator | None = None,
    e_y: float = 0.0,
) -> Log:
    """Return the log of a cruise-control run: the trajectory of `acc` with these options.

    Parameters
    ----------
    kp, ki, kd
        Gains of the PID; by default those of `acc`.
    road
        A road, 'lab', 'flat', or the path of a CSV file with the columns `start_m,grade_deg`;
        unless given the lab's, and on a track a flat one.
    vehicle
        Its parameters; by default the lab's.
    noise
        Standard deviation of the measured speed [m/s], or of every signal.
    delay
        [s] from a command to its effect.
    disturbance
        [N] force on the car, positive forwards: a number, a function of the time since the start
        [s] and the position along the road [m], or the path of a CSV file with the columns
        `time_s,force_n` or `distance_m,force_n`.
    controller
        An object with the lab's `acc_calculate(speed_reference, speed_current)`, to which dt [s]
        is a third argument if it takes one. A copy of it drives in place of the PID.
    model
        A function with the arguments and the result of `bikeFE`; `l_f`, `l_r` and `g` are passed
        if it has parameters of these names.
    reference
        In place of `speed_reference`: a function of time and measured position, as above, or the
        path of a CSV file with the columns `time_s,speed_mps` or `distance_m,speed_mps`.
    speed_reference, distance, max_duration
        [m/s], [m], [s]: the run ends at `distance` (0: it does not), or after `max_duration` of
        simulated time.
    seed
        Seed of the noise.
    acceleration_limit
        [m/s²] maximum commanded acceleration and deceleration.
    integrator, ts
        'euler' or 'rk4', in steps of `ts` [s], in whole nanoseconds.
    dynamics, lateral
        'kinematic', or 'dynamic': the bicycle model; the tyres of the dynamic one are `lateral`.
    track, lane
        The arguments of `lap`. Without a track the car drives along the road's axis.
    servo
        The actuator of the steering; by default on a track a lag of 0.1 s and at most 1 rad/s.
    e_y
        [m] start of the car on a track, to the left of the centre line.

    Raises
    ------
    UserError
        if the road cannot be read, an argument is out of its limits, or arguments contradict one
        another.

    Examples
    --------
    >>> log = simulate(kp=10.0, ki=20.0, kd=0.0, noise=0.05)
    >>> print(f'{log.speed[-1]:.1f} m/s after {log.t[-1]:.1f} s')
    8.0 m/s after 23.0 s
    """
    arguments = locals()
    named = {'kp': kp, 'ki': ki, 'kd': kd}
    gains = {name: gain for name, gain in named.items() if gain is not None}
    if controller is not None and gains:
        raise UserError(
            f'{", ".join(gains)} are gains of the PID, which controller={controller!r} replaces: '
            'give one or the other'
        )
    plant = plant_of(**arguments)
    if isinstance(lane, type) or (lane and not callable(getattr(lane, 'steer_calculate', None))):
        raise UserError(
            f'lane={lane!r} must be an object with a method steer_calculate(e_y, e_psi, speed, '
            'curvature), such as LaneLQR()'
        )
    if not plant.track and (lane or e_y):
        argument = f'lane={lane!r}' if lane else f'e_y={e_y:g}'
        raise UserError(f"{argument} needs a track: give one, such as track='L'")
    if reference is None:
        check_ahead(speed_reference, distance)
    driving: Controller = PID(**gains)
    if controller is not None:
        driving = as_controller(controller)
        check_gains(driving)
    driving.output_min, driving.output_max = -acceleration_limit, acceleration_limit
    driving.reset()
    return closed_loop(
        plant,
        driving,
        speed_reference=speed_reference,
        reference=None if reference is None else reference_of(reference),
        distance=distance or inf,
        max_duration=max_duration,
        lane=deepcopy(lane),
    )


def plant_of(**arguments: Any) -> Plant:  # noqa: ANN401 (of `simulate`)
    """Return the plant at the start of a run of `simulate` with these of its arguments.

    UserError: one of them is out of its limits, or they contradict one another.
    """
    options = SimpleNamespace(**{**(simulate.__kwdefaults__ or {}), **arguments})
    check_arguments(**{name: value for name, value in arguments.items() if name in LIMITS})
    for name, kind in (('vehicle', Vehicle), ('lateral', LateralParameters), ('servo', Actuator)):
        value = getattr(options, name)
        if value is not None and not isinstance(value, kind):
            field = kind._fields[0]
            example = f'{kind.__name__}({field}={getattr(kind(), field)})'
            raise UserError(f'{name} {value!r} must be of type {kind.__name__}, such as {example}')
    force = signal(options.disturbance, ROWS['disturbance'], FORCE_COLUMN)
    is_constant = isinstance(options.disturbance, (float, int))
    noise, model, vehicle = options.noise, options.model, options.vehicle
    plant = Plant(
        road=None if options.road is None else Road.of(options.road),
        vehicle=vehicle and Vehicle(*vehicle),  # which checks it: `_replace` does not
        ts=round(options.ts * NANOSECONDS) / NANOSECONDS,
        noise=noise if isinstance(noise, NoiseLevels) else NoiseLevels(v_x=noise),
        seed=options.seed,
        force=force(0.0, 0.0) if is_constant else 0.0,
        disturbance=None if is_constant else force,
        model=model if model is bikeFE else _with_options(model),
        motor=Actuator(delay=options.delay),
        servo=options.servo or (SERVO._replace(delay=options.delay) if options.track else None),
        integrator=options.integrator,
        dynamics=options.dynamics,
        lateral=options.lateral,
        track=Track.of(options.track) if options.track else None,
    )
    if plant.track and options.e_y:
        plant.place(State(*plant.track.place(0.0, options.e_y)))
    return plant


def lap(
    lane: LaneController | None = None,
    track: Track | str | PathLike[str] = 'L',
    *,
    speed: float | str | PathLike[str] | Signal = 6.0,
    laps: int = 3,
    **options: Any,  # noqa: ANN401 (of `simulate`)
) -> TrackLog:
    """Return the log of laps from a standstill; it ends early if the car leaves the track.

    Parameters
    ----------
    lane
        The steering law, an object with `steer_calculate(e_y, e_psi, speed, curvature)`:
        `LaneLQR()`, `Stanley()`, `PurePursuit()`, or your own. `curvature(d)` returns the curvature
        of the centre line `d` metres ahead [1/m]. A copy of it drives.
    track
        A `Track`, the name of one, or the path of a CSV file with the columns `length_m,radius_m`.
    speed
        [m/s] to hold, or a function of time and of the position along the track, such as
        `speed_profile` returns.
    laps
        Number of laps, one after another.
    options
        All other arguments of `simulate`. A `delay` delays the steering, too.

    Raises
    ------
    UserError
        if an argument is out of its limits, as in `simulate`.

    Examples
    --------
    >>> log = lap(laps=2, dynamics='dynamic')
    >>> print(f'{log.best:.2f} s, at most {abs(log.e_y).max():.2f} m off the centre line')
    29.18 s, at most 0.16 m off the centre line
    """
    road = Track.of(track)
    LAPS._replace(between=(1, 10**6)).check(laps)
    road.check_laps(laps)
    options = {'max_duration': min(laps * MAX_DURATION, 1e5), **options}
    return simulate(  # type: ignore[return-value]  # on a track
        track=road,
        lane=lane or LaneLQR(),
        reference=reference_of(speed),
        distance=laps * road.length,
        **options,
    )


def closed_loop(
    plant: Plant | None = None,
    controller: Controller | None = None,
    *,
    speed_reference: float = SPEED_REFERENCE,
    reference: Signal | None = None,
    distance: float = DISTANCE,
    max_duration: float = MAX_DURATION,
    progress: Progress | None = None,
    lane: LaneController | None = None,
) -> Log:
    """Drive until `distance` [m] is reached, or for `max_duration` [s] of simulated time.

    `reference`, if given, is the speed to hold over time and measured position. With `progress` the
    drive of a car that never arrives ends early, as a run does. On a track `lane` steers, and the
    drive ends if the car leaves the track.
    `plant` and `controller`, by default those of a run, must not be used again. The last row is the
    first state at or beyond `distance`, with the command that answers it.
    """
    plant = plant or Plant()
    controller = speed_controller() if controller is None else as_controller(controller)
    steps = round(max_duration / plant.ts)
    if type(controller) is PID and plant.has_fast_path and not (progress or reference):
        return pid_log(plant, controller, speed_reference, distance, steps)
    names = ['saturated', *controller.terms]
    # With one name alone, an attrgetter would return no tuple.
    read = attrgetter(*names) if names[1:] else lambda each: (each.saturated,)
    rows: list[_Row] = []
    held, references = speed_reference, []
    dt, servo = FIRST_DT, 0.0
    track, keeping, steering = plant.track, None, ()
    if track:
        progress = progress or Progress(inf)
        keeping, of_lane = LaneKeeping(lane, track), columns_of(LANE_STATE)
        names += [*of_lane.values(), *(LANE + name for name in keeping.own_terms)]
    see = getattr(controller, 'see', lambda _: None)  # its place, of a policy
    for k in range(steps + 1):
        seen = plant.observe()
        place, y, psi, speed, *_ = seen.measured
        if keeping:
            servo = keeping.steer(place, y, psi, speed)
            place, made = keeping.place.s, keeping.computed()
            steering = *(made[field] for field in of_lane), *made['values']
        if reference:
            held = reference(k * plant.period_ns / 1e9, place)
        see(place)
        motor = controller.acc_calculate(held, speed, dt)
        motor = keeping.acceleration(motor) if keeping else motor
        command = Command(motor, servo)
        references.append(nan if keeping and keeping.plans_speed else held)
        rows.append((seen, command, read(controller) + steering))
        if plant.distance >= distance:
            break
        if progress and progress.add(
            k * plant.ts, plant.distance, seen.true.v_x, held, seen.on_track
        ):
            break
        plant.advance(command)
        dt = plant.period_ns / 1e9  # as the nodes take it from stamps
    return log_of_rows(rows, plant.period_ns, references, names, track)


def log_of_rows(
    rows: Sequence[_Row],
    period_ns: int,
    references: Sequence[float] | float = nan,
    names: Sequence[str] = ('saturated',),
    track: Track | None = None,
) -> Log:
    """Return the log of states and their commands, in steps of `period_ns`.

    `names` are the columns and own terms that the values of a row are.
    """
    seen, commands, values = zip(*rows, strict=True)
    _, measured, errors, around, _, on_track = zip(*seen, strict=True)
    columns = np.array(values, dtype=np.float64).T.copy()
    log = log_of(
        period_ns,
        _arrays(measured),
        _arrays(errors),
        _arrays(commands),
        _arrays(around),
        on_track[0] and _arrays(on_track),
        **dict(zip(names, columns, strict=True)) | {'reference': np.full(len(rows), references)},
    )
    return replace(log, track=track) if isinstance(log, TrackLog) else log


def _arrays(records: Sequence[Any]) -> Any:  # noqa: ANN401 (a record of arrays)
    """Return `n` records as one, whose fields are arrays of shape `(n,)`."""
    return type(records[0])(*np.array(records, dtype=np.float64).T.copy())


def _with_options(model: Model) -> Model:
    """Return `model` with those of the arguments `l_f`, `l_r` and `g` that it takes."""
    parameters = inspect.signature(model).parameters.values()
    if any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters):
        return model
    names = {each.name for each in parameters}

    def adapted(*state_and_input: float, **options: float) -> Sequence[float]:
        accepted = {name: value for name, value in options.items() if name in names}
        return model(*state_and_input, **accepted)

    return adapted


#: [s] of simulated time without progress, after which the run ends.
STALL_TIMEOUT = 20.0
_RUNAWAY = 1000.0  #: [m/s] beyond which the run ends at once: an unstable loop has no bound
_ADVANCE = 0.01  #: [m] that counts as progress
_STANDS = 0.05  #: [m/s] below which a car stands
_BACKWARDS = 1.0  #: [m] behind the start, or the place that it has reached


class Progress:
    """Follows a car towards the end of its road, state by state.

    Attributes
    ----------
    failure
        A sentence on what the car does, if the run must end; otherwise empty.
    """

    def __init__(self, distance: float) -> None:
        """Follow the car to `distance` [m]; with infinity, a car that stands may go on."""
        self._distance = distance
        self._since = 0.0  # [s] of the last progress
        self._best = -inf
        self._may_stand = False
        self.failure = ''

    def add(
        self, t: float, x: float, v: float, reference: float, place: TrackState | None = None
    ) -> bool:
        """Take a state, [s], [m], [m/s], [m/s]; return whether the run is to end.

        A car may stand while its reference is 0, once that was positive. Its `place` on a track is
        not to be beyond the edge.
        """
        if x > self._best + _ADVANCE:
            self._best, self._since = x, t
        if self._may_stand and reference <= 0.0:
            self._since = t
        self._may_stand = self._may_stand or reference > 0.0
        self.failure = ''
        if abs(v) > _RUNAWAY:
            self.failure = f'the car {self._does(x, v)}; at {v:.4g} m/s it is given up'
            return True
        if place and abs(place.e_y) > 0.5 * place.width:
            side = 'left' if place.e_y > 0.0 else 'right'
            self.failure = f'the car left the track to the {side} at {x:.1f} m'
            return True
        if self._distance == inf or x >= self._distance:
            return False
        if t - self._since <= STALL_TIMEOUT:
            return False
        self.failure = f'the car {self._does(x, v)}; it got no further for {STALL_TIMEOUT:g} s'
        return True

    def _does(self, x: float, v: float) -> str:
        """Return what the car does at `x` [m] and `v` [m/s], with a probable cause."""
        if x < -_BACKWARDS and self._best < _BACKWARDS:
            return f'drives backwards, to {x:.4g} m: the error is speed_reference - speed_current'
        if abs(v) <= _STANDS:
            return f'stands at {x:.1f} m: the commands do not move it'
        if abs(v) > _RUNAWAY:
            return 'gets faster and faster: a sign is wrong, or a gain is too large'
        where = f'is at {x:.1f} m, at {v:.2f} m/s, and was at {self._best:.1f} m'
        if x < self._best - _BACKWARDS:
            return f'{where}: the commands may be too small for this hill'
        return f'{where}: the model must return x, y, psi and v of the next step'
