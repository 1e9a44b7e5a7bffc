"""Finds the mistake, or the two mistakes, that explain a model's wrong results exactly."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.lab.check.equations import NAMES, Quantities
from barc_sim.lab.check.mistakes import MISTAKES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from barc_sim.lab.check.equations import Floats, Mistake

#: Relative to max(|expected|, 1): far above rounding errors, far below any mistake.
TOLERANCE = 1e-9


def close(got: Floats, expected: Floats) -> Floats:
    """Return where `got` equals `expected`, to rounding; False where it is not finite."""
    with np.errstate(invalid='ignore', over='ignore'):
        near = np.abs(got - expected) <= TOLERANCE * np.maximum(1.0, np.abs(expected))
    return np.asarray(near & np.isfinite(got), dtype=np.bool_)


def causes(
    given: Mapping[str, Floats], results: Mapping[str, Floats], wrong: Sequence[str]
) -> dict[str, str]:
    """Return a hint for each equation of `wrong` that a known mistake explains.

    Parameters
    ----------
    given
        The arguments, see `equations.arguments`.
    results
        What the user's function returned, by equation; shape `(n,)` each.
    wrong
        The wrong equations.
    """
    with np.errstate(all='ignore'):
        return _Search(given, results).causes(wrong)


class _Search:
    def __init__(self, given: Mapping[str, Floats], results: Mapping[str, Floats]) -> None:
        self._given = given
        self._results = results
        self._right = Quantities(given, {})

    def causes(self, wrong: Sequence[str]) -> dict[str, str]:
        found = {name: text for name in wrong if (text := self._order(name))}
        left = [name for name in wrong if name not in found]
        # The mistake that explains the most equations, right ones included, comes first.
        explained = sorted(
            ((mistake.hint, self._explains(mistake)) for mistake in MISTAKES),
            key=lambda item: -len(item[1]),
        )
        for hint, names in explained:
            for name in names.intersection(left):
                found.setdefault(name, hint)
        for name in left:
            if name not in found and (pair := self._pair(name)):
                found[name] = f'two mistakes: {pair[0].hint}; and {pair[1].hint}'
        return found

    def _order(self, name: str) -> str | None:
        """Return a hint if another quantity is returned in this one's place."""
        for other in NAMES:
            if other != name and self._is(name, self._right[f'{other}_next']):
                return (
                    f'{other}_next is returned in place of {name}_next: the order is '
                    '[x_next, y_next, psi_next, v_next]'
                )
        return None

    def _is(self, name: str, values: Floats) -> bool:
        return bool(close(self._results[name], values).all())

    def _explains(self, mistake: Mistake) -> set[str]:
        """Return the equations whose results this mistake would give."""
        mistaken = Quantities(self._given, mistake.changes)
        return {name for name in NAMES if self._is(name, mistaken[f'{name}_next'])}

    def _pair(self, name: str) -> tuple[Mistake, Mistake] | None:
        right = self._right[f'{name}_next']
        relevant = [
            mistake
            for mistake in MISTAKES
            if not close(Quantities(self._given, mistake.changes)[f'{name}_next'], right).all()
        ]
        for first, second in combinations(relevant, 2):
            if first.changes.keys().isdisjoint(second.changes):
                both = {**first.changes, **second.changes}
                if self._is(name, Quantities(self._given, both)[f'{name}_next']):
                    return first, second
        return None
