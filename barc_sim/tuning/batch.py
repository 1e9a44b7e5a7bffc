"""Many closed loops at once: what `pid_log` drives one by one, all loops in step.

Tests compare both to the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim import tuning
from barc_sim.control.speed import ACCELERATION_LIMIT, SPEED_REFERENCE
from barc_sim.simulation.closed_loop import DISTANCE, LIMITS, check_arguments, simulate
from barc_sim.simulation.fast import PIDs, RoadSegments, next_speeds
from barc_sim.simulation.metrics import RUN_UP
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.parameters import NANOSECONDS
from barc_sim.vehicle.plant import NoiseLevels, Sensor, in_steps
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from barc_sim.control.speed import Controller
    from barc_sim.simulation.log import Log

    Floats = NDArray[np.float64]

#: Loops driven together: their arrays stay in a core's cache.
BLOCK = 8192
#: A loop fails to arrive where it takes longer than this many times the expected duration.
_MAX_DURATION_FACTOR = 3.0
_ROWS = 15


@dataclass(frozen=True)
class Course:
    """A road to drive at a speed: arguments of `simulate`, of which a batch takes no others."""

    road: Road = field(default_factory=Road.lab)
    vehicle: Vehicle = field(default_factory=Vehicle)
    noise: float = 0.0  #: [m/s] standard deviation of the measured speed
    delay: float = 0.0  #: [s] from a command to its effect; whole steps in a batch
    speed_reference: float = SPEED_REFERENCE  #: [m/s]
    distance: float = DISTANCE  #: [m] beyond the run-up
    seed: int = 0  #: of the noise, as in a run
    acceleration_limit: float = ACCELERATION_LIMIT  #: [m/s²] of the command, either way
    ts: float = 0.02  #: [s]

    def __post_init__(self) -> None:
        """Raise UserError where a number is out of its limits, or no car arrives."""
        arguments = vars(self)
        check_arguments(**{name: arguments[name] for name in arguments.keys() & LIMITS.keys()})
        tuning.SPEED.check(self.speed_reference)
        tuning.DISTANCE.check(self.distance)

    @property
    def max_duration(self) -> float:
        """[s] after which a loop counts as failing to arrive."""
        expected = self.distance / self.speed_reference
        return _MAX_DURATION_FACTOR * (expected + self.speed_reference / self.acceleration_limit)

    @property
    def steps(self) -> int:
        """The maximum number of steps, as `closed_loop` counts them."""
        return round(self.max_duration / self.step)

    @property
    def is_batchable(self) -> bool:
        """Whether a batch can drive it: its delay is in whole steps, and its noise a number."""
        return not (in_steps(self.delay, self.step)[1] or isinstance(self.noise, tuple))

    def drive(self, controller: Controller, **others: Any) -> Log:  # noqa: ANN401 (of `simulate`)
        """Return the log of a run of `controller`, with `others` of the arguments of `simulate`."""
        arguments = {each.name: getattr(self, each.name) for each in fields(self)}
        arguments |= {'max_duration': self.max_duration, **others}
        return simulate(controller=controller, **arguments)

    @cached_property
    def step(self) -> float:
        """`ts` in whole nanoseconds [s]."""
        return round(self.ts * NANOSECONDS) / NANOSECONDS

    @cached_property
    def first_end(self) -> float:
        """Where the first change of grade is [m]."""
        road = self.road
        pairs = zip(road.starts, road.grades_deg, strict=True)
        return next((start for start, grade in pairs if grade != road.grades_deg[0]), inf)

    @cached_property
    def errors(self) -> list[float]:
        """The measurement error [m/s] of each state's speed: the same for all loops."""
        if not self.noise:
            return [-0.0] * (self.steps + 1)
        errors = Sensor(NoiseLevels(v_x=self.noise), self.seed).draw(self.steps + 1)
        return list(errors[3].tolist())


class Sums(NamedTuple):
    """The sums of a loop, of which its scores are made; of many loops, an array of each."""

    steps: Any  #: from the first state to the one at the distance; -1: it never arrived
    squares: Any  #: [m²/s²] sum of the squared speed errors after the run-up
    count: Any  #: how many they are
    maximum: Any  #: [m/s] maximum absolute one of them
    peak: Any  #: [m/s] maximum speed on the first segment
    effort: Any  #: [m²/s⁴] sum of the squared commands


