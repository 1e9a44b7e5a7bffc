"""Many closed loops at once: the arithmetic of `straight_loop` on NumPy arrays, all loops in step.

The laws, `pid_step` and `next_speed`, stand here once more, by hand: in place on arrays that stay
in a core's cache. Rare events (a limit reached, a change of grade, a car that stands or rolls back)
are detected with one reduction and handled apart. Tests compare both to the last bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.simulation import straight_loop
from barc_sim.simulation.straight_loop import Result

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from barc_sim.tuning.course import Course

    Floats = NDArray[np.float64]

#: Loops driven together: their arrays stay in a core's cache.
BLOCK = 8192
#: Up to so many loops are faster one by one.
FEW = 48
_ROWS = 18


def drive(course: Course, gains: Floats, block: int = BLOCK) -> Result:
    """Drive a loop over `course` for each of `gains`, shape `(n, 3)`: kp, ki, kd.

    Examples
    --------
    >>> import numpy as np
    >>> from barc_sim.tuning.course import Course
    >>> drive(Course(), np.array([[10.0, 20.0, 0.0], [30.0, 200.0, 0.1]])).steps
    array([1151, 1151])
    """
    if len(gains) <= FEW:
        rows = [drive_one(course, *each) for each in gains.tolist()]
        return _result(np.array(rows).reshape(-1, len(Result._fields)).T)
    starts = range(0, len(gains), block)
    return joined(_Block(course, gains[start : start + block]).drive() for start in starts)


def drive_one(course: Course, kp: float, ki: float, kd: float) -> Result:
    """Drive one loop over `course`.

    Examples
    --------
    >>> from barc_sim.tuning.course import Course
    >>> drive_one(Course(), 10.0, 20.0, 0.0).steps
    1151
    """
    found = straight_loop.drive(
        kp,
        ki,
        kd,
        course.setting,
        course.stretches,
        course.errors,
        [0.0] * course.delay,
        straight_loop.Start(),
        (),
    )
    return Result(*found)


def joined(parts: Iterable[Result]) -> Result:
    """Return the results of all loops in one."""
    return Result(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _result(columns: Floats) -> Result:
    steps, squares, count, *others = columns
    return Result(steps.astype(np.int64), squares, count.astype(np.int64), *others)


class _Block:
    """Loops in step with one another, without those that have arrived."""

    def __init__(self, course: Course, gains: Floats) -> None:
        self._setting = course.setting
        self._errors = course.errors
        self._stretches = tuple(np.array(each) for each in course.stretches)
        self._found = np.full((len(Result._fields), len(gains)), -1.0)
        self._commands = np.zeros((course.delay, len(gains)))
        self._number = np.arange(len(gains))
        self._on_first = np.ones(len(gains), np.bool_)
        self._name_rows(np.zeros((_ROWS, len(gains))))
        self._kp[:], self._ki[:], kd = gains.T
        np.negative(kd, out=self._minus_kd)
        self._previous[:] = self._errors[0]
        self._slowest = 0.0
        self._locate(np.ones(len(gains), np.bool_))

    def drive(self) -> Result:
        """Drive all of them; return their sums."""
        interval = 0.0  # none before the first sample: nothing is added to the integral
        for k, error in enumerate(self._errors):
            command = self._control(error, interval)
            interval = self._setting.dt
            self._account(command)
            if self._arriving:
                command = self._arrive(k, command)
                if not self._number.size:
                    break
            if len(self._commands):
                slot = self._commands[k % len(self._commands)]
                slot[:], command = command, slot.copy()
            self._advance(command)
        return _result(self._found)

    def _name_rows(self, rows: Floats) -> None:
        """Name the rows of `rows`, shape (_ROWS, loops): the state of the loops, and scratch."""
        self._rows = rows
        self._kp, self._ki, self._minus_kd = rows[:3]
        self._x, self._v, self._integral, self._previous = rows[3:7]
        self._begin, self._end, self._push = rows[7:10]
        self._squares, self._before, self._greatest, self._peak, self._effort = rows[10:15]
        self._a, self._b, self._c = rows[15:]

    def _control(self, measurement_error: float, interval: float) -> Floats:
        """Return the commands of the PIDs."""
        setting, error, increment, wanted = self._setting, self._a, self._b, self._c
        measured = np.add(self._v, measurement_error)
        np.subtract(setting.reference, measured, out=error)
        np.multiply(self._ki, error, out=increment)
        increment *= interval
        np.multiply(self._kp, error, out=wanted)
        wanted += self._integral
        wanted += increment
        derivative = np.subtract(measured, self._previous, out=self._previous)
        derivative *= self._minus_kd
        derivative /= setting.dt
        wanted += derivative
        self._previous[:] = measured
        command: Floats = np.minimum(wanted, setting.high, out=measured)
        np.maximum(command, setting.low, out=command)
        wanted -= command
        wanted *= increment
        if np.maximum.reduce(wanted) > 0.0:  # into the limit
            increment *= wanted <= 0.0
        self._integral += increment
        return command

    def _account(self, command: Floats) -> None:
        """Add the present states and their commands to the sums."""
        deviation, square = self._a, self._b
        self._effort += np.multiply(command, command, out=square)
        np.subtract(self._setting.reference, self._v, out=deviation)
        counts = self._x >= self._setting.run_up
        if not counts.all():
            deviation *= counts
            self._before += ~counts
        self._squares += np.multiply(deviation, deviation, out=square)
        np.abs(deviation, out=deviation)
        np.maximum(self._greatest, deviation, out=self._greatest)
        if self._on_first.any():
            self._on_first &= self._x < self._setting.first_end
            np.maximum(self._peak, self._v, out=self._peak, where=self._on_first)

    def _arrive(self, k: int, command: Floats) -> Floats:
        """Keep the sums of the loops that are at the distance in step `k`, and drop these loops."""
        there = self._x >= self._setting.distance
        self._found[:, self._number[there]] = (
            np.full(np.count_nonzero(there), k),
            self._squares[there],
            k + 1 - self._before[there],
            self._greatest[there],
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
        setting, v, force, other = self._setting, self._v, self._a, self._b
        vehicle = setting.vehicle
        self._x += np.multiply(v, setting.ts, out=other)
        resistance = np.multiply(v, vehicle.air_drag_coeff, out=force)
        resistance *= v
        resistance += vehicle.friction
        forwards = self._slowest > 0.0
        if not forwards:
            np.copysign(resistance, v, out=resistance)
            resistance *= v != 0.0
        np.subtract(self._push, resistance, out=force)
        v_next = self._accelerated(force, command)
        self._slowest = np.minimum.reduce(v_next)
        if not forwards or self._slowest < 0.0:
            # Resistance slows the car to a standstill and never pushes it backwards.
            np.copyto(other, self._push)
            unresisted = self._accelerated(other, command)
            up, down = np.minimum(unresisted, 0.0), np.maximum(unresisted, 0.0)
            np.maximum(v_next, up, out=v_next, where=v > 0.0)
            np.minimum(v_next, down, out=v_next, where=v < 0.0)
            self._slowest = np.minimum.reduce(v_next)
        v[:] = v_next
        moved = self._x >= self._end
        if not forwards:
            moved |= self._x < self._begin
        if moved.any():
            self._locate(moved)

    def _accelerated(self, force: Floats, command: Floats) -> Floats:
        """Return the next speed under `force`, in its place."""
        force /= self._setting.vehicle.mass
        force += command
        force *= self._setting.ts
        force += self._v
        return force

    def _locate(self, moved: NDArray[np.bool_]) -> None:
        """Find the stretch of those that have moved to another, or to the distance."""
        begins, ends, pushes = self._stretches
        x = self._x[moved]
        stretch = np.searchsorted(begins, x, side='right') - 1
        self._begin[moved] = begins[stretch]
        self._end[moved] = np.minimum(ends[stretch], self._setting.distance)
        self._push[moved] = pushes[stretch]
        self._arriving = bool((x >= self._setting.distance).any())
