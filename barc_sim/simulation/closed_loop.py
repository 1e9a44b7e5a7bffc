"""The closed loop of vehicle and controller without ROS: the nodes' trajectory bit for bit.

`simulate` takes a user's options or a `Scenario`, `closed_loop` a plant and a controller.
`Progress` ends the run of a car that never arrives.

The loop here drives any plant with any pilot. The most common run, which is also the default of
`simulate`, does not need it: a PID drives straight along a road (`Plant.has_fast_path`). For that
run `closed_loop` calls `rollout.pid_log`, whose shorter loop gives the same log.
`simulation/__init__.py` lists all loops.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import fields, replace
from itertools import chain
from math import inf, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.control.cruise_control import SPEED
from barc_sim.control.lane import LANE, LaneLQR
from barc_sim.control.pilots import (
    STEERING,
    LaneKeeping,
    Pilot,
    SpeedPilot,
    as_lane_pilot,
    as_pilot,
)
from barc_sim.control.situation import Navigator
from barc_sim.control.speed import (
    FIRST_DT,
    PID,
    SPEED_REFERENCE,
    speed_controller,
)
from barc_sim.errors import UserError
from barc_sim.interfaces.topics import LANE_STATE
from barc_sim.simulation.law_runs import RUNAWAY
from barc_sim.simulation.log import TrackLog, columns_of, log_of
from barc_sim.simulation.rollout import pid_log
from barc_sim.simulation.scenario import LIMITS, Scenario
from barc_sim.vehicle.bike_model import bikeFE
from barc_sim.vehicle.parameters import needs_track
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.track import Track, is_off_track

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    from numpy.typing import NDArray

    from barc_sim.control.lane import LaneController
    from barc_sim.control.speed import Controller
    from barc_sim.interfaces.records import Command, TrackState
    from barc_sim.simulation.log import Log
    from barc_sim.vehicle.bicycles import LateralParameters
    from barc_sim.vehicle.bike_model import Model, Vehicle
    from barc_sim.vehicle.plant import Actuator, NoiseLevels, Observation
    from barc_sim.vehicle.road import Road, Signal

    #: Observation, command, and what the controllers computed.
    _Row = tuple[Observation, Command, Sequence[float]]


# The defaults of `lap`.
LAP_TRACK = 'L'
LAP_SPEED = 6.0  #: [m/s]
LAPS = 3
_LAPS = LIMITS['laps']._replace(between=(1, 10**6))


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
    noise: float | NoiseLevels = Scenario.noise,
    delay: float = Scenario.delay,
    sensor_delay: float = Scenario.sensor_delay,
    disturbance: float | str | PathLike[str] | Signal = Scenario.disturbance,
    controller: object | None = None,
    model: Model = bikeFE,
    speed_reference: float = Scenario.speed_reference,
    reference: str | PathLike[str] | Signal | None = None,
    distance: float = Scenario.distance,
    max_duration: float = Scenario.max_duration,
    seed: int = Scenario.seed,
    acceleration_limit: float = Scenario.acceleration_limit,
    integrator: str = Scenario.integrator,
    dynamics: str = Scenario.dynamics,
    lateral: LateralParameters | None = None,
    ts: float = Scenario.ts,
    track: Track | str | PathLike[str] | None = None,
    lane: LaneController | Pilot | None = None,
    servo: Actuator | None = None,
    e_y: float = Scenario.e_y,
    scenario: Scenario | None = None,
) -> Log:
    """Return the log of a cruise-control run: the trajectory of `acc` with these options.

    They are the fields of a `Scenario`, which can be given in their place.

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
    sensor_delay
        [s] age of a measurement at its stamp: the published state is this much older.
    disturbance
        [N] force on the car, positive forwards: a number, a function of the time since the start
        [s] and the position along the road [m], or the path of a CSV file with the columns
        `time_s,force_n` or `distance_m,force_n`.
    controller
        An object with the lab's `acc_calculate(speed_reference, speed_current)`, to which dt [s]
        is a third argument if it takes one. A copy of it drives in place of the PID; a `Pilot`
        drives itself.
    model
        A function with the arguments and the result of `bikeFE`; `l_f`, `l_r` and `g` are passed
        if it has parameters of these names.
    reference
        In place of `speed_reference`: a function of the time since the start [s] and the measured
        position [m], or the path of a CSV file with the columns `time_s,speed_mps` or
        `distance_m,speed_mps`.
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
    scenario
        A run as a value, in place of all other arguments.

    Returns
    -------
    Log
        A row for each state, the last one at or beyond the end.

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
    of_arguments = Scenario(
        kp=kp,
        ki=ki,
        kd=kd,
        road=road,
        vehicle=vehicle,
        noise=noise,
        delay=delay,
        sensor_delay=sensor_delay,
        disturbance=disturbance,
        controller=controller,
        model=model,
        speed_reference=speed_reference,
        reference=reference,
        distance=distance,
        max_duration=max_duration,
        seed=seed,
        acceleration_limit=acceleration_limit,
        integrator=integrator,
        dynamics=dynamics,
        lateral=lateral,
        ts=ts,
        track=track,
        lane=lane,
        servo=servo,
        e_y=e_y,
    )
    return drive_scenario(chosen_scenario(scenario, of_arguments))


