"""The search for gains: differential evolution, all of a generation at once.

Storn and Price, "Differential evolution: a simple and efficient heuristic for global optimization
over continuous spaces", Journal of Global Optimization 11 (1997), in its variant best/1/bin with
dithered weights. It needs no derivative, which a cost with limits and a road does not have, and it
does not stop at local minima or unstable gains.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

#: Significant digits of the gains: the printed gains are those that were driven.
DIGITS = 4
_WEIGHTS = (0.5, 1.0)  # range of a difference's weight, drawn in each generation
_CROSSOVER = 0.7  # probability that a gain changes
#: The search has converged when the costs in the population are this close together.
_TOLERANCE = 1e-4


class SearchResult(NamedTuple):
    """The best gains of a search."""

    gains: Floats  #: shape `(d,)`
    cost: float  #: infinite if no gains in the ranges arrive
    evaluations: int


def search(
    cost: Callable[[Floats], Floats],
    low: Floats,
    high: Floats,
    start: Floats,
    *,
    seed: int = 0,
    population: int = 24,
    generations: int = 40,
) -> SearchResult:
    """Return the gains of minimum cost; the same arguments give the same gains.

    Parameters
    ----------
    cost
        A function that returns the costs, shape `(n,)`, of gains, shape `(n, d)`.
    low, high
        The ends of the range of each gain, shape `(d,)`.
    start
        One of the first gains that are tried, moved into the ranges; shape `(d,)`.
    seed
        of the random numbers.
    population
        number of gains of a generation, at least 4.
    generations
        after which the search ends, unless it has converged before.

    Returns
    -------
    SearchResult
        The best gains, with `DIGITS` significant digits.
    """
    random = np.random.default_rng(seed)
    places = rounded(_spread(random, population, low, high))
    places[0] = np.clip(start, low, high)
    costs = cost(places)
    evaluations = population

    for _ in range(generations):
        if _has_converged(costs):
            break
        trials = rounded(np.clip(_trials(random, places, costs), low, high))
        trial_costs = cost(trials)
        evaluations += population
        is_better = trial_costs <= costs
        places[is_better] = trials[is_better]
        costs[is_better] = trial_costs[is_better]

    best = np.argmin(costs)
    return SearchResult(places[best], float(costs[best]), evaluations)


def rounded(gains: Floats) -> Floats:
    """Return `gains` with `DIGITS` significant digits."""
    return np.array([float(f'{gain:.{DIGITS}g}') for gain in gains.flat]).reshape(gains.shape)


def _spread(random: np.random.Generator, number: int, low: Floats, high: Floats) -> Floats:
    """Return a Latin hypercube: one point in each of `number` equal parts of every range."""
    parts = np.column_stack([random.permutation(number) for _ in low])
    return low + (parts + random.random(parts.shape)) / number * (high - low)


def _trials(random: np.random.Generator, places: Floats, costs: Floats) -> Floats:
    """Return a rival for each of `places`."""
    number, gains = places.shape
    low, high = _WEIGHTS
    weight = random.uniform(low, high)

    # Two other places for each, which differ from it and from one another.
    rows = np.arange(number)
    first = (rows + random.integers(1, number, number)) % number
    second = (first + random.integers(1, number - 1, number)) % number
    second = np.where(second == rows, (second + 1) % number, second)
    second = np.where(second == first, (second + 1) % number, second)
    mutants = places[np.argmin(costs)] + weight * (places[first] - places[second])

    crossed = random.random(places.shape) < _CROSSOVER
    crossed[rows, random.integers(0, gains, number)] = True  # at least one gain
    return np.where(crossed, mutants, places)


def _has_converged(costs: Floats) -> bool:
    """Return whether the costs of a population are close together."""
    minimum = costs.min()
    maximum = costs.max()
    return bool(np.isfinite(maximum)) and bool(maximum - minimum <= _TOLERANCE * abs(minimum))
