"""The runs of a car under laws of speed and steering: one loop, in Python or compiled.

The car drives along a road or a track, by any of the bicycles, with its actuators and its sensor.
A `PID` or an `LQR` holds its speed; a `LaneLQR`, a `Stanley` or a `PurePursuit` steers. The loop
calls the laws that `Plant`, `Navigator` and these controllers call, in the same order: its states
are those of `closed_loop` to the last bit.

`rollout` has another loop, for a PID on a road: without steering and noise of the place it needs
half of the time for a step, compiled or not, and its trace has all that a log needs.
"""

from __future__ import annotations

from math import cos, inf, nan, sin, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.control.lane import (
    NO_LANE,
    POINTS,
    LaneGains,
    ProfileColumns,
    SpeedProfile,
    lane_gains,
    profile_speed,
    steer,
    with_lane_gains,
)
from barc_sim.control.pilots import LanePilot, SpeedPilot, StraightAhead
from barc_sim.control.speed import (
    FIRST_DT,
    LqrMemory,
    PidMemory,
    SpeedGains,
    SpeedMemory,
    accelerate,
    speed_gains,
    with_speed_gains,
)
from barc_sim.interfaces.records import Command, VehicleState
from barc_sim.simulation.many_runs import scores_of_many, usual_states
from barc_sim.simulation.scores import (
    Driven,
    DrivenOnTrack,
    LaneScores,
    Scores,
    first_states,
    score,
    score_lane,
)
from barc_sim.vehicle.law import compiled, is_compiled, law
from barc_sim.vehicle.plant import (
    NoiseLevels,
    PlantModel,
    PlantState,
    Queues,
    advance,
    error_of,
    in_steps,
    measured_late,
    queue_room,
    true_motion,
    with_arrays,
    with_error,
)
from barc_sim.vehicle.road import stretch_at
from barc_sim.vehicle.track import (
    CentreLine,
    Frenet,
    Pose,
    in_lap,
    is_off_track,
    locate,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from barc_sim.control.pilots import Pilot
    from barc_sim.vehicle.plant import Plant

    Floats = NDArray[np.float64]
    Ints = NDArray[np.intp]
    Column = Any  #: a list of numbers in Python, an array in compiled code

#: [m/s] beyond which a run on a track ends at once: an unstable loop has no bound.
RUNAWAY = 1000.0
GAINS = 3  #: of a controller at most


class Conditions(NamedTuple):
    """What runs have in common; columns of numbers are lists or arrays."""

    plant: PlantModel
    start: PlantState
    force: float  #: [N] on the car
    width: float  #: [m] of the track
    noise: NoiseLevels
    is_late: bool  #: the sensor measures late, by
    late_steps: int  #: whole steps and
    late_share: float  #: a share of a step
    reference: float  #: [m/s] speed to hold, unless there is a profile
    has_profile: bool
    profile: ProfileColumns
    distance: float  #: [m] at which a run ends
    period_ns: int  #: between two stamps


class Laws(NamedTuple):
    """What decides: a law of the speed and one of the steering."""

    speed: SpeedGains
    lane: LaneGains


class Rooms(NamedTuple):
    """The memory that runs overwrite: the queues of the actuators, and columns of states."""

    queues: Queues
    motions: Column  #: the latest true ones of a late sensor, a row for each
    curvatures: Column  #: [1/m] `POINTS` values
    driven: Driven
    on_track: DrivenOnTrack


#: In place of the profile of a speed that is constant.
_NO_PROFILE = ProfileColumns((), (), (), 0.0)


@law
def must_end(v_x: float, e_y: float, width: float) -> bool:
    """Return whether a car on a track is too fast, or beyond the edge."""
    return abs(v_x) > RUNAWAY or is_off_track(e_y, width)


@law
def drive_by_laws(conditions: Conditions, laws: Laws, normals: Column, rooms: Rooms) -> int:
    """Drive until the run ends, or the columns are full; return the number of states.

    `normals` has a row of normal numbers for each state; it is empty without noise.
    """
    model = conditions.plant
    line = model.line
    driven = rooms.driven
    on_track = rooms.on_track
    clear(rooms.queues.motor)
    clear(rooms.queues.servo)

    now = conditions.start
    memory = SpeedMemory(PidMemory(0.0, nan), LqrMemory(0.0, 0.0, nan))
    place = Frenet(0.0, 0.0, 0.0, 0.0)
    segment = 0
    dt = FIRST_DT
    count = 0
    while True:
        true = true_motion(model, now)
        seen, error = measure(conditions, normals, rooms.motions, count, true)

        along = now.state.x
        reference = conditions.reference
        servo = 0.0
        if model.has_track:
            along = now.frenet.s
            pose = Pose(seen.x, seen.y, seen.psi)
            place, segment = locate(line, conditions.width, pose, place.s, segment)
            if conditions.has_profile:
                reference = reference_at(line, conditions.profile, place.s, segment)
            servo = steer(laws.lane, line, place, segment, seen.v_x, rooms.curvatures)
        memory, motor = accelerate(memory, laws.speed, reference, seen.v_x, dt)
        dt = conditions.period_ns / 1e9

        driven.along[count] = along
        driven.speed[count] = seen.v_x - error
        driven.reference[count] = reference
        driven.motor[count] = motor
        if model.has_track:
            on_track.e_y[count] = now.frenet.e_y
            on_track.lap[count] = now.laps.lap
            on_track.lap_time[count] = now.steps * model.ts - now.laps.began
        count += 1
        if along >= conditions.distance or count == len(driven.along):
            return count
        if model.has_track and must_end(true.v_x, now.frenet.e_y, conditions.width):
            return count

        now = advance(model, now, rooms.queues, Command(motor, servo), conditions.force)


@law
def clear(queue: Column) -> None:
    """Let no command wait in the queue of an actuator."""
    for k in range(len(queue)):
        queue[k] = 0.0


@law
def measure(
    conditions: Conditions, normals: Column, motions: Column, k: int, true: VehicleState
) -> tuple[VehicleState, float]:
    """Return the measured motion of state `k`, and the error of its speed [m/s]."""
    seen = true
    error = 0.0
    if conditions.is_late:
        seen = measured_late(motions, k, true, conditions.late_steps, conditions.late_share)
    if len(normals) > 0:
        noise = error_of(conditions.noise, normals[k])
        seen = with_error(seen, noise, cos(seen.psi), sin(seen.psi))
        error = noise.v_x
    if conditions.is_late:
        error = seen.v_x - true.v_x
    return seen, error


@law
def reference_at(line: CentreLine, profile: ProfileColumns, s: float, segment: int) -> float:
    """Return the speed [m/s] of a profile at `s` [m], on this segment or not far from it."""
    s = in_lap(line, s)
    segment = stretch_at(line.starts, s, segment)
    return profile_speed(profile, segment, s - line.starts[segment])


def score_drives(
    conditions: Conditions,
    laws: Laws,
    gains: Floats,
    normals: Column,
    rooms: Rooms,
    scores: Floats,
) -> None:
    """Drive with each of the gains, shape `(n, 6)`, and store the scores.

    The first `GAINS` columns are of the speed, the others of the steering. The scores are the
    fields of `Scores` and `LaneScores`, shape `(n, 7)`.
    """
    model = conditions.plant
    lap = inf
    if model.has_track and model.line.is_closed:
        lap = model.line.length
    for i in range(len(gains)):
        of_run = Laws(
            with_speed_gains(laws.speed, gains[i, :GAINS]),
            with_lane_gains(laws.lane, gains[i, GAINS:]),
        )
        count = drive_by_laws(conditions, of_run, normals, rooms)
        of_speed = Scores(inf, inf, inf, inf)
        of_lane = LaneScores(inf, inf, inf)
        if rooms.driven.along[count - 1] >= conditions.distance:
            first = first_states(model.inclines, rooms.driven, count, lap)
            of_speed = score(rooms.driven, count, first)
            if model.has_track:
                of_lane = score_lane(rooms.on_track, count, conditions.period_ns)
        scores[i, 0] = of_speed.rms_error
        scores[i, 1] = of_speed.max_error
        scores[i, 2] = of_speed.overshoot
        scores[i, 3] = of_speed.effort
        scores[i, 4] = of_lane.rms_e_y
        scores[i, 5] = of_lane.max_e_y
        scores[i, 6] = of_lane.best_lap


class LawRuns:
    """Many runs of one car under laws: all but their gains and their seeds.

    Parameters
    ----------
    plant
        The car at its start, which `has_laws`.
    laws
        The laws, with the gains that are not swept.
    reference
        [m/s] the speed to hold: a number, or on its track a `SpeedProfile`.
    distance
        [m] at which a run ends.
    steps
        after which a run ends even if it has not arrived.
    """

    def __init__(
        self,
        plant: Plant,
        laws: Laws,
        reference: float | SpeedProfile,
        distance: float,
        steps: int,
    ) -> None:
        """Take what the runs have in common."""
        self._score_drives = compiled(score_drives)
        self._laws = laws
        self._states = steps + 1
        self._usual = usual_states(distance, _slowest(reference), plant.ts)
        self._sensor = plant.sensor
        self._width = len(Scores._fields)
        if plant.track:
            self._width += len(LaneScores._fields)

        profile = _NO_PROFILE
        speed = nan
        if isinstance(reference, SpeedProfile):
            profile = reference.columns
        else:
            speed = float(reference)

        model = plant.model
        if is_compiled():
            model = with_arrays(model)
            profile = ProfileColumns(
                lengths=np.array(profile.lengths, np.float64),
                limits=np.array(profile.limits, np.float64),
                squares=np.array(profile.squares, np.float64),
                along=float(profile.along),
            )
        late_steps, late_share = in_steps(plant.sensor.delay, plant.ts)
        self._conditions = Conditions(
            plant=model,
            start=plant.now,
            force=float(plant.force),
            width=float(plant.track.width) if plant.track else inf,
            noise=NoiseLevels._make(map(float, plant.sensor.noise)),
            is_late=plant.sensor.delay > 0.0,
            late_steps=late_steps,
            late_share=float(late_share),
            reference=speed,
            has_profile=isinstance(reference, SpeedProfile),
            profile=profile,
            distance=float(distance),
            period_ns=plant.period_ns,
        )

    def scores(
        self,
        of_speed: Floats,
        of_lane: Floats | None = None,
        seeds: Ints | None = None,
        threads: int | None = None,
    ) -> Floats:
        """Return the scores of many runs, on all cores where they are compiled.

        Parameters
        ----------
        of_speed, of_lane
            gains of each run, in the order of their classes' `gains`: a row for each run.
        seeds
            of the noise of each run, shape `(n,)`; by default the plant's for all.
        threads
            number of threads for compiled runs; by default one for each core.

        Returns
        -------
        ndarray
            The fields of `Scores` of each run, and on a track those of `LaneScores`, too.
        """
        gains = np.zeros((len(of_speed), 2 * GAINS))
        gains[:, : of_speed.shape[1]] = of_speed
        if of_lane is not None:
            gains[:, GAINS : GAINS + of_lane.shape[1]] = of_lane
        return scores_of_many(
            self._score_runs,
            self._sensor,
            gains,
            self._width,
            self._states,
            seeds,
            self._usual,
            threads,
        )

    def _score_runs(self, gains: Floats, normals: Floats, states: int) -> Floats:
        """Return the scores of some of the runs, as `scores_of_many` takes them."""
        scores = np.empty((len(gains), len(Scores._fields) + len(LaneScores._fields)))
        rows: Column = normals if is_compiled() else normals.tolist()
        self._score_drives(self._conditions, self._laws, gains, rows, self._rooms(states), scores)
        return scores[:, : self._width]

    def _rooms(self, states: int) -> Rooms:
        """Return the memory for this number of states."""

        def column(room: int) -> Column:
            return np.zeros(room) if is_compiled() else [0.0] * room

        model = self._conditions.plant
        motions = np.zeros((self._conditions.late_steps + 2, len(VehicleState._fields)))
        return Rooms(
            queues=Queues(column(queue_room(model.motor)), column(queue_room(model.servo))),
            motions=motions if is_compiled() else motions.tolist(),
            curvatures=column(POINTS),
            driven=Driven._make(column(states) for _ in Driven._fields),
            on_track=DrivenOnTrack._make(
                column(states if model.has_track else 0) for _ in DrivenOnTrack._fields
            ),
        )


def _slowest(reference: float | SpeedProfile) -> float:
    """Return the speed [m/s] that a car holds at least."""
    if isinstance(reference, SpeedProfile):
        return sqrt(min(reference.columns.squares))
    return reference


def laws_of(speed: Pilot, lane: Pilot, limit: float) -> Laws | None:
    """Return the laws of two pilots with their gains, and accelerations within ±`limit` [m/s²].

    None: one of the pilots has a law that the loop does not have.
    """
    of_speed: SpeedGains | None = None
    if type(speed) is SpeedPilot:
        of_speed = speed_gains(speed.controller, float(limit))
    of_lane: LaneGains | None = None
    if type(lane) is StraightAhead:
        of_lane = NO_LANE
    elif type(lane) is LanePilot:
        of_lane = lane_gains(lane.controller)
    return Laws(of_speed, of_lane) if of_speed and of_lane else None