def drive_scenario(scenario: Scenario) -> Log:
    """Return the log of a run; UserError: the car can never arrive, or fields contradict."""
    plant = scenario.plant()
    if scenario.laps > 1 and not plant.track:
        raise needs_track(f'laps={scenario.laps}')
    if scenario.reference is None and scenario.end < inf:
        check_ahead(scenario.speed_reference, scenario.end)

    controller = scenario.controller
    pilot = as_pilot(PID(**scenario.gains) if controller is None else controller)
    pilot.set_gains(pilot.gain_values)  # which checks them
    pilot.limit(scenario.acceleration_limit)
    pilot.reset()
    return closed_loop(
        plant,
        pilot,
        speed_reference=scenario.speed_reference,
        reference=scenario.signal(),
        distance=scenario.end,
        max_duration=scenario.max_duration,
        lane=as_lane_pilot(deepcopy(scenario.lane)),
    )


def chosen_scenario(
    scenario: Scenario | None, of_arguments: Scenario, default: Scenario | None = None
) -> Scenario:
    """Return `scenario`, or if it is None, the one `of_arguments`.

    `default` is the scenario of a call without arguments. UserError: arguments were passed beside
    `scenario`, so that `of_arguments` differs from `default`.
    """
    if scenario is None:
        return of_arguments

    default = default or Scenario()
    if not isinstance(scenario, Scenario):
        raise UserError(f'scenario {scenario!r} must be of type Scenario, such as {Scenario()!r}')
    for field in fields(of_arguments):
        if getattr(of_arguments, field.name) != getattr(default, field.name):
            raise UserError(
                f'{field.name} beside a scenario: give one or the other; '
                f'dataclasses.replace(scenario, {field.name}=…) makes another scenario'
            )
    return scenario


