"""Many closed loops at once as NumPy arrays: the arithmetic of `single.loop`, a step of all a time.

What happens rarely (a limit reached, a change of grade, a car that stands or rolls back) is looked
for with one reduction, and done apart.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.tuning.course import Result

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from barc_sim.tuning.course import Course

    Floats = NDArray[np.float64]

#: Loops driven together: their arrays stay in a core's cache.
BLOCK = 4096
_ROWS = 18


def drive(course: Course, gains: Floats, block: int = BLOCK) -> Result:
    """Drive a loop over `course` for each of `gains`, shape `(n, 3)`: kp, ki, kd."""
    starts = range(0, len(gains), block)
    return joined(_Block(course, gains[start : start + block]).drive() for start in starts)


def joined(parts: Iterable[Result]) -> Result:
    """Return the results of all loops in one."""
    return Result(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


class _Block:
    """Loops in step with one another; those that have arrived leave it."""

    def __init__(self, course: Course, gains: Floats) -> None:
        self._constants = course.constants
        self._errors = course.errors
        self._stretches = tuple(np.array(each) for each in course.stretches)
        self._found = np.full((len(Result._fields), len(gains)), -1.0)
        self._commands = np.zeros((course.delay, len(gains)))
        self._number = np.arange(len(gains))
        self._on_first = np.ones(len(gains), np.bool_)
        self._lay(np.zeros((_ROWS, len(gains))))
        self._kp[:], self._ki[:], kd = gains.T
        np.negative(kd, out=self._minus_kd)
        self._previous[:] = self._errors[0]
        self._slowest = 0.0
        self._locate(np.ones(len(gains), np.bool_))

    def drive(self) -> Result:
        """Drive all of them; return what they leave."""
        interval = 0.0  # none before the first sample: nothing is added to the integral
        for k, error in enumerate(self._errors):
            command = self._control(error, interval)
            interval = self._constants.dt
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
        return Result(steps.astype(np.int64), squares, count.astype(np.int64), *others)

    def _lay(self, rows: Floats) -> None:
        """Take `rows`, shape (_ROWS, loops), as what is known of the loops, and scratch."""
        self._rows = rows
        self._kp, self._ki, self._minus_kd = rows[:3]
        self._x, self._v, self._integral, self._previous = rows[3:7]
        self._begin, self._end, self._push = rows[7:10]
        self._squares, self._before, self._greatest, self._peak, self._effort = rows[10:15]
        self._a, self._b, self._c = rows[15:]

    def _control(self, measurement_error: float, interval: float) -> Floats:
        """Return the commands of the PIDs."""
        constants, error, increment, wanted = self._constants, self._a, self._b, self._c
        measured = np.add(self._v, measurement_error)
        np.subtract(constants.reference, measured, out=error)
        np.multiply(self._ki, error, out=increment)
        increment *= interval
        np.multiply(self._kp, error, out=wanted)
        wanted += self._integral
        wanted += increment
        derivative = np.subtract(measured, self._previous, out=self._previous)
        derivative *= self._minus_kd
        derivative /= constants.dt
        wanted += derivative
        self._previous[:] = measured
        command: Floats = np.minimum(wanted, constants.limit, out=measured)
        np.maximum(command, -constants.limit, out=command)
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
        np.subtract(self._constants.reference, self._v, out=deviation)
        counts = self._x >= self._constants.run_up
        if not counts.all():
            deviation *= counts
            self._before += ~counts
        self._squares += np.multiply(deviation, deviation, out=square)
        np.abs(deviation, out=deviation)
        np.maximum(self._greatest, deviation, out=self._greatest)
        if self._on_first.any():
            self._on_first &= self._x < self._constants.first_end
            np.maximum(self._peak, self._v, out=self._peak, where=self._on_first)

    def _arrive(self, k: int, command: Floats) -> Floats:
        """Note what the loops leave that are at the distance in step `k`, and drop them."""
        there = self._x >= self._constants.distance
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
        self._lay(self._rows[:, left])
        self._arriving = False
        remaining: Floats = command[left]
        return remaining

    def _advance(self, command: Floats) -> None:
        """Go one step."""
        constants, v, force, other = self._constants, self._v, self._a, self._b
        self._x += np.multiply(v, constants.ts, out=other)
        resistance = np.multiply(v, constants.drag, out=force)
        resistance *= v
        resistance += constants.friction
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
        force /= self._constants.mass
        force += command
        force *= self._constants.ts
        force += self._v
        return force

    def _locate(self, moved: NDArray[np.bool_]) -> None:
        """Find the stretch of those that have moved to another, or to the distance."""
        begins, ends, pushes = self._stretches
        x = self._x[moved]
        stretch = np.searchsorted(begins, x, side='right') - 1
        self._begin[moved] = begins[stretch]
        self._end[moved] = np.minimum(ends[stretch], self._constants.distance)
        self._push[moved] = pushes[stretch]
        self._arriving = bool((x >= self._constants.distance).any())
