"""The search for the minimum cost: differential evolution, all of a generation at once.

Storn and Price, "Differential evolution: a simple and efficient heuristic for global optimization
over continuous spaces", Journal of Global Optimization 11 (1997), in its variant best/1/bin with
dithered weights. It needs no derivative, which a cost with limits and a road does not have,
and it is not caught by local minima and unstable gains.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

#: Gains have so many significant digits: what is printed is what was driven.
DIGITS = 4
_WEIGHTS = (0.5, 1.0)  # of a difference, drawn anew in each generation
_CROSSOVER = 0.7  # how probable it is that a gain changes
#: It has converged where the costs in the population are as close together as this.
_TOLERANCE = 1e-4
#: A map reaches this many times as far as the farther of its points, ...
_MARGIN = 2.5
#: ... and over this share of a range at least.
_MIN_SHARE = 0.05


class Found(NamedTuple):
    """Where a search ended."""

    gains: Floats  #: shape `(3,)`: kp, ki, kd
    cost: float  #: infinite where no gains in the ranges arrive
    evaluations: int


def search(
    cost: Callable[[Floats], Floats],
    low: Floats,
    high: Floats,
    start: Floats,
    *,
    seed: int = 0,
    population: int = 256,
    generations: int = 80,
    on_generation: Callable[[int, float], object] = lambda *_: None,
) -> Found:
    """Return the gains of minimum `cost` between `low` and `high`, shape `(d,)`.

    The same arguments give the same gains. `cost` returns the costs, shape `(n,)`, of gains, shape
    `(n, d)`. `start`, moved between `low` and `high`, is one of the first gains tried. A generation
    has `population` gains, at least 4. After each, `on_generation` is called with the number of
    those before it and the minimum cost up to now.
    """
    random = np.random.default_rng(seed)
    places = rounded(_spread(random, population, low, high))
    places[0] = np.clip(start, low, high)
    costs = cost(places)
    evaluations = population
    for generation in range(generations):
        on_generation(generation, float(costs.min()))
        if _converged(costs):
            break
        trials = rounded(np.clip(_trials(random, places, costs), low, high))
        trial_costs = cost(trials)
        evaluations += population
        better = trial_costs <= costs
        places[better], costs[better] = trials[better], trial_costs[better]
    best = np.argmin(costs)
    return Found(places[best], float(costs[best]), evaluations)


def rounded(gains: Floats) -> Floats:
    """Return `gains` with `DIGITS` significant digits."""
    return np.array([float(f'{gain:.{DIGITS}g}') for gain in gains.flat]).reshape(gains.shape)


def _spread(random: np.random.Generator, number: int, low: Floats, high: Floats) -> Floats:
    """Return a Latin hypercube: one in each of `number` equal parts of every range."""
    parts = np.column_stack([random.permutation(number) for _ in low])
    return low + (parts + random.random(parts.shape)) / number * (high - low)


def _trials(random: np.random.Generator, places: Floats, costs: Floats) -> Floats:
    """Return a rival for each of `places`."""
    number, gains = places.shape
    weight = random.uniform(*_WEIGHTS)
    # Two others, neither the same nor the one itself.
    one = (np.arange(number) + random.integers(1, number, number)) % number
    other = (one + random.integers(1, number - 1, number)) % number
    other = np.where(other == np.arange(number), (other + 1) % number, other)
    other = np.where(other == one, (other + 1) % number, other)
    mutants = places[np.argmin(costs)] + weight * (places[one] - places[other])
    crossed = random.random(places.shape) < _CROSSOVER
    crossed[np.arange(number), random.integers(0, gains, number)] = True
    return np.where(crossed, mutants, places)


def _converged(costs: Floats) -> bool:
    minimum, maximum = costs.min(), costs.max()
    return bool(np.isfinite(maximum)) and bool(maximum - minimum <= _TOLERANCE * abs(minimum))


class Surface(NamedTuple):
    """The cost over a grid of two gains; the third is that of the found point."""

    axes: tuple[int, int]  #: which gains: 0, 1 or 2 for kp, ki or kd
    right: Floats  #: those of the first, shape `(m,)`
    up: Floats  #: those of the second, shape `(n,)`
    cost: Floats  #: shape `(n, m)`; infinite where the car never arrives


def free_axes(low: Floats, high: Floats) -> tuple[int, int]:
    """Return the first two gains whose ranges are wider than a point."""
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

    No more of the ranges from `low` to `high` is taken than shows both points well.
    """
    axes = free_axes(low, high)
    far = np.maximum(_MARGIN * np.maximum(start, found), low + _MIN_SHARE * (high - low))
    high = np.minimum(high, far)
    right, up = (np.linspace(low[axis], high[axis], size) for axis in axes)
    gains = np.tile(found, (size * size, 1))
    for axis, grid in zip(axes, np.meshgrid(right, up), strict=True):
        gains[:, axis] = grid.ravel()
    return Surface(axes, right, up, cost(gains).reshape(size, size))
