"""The cost over two of the gains, for a map."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

#: A map reaches this many times as far as the farther of its points, ...
_MARGIN = 2.5
#: ... and over this share of a range at least.
_LEAST = 0.05


class Surface(NamedTuple):
    """The cost over a grid of two gains; the third is that of the found point."""

    axes: tuple[int, int]  #: which gains: 0, 1 or 2 for kp, ki or kd
    right: Floats  #: those of the first, shape `(m,)`
    up: Floats  #: those of the second, shape `(n,)`
    cost: Floats  #: shape `(n, m)`; infinite where the car never arrives


def free_axes(low: Floats, high: Floats) -> tuple[int, int]:
    """Return the first two gains whose ranges are wider than a point.

    Raises
    ------
    UserError
        where fewer are.

    Examples
    --------
    >>> import numpy as np
    >>> free_axes(np.array([1.0, 0.0, 0.0]), np.array([60.0, 0.0, 5.0]))
    (0, 2)
    """
    free = np.flatnonzero(low < high)
    if len(free) < 2:  # noqa: PLR2004 (a map's)
        raise UserError(
            'the figure of --save is a map over two gains: give two of --kp-range, --ki-range and '
            '--kd-range a width'
        )
    return int(free[0]), int(free[1])


def surface(
    cost: Callable[[Floats], Floats],
    low: Floats,
    high: Floats,
    start: Floats,
    found: Floats,
    size: int,
) -> Surface:
    """Return the cost of `size` x `size` gains, in the plane of `found`.

    Parameters
    ----------
    cost
        Returns the costs, shape `(n,)`, of gains, shape `(n, 3)`.
    low, high
        The ranges, shape `(3,)`, of which no more is taken than shows both points well.
    start, found
        The points, shape `(3,)`.
    size
        Gains along a side.

    Examples
    --------
    >>> import numpy as np
    >>> def cost(gains):
    ...     return ((gains - 2.0) ** 2).sum(axis=1)
    >>> low, high, found = np.zeros(3), np.full(3, 9.0), np.full(3, 2.0)
    >>> surface(cost, low, high, np.ones(3), found, size=5).cost.shape
    (5, 5)
    """
    axes = free_axes(low, high)
    far = np.maximum(_MARGIN * np.maximum(start, found), low + _LEAST * (high - low))
    high = np.minimum(high, far)
    right, up = (np.linspace(low[axis], high[axis], size) for axis in axes)
    gains = np.tile(found, (size * size, 1))
    for axis, grid in zip(axes, np.meshgrid(right, up), strict=True):
        gains[:, axis] = grid.ravel()
    return Surface(axes, right, up, cost(gains).reshape(size, size))