def run_batch(course: Course, gains: Floats, block: int = BLOCK) -> Sums:
    """Drive a loop over `course` for each of `gains`, shape `(n, 3)`: kp, ki, kd."""
    starts = range(0, len(gains), block)
    parts = (_Block(course, gains[start : start + block]).drive() for start in starts)
    return Sums(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


class _Block:
    """Loops in step with one another, without those that have arrived."""

    def __init__(self, course: Course, gains: Floats) -> None:
        self._course = course
        self._segments = tuple(map(np.array, RoadSegments.of(course.road, course.vehicle)))
        self._found = np.full((len(Sums._fields), len(gains)), -1.0)
        delay, _ = in_steps(course.delay, course.step)
        self._commands = np.zeros((delay, len(gains)))
        self._number = np.arange(len(gains))
        self._on_first = np.ones(len(gains), np.bool_)
        self._name_rows(np.zeros((_ROWS, len(gains))))
        self._rows[:3] = (gains * (1.0, 1.0, -1.0)).T
        self._pids.previous[:] = course.errors[0]
        self._locate(np.ones(len(gains), np.bool_))

    def drive(self) -> Sums:
        """Drive all of them; return their sums."""
        interval = 0.0  # none before the first sample: nothing is added to the integral
        for k, error in enumerate(self._course.errors):
            command = self._pids.control(self._v + error, self._course.speed_reference, interval)
            interval = self._course.step
            self._account(command)
            if self._arriving:
                command = self._arrive(k, command)
                if not self._number.size:
                    break
            if len(self._commands):
                slot = self._commands[k % len(self._commands)]
                slot[:], command = command, slot.copy()
            self._advance(command)
        steps, squares, count, *others = self._found
        return Sums(steps.astype(np.int64), squares, count.astype(np.int64), *others)

    def _name_rows(self, rows: Floats) -> None:
        """Name the rows of `rows`, shape (_ROWS, loops): the state of the loops, and their sums."""
        self._rows = rows
        limit = self._course.acceleration_limit
        self._pids = PIDs(-limit, limit, self._course.step, *rows[:5])
        self._x, self._v = rows[5:7]
        self._begin, self._end, self._gravity_force = rows[7:10]
        self._squares, self._before, self._maximum, self._peak, self._effort = rows[10:]

    def _account(self, command: Floats) -> None:
        """Add the present states and their commands to the sums."""
        self._effort += command * command
        deviation = np.abs(self._course.speed_reference - self._v)
        counts = self._x >= RUN_UP
        if not counts.all():
            deviation *= counts
            self._before += ~counts
        self._squares += deviation * deviation
        np.maximum(self._maximum, deviation, out=self._maximum)
        if self._on_first.any():
            self._on_first &= self._x < self._course.first_end
            np.maximum(self._peak, self._v, out=self._peak, where=self._on_first)

    def _arrive(self, k: int, command: Floats) -> Floats:
        """Keep the sums of the loops that are at the distance in step `k`, and drop these loops."""
        there = self._x >= self._course.distance
        self._found[:, self._number[there]] = (
            np.full(np.count_nonzero(there), k),
            self._squares[there],
            k + 1 - self._before[there],
            self._maximum[there],
            self._peak[there],
            self._effort[there],
        )
        left = ~there
        self._number, self._on_first = self._number[left], self._on_first[left]
        self._commands = self._commands[:, left]
        self._name_rows(self._rows[:, left])
        self._arriving = False
        remaining: Floats = command[left]
        return remaining

    def _advance(self, command: Floats) -> None:
        """Go one step."""
        ts, vehicle, v = self._course.step, self._course.vehicle, self._v
        self._x += ts * v
        forwards = v.min() > 0.0
        v[:] = next_speeds(v, command, self._gravity_force, vehicle, ts)
        moved = self._x >= self._end
        if not forwards:
            moved |= self._x < self._begin
        if moved.any():
            self._locate(moved)

    def _locate(self, moved: NDArray[np.bool_]) -> None:
        """Find the segment of those that have moved to another, or to the distance."""
        begins, ends, gravity_forces = self._segments
        x = self._x[moved]
        segment = np.searchsorted(begins, x, side='right') - 1
        self._begin[moved] = begins[segment]
        self._end[moved] = np.minimum(ends[segment], self._course.distance)
        self._gravity_force[moved] = gravity_forces[segment]
        self._arriving = bool((x >= self._course.distance).any())