def lap(
    lane: LaneController | Pilot | None = None,
    track: Track | str | PathLike[str] = LAP_TRACK,
    *,
    speed: float | str | PathLike[str] | Signal = LAP_SPEED,
    laps: int = LAPS,
    scenario: Scenario | None = None,
    **options: Any,  # noqa: ANN401 (of `simulate`)
) -> TrackLog:
    """Return the log of laps from a standstill; it ends early if the car leaves the track.

    Parameters
    ----------
    lane
        The steering law, an object with `steer_calculate(e_y, e_psi, speed, curvature)`:
        `LaneLQR()`, `Stanley()`, `PurePursuit()`, or your own. `curvature(d)` returns the curvature
        of the centre line `d` metres ahead [1/m]. A copy of it drives; it can be a `Pilot`, too.
    track
        A `Track`, the name of one, or the path of a CSV file with the columns `length_m,radius_m`.
    speed
        [m/s] to hold, or a function of time and of the position along the track, such as
        `speed_profile` returns.
    laps
        Number of laps, one after another.
    scenario
        A run on a track as a value, in place of all other arguments.
    options
        All other arguments of `simulate`. A `delay` delays the steering, too.

    Returns
    -------
    TrackLog
        A row for each state; `lap_times` and `best` have the times.

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
    default = _of_laps(None, LAP_TRACK, LAP_SPEED, LAPS)
    of_arguments = _of_laps(lane, track, speed, laps, **options)
    scenario = chosen_scenario(scenario, of_arguments, default)
    if not scenario.track:
        raise needs_track('lap')

    log = drive_scenario(replace(scenario, lane=scenario.lane or LaneLQR()))
    assert isinstance(log, TrackLog)  # noqa: S101 (it has a track)
    return log


def _of_laps(
    lane: LaneController | Pilot | None,
    track: Track | str | PathLike[str],
    speed: float | str | PathLike[str] | Signal,
    laps: int,
    **options: Any,  # noqa: ANN401 (of `Scenario`)
) -> Scenario:
    """Return the scenario of `lap`."""
    road = Track.of(track)
    _LAPS.check(laps)
    road.check_laps(laps)
    speeds: dict[str, Any] = {'reference': speed}
    if isinstance(speed, (float, int)):
        SPEED.check(speed, 'reference')
        speeds = {'speed_reference': speed}
    longest = min(laps * Scenario.max_duration, LIMITS['max_duration'].between[1])
    options = {'max_duration': longest, **speeds, **options}
    return Scenario(lane=lane, track=road, laps=laps, distance=0.0, **options)


def closed_loop(
    plant: Plant | None = None,
    controller: Controller | Pilot | None = None,
    *,
    speed_reference: float = SPEED_REFERENCE,
    reference: Signal | None = None,
    distance: float = Scenario.distance,
    max_duration: float = Scenario.max_duration,
    progress: Progress | None = None,
    lane: LaneController | Pilot | None = None,
) -> Log:
    """Drive a plant with a controller, and return the log.

    A plain `PID` straight along a road takes the shorter loop of `rollout`, for the same log.

    Parameters
    ----------
    plant, controller
        By default those of a run; they must not be used again.
    speed_reference
        [m/s] to hold.
    reference
        In its place: the speed to hold over time and measured position.
    distance, max_duration
        [m], [s]: the drive ends at this distance, or after this simulated time.
    progress
        Ends the drive of a car that never arrives early, as a run does.
    lane
        Steers on a track, where the drive ends if the car leaves it.

    Returns
    -------
    Log
        Its last row is the first state at or beyond `distance`, with the command that answers it.
    """
    plant = plant or Plant()
    speed = as_pilot(speed_controller() if controller is None else controller)
    steps = round(max_duration / plant.ts)
    of_speed = speed.controller if isinstance(speed, SpeedPilot) else None
    if type(of_speed) is PID and plant.has_fast_path and not (progress or reference):
        return pid_log(plant, of_speed, speed_reference, distance, steps)

    track = plant.track
    names = ['saturated', *speed.terms]
    pilot: Pilot = speed
    keeping: LaneKeeping | None = None
    if track:
        progress = progress or Progress(inf)
        keeping = LaneKeeping(speed, as_lane_pilot(lane))
        pilot = keeping
        of_lane = columns_of(LANE_STATE)
        names += [of_lane[field] for field in STEERING]
        names += [LANE + name for name in keeping.own_terms]

    def constant(_t: float, _x: float) -> float:
        return speed_reference

    reference = reference or constant
    navigator = Navigator(track)
    period = plant.period_ns
    dt = FIRST_DT
    rows: list[_Row] = []
    references: list[float] = []
    for k in range(steps + 1):
        observation = plant.observe()
        situation = navigator.situation(k * period / 1e9, dt, observation.measured, reference)
        command = pilot.command(situation)

        values = [speed.saturated, *speed.values()]
        if keeping:
            values += keeping.steering_values()
            values += keeping.own_values()
        rows.append((observation, command, values))
        references.append(situation.reference)

        if plant.distance >= distance:
            break
        if progress and progress.add(
            k * plant.ts,
            plant.distance,
            observation.true.v_x,
            situation.reference,
            observation.on_track,
        ):
            break
        plant.advance(command)
        dt = period / 1e9  # as the nodes take it from stamps

    if not pilot.follows_reference:
        return log_of_rows(rows, period, nan, names, track)
    return log_of_rows(rows, period, references, names, track)


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
    observations, commands, values = zip(*rows, strict=True)
    on_track = None
    if observations[0].on_track is not None:
        on_track = _arrays([each.on_track for each in observations])
    computed = dict(zip(names, _columns(values), strict=True))
    computed['reference'] = np.full(len(rows), references)

    log = log_of(
        period_ns,
        _arrays([each.measured for each in observations]),
        _arrays([each.error for each in observations]),
        _arrays(commands),
        _arrays([each.surroundings for each in observations]),
        on_track,
        **computed,
    )
    return replace(log, track=track) if isinstance(log, TrackLog) else log


def _arrays(records: Sequence[Any]) -> Any:  # noqa: ANN401 (a record of arrays)
    """Return `n` records as one, whose fields are arrays of shape `(n,)`."""
    return type(records[0])(*_columns(records))


def _columns(rows: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """Return the columns of rows, of shape `(columns, rows)`; NumPy takes twice as long for it."""
    width = len(rows[0])
    values = np.fromiter(chain.from_iterable(rows), np.float64, len(rows) * width)
    columns: NDArray[np.float64] = values.reshape(-1, width).T.copy()
    return columns


#: [s] of simulated time without progress, after which the run ends.
STALL_TIMEOUT = 20.0
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
            self._best = x
            self._since = t
        if self._may_stand and reference <= 0.0:
            self._since = t
        self._may_stand = self._may_stand or reference > 0.0

        self.failure = ''
        if abs(v) > RUNAWAY:
            self.failure = f'the car {self._does(x, v)}; at {v:.4g} m/s it is given up'
            return True
        if place and is_off_track(place.e_y, place.width):
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
        if abs(v) > RUNAWAY:
            return 'gets faster and faster: a sign is wrong, or a gain is too large'
        where = f'is at {x:.1f} m, at {v:.2f} m/s, and was at {self._best:.1f} m'
        if x < self._best - _BACKWARDS:
            return f'{where}: the commands may be too small for this hill'
        return f'{where}: the model must return x, y, psi and v of the next step'
