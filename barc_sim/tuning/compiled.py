"""Closed loops compiled by Numba, on all cores; there where the extra `numba` is installed."""

from __future__ import annotations

import importlib
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.tuning.course import Result
from barc_sim.tuning.single import loop

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from barc_sim.tuning.course import Course


def is_available() -> bool:
    """Return whether Numba is installed and runs."""
    try:
        importlib.import_module('numba')
    except ImportError:  # also where this NumPy is too new for it
        return False
    return True


def drive(course: Course, gains: NDArray[np.float64]) -> Result:
    """Drive a loop over `course` for each of `gains`, shape `(n, 3)`: kp, ki, kd.

    The first call in a process compiles, which takes seconds, unless an earlier process has.
    """
    found = np.empty((len(gains), len(Result._fields)))
    constants = tuple(course.constants)
    tables = tuple(np.array(column) for column in (*course.stretches, course.errors))
    _compiled()(np.ascontiguousarray(gains), constants, tables, course.delay, found)
    steps, squares, count, *others = found.T
    return Result(steps.astype(np.int64), squares, count.astype(np.int64), *others)


@cache
def _compiled() -> Callable[..., None]:
    """Return the loops over the compiled `loop`, which is the plain one, compiled as it is.

    Without `fastmath` LLVM keeps the order of the arithmetic, and fuses none of it.
    """
    numba: Any = importlib.import_module('numba')
    one = numba.njit(loop)
    prange = numba.prange

    def all_of(  # type: ignore[no-untyped-def]  # noqa: ANN202 (Numba's types, not Python's)
        gains,  # noqa: ANN001
        constants,  # noqa: ANN001
        tables,  # noqa: ANN001
        delay,  # noqa: ANN001
        found,  # noqa: ANN001
    ):
        for i in prange(gains.shape[0]):
            steps, squares, count, greatest, peak, effort = one(
                gains[i, 0], gains[i, 1], gains[i, 2], constants, *tables, np.zeros(delay)
            )
            found[i, 0] = steps
            found[i, 1] = squares
            found[i, 2] = count
            found[i, 3] = greatest
            found[i, 4] = peak
            found[i, 5] = effort

    compiled: Callable[..., None] = numba.njit(all_of, parallel=True, nogil=True)
    return compiled
