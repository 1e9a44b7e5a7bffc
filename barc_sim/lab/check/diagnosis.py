"""Why a model's answers are wrong: the mistake, or the two, that explain them exactly."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.lab.check.equations import NAMES, Quantities
from barc_sim.lab.check.mistakes import MISTAKES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from barc_sim.lab.check.equations import Floats
    from barc_sim.lab.check.mistake import Mistake

#: Of |expected|, or of 1 where that is less: far above rounding, far below any mistake.
TOLERANCE = 1e-9


def close(got: Floats, expected: Floats) -> Floats:
    """Return where `got` is as expected; nowhere that it is not finite."""
    with np.errstate(invalid='ignore', over='ignore'):
        near = np.abs(got - expected) <= TOLERANCE * np.maximum(1.0, np.abs(expected))
    return np.asarray(near & np.isfinite(got), dtype=np.bool_)


def causes(
    given: Mapping[str, Floats], answers: Mapping[str, Floats], wrong: Sequence[str]
) -> dict[str, str]:
    """Return by equation of `wrong` what to look at; an equation that nothing explains is left out.

    Parameters
    ----------
    given
        The arguments, see `equations.arguments`.
    answers
        What the user's function returned, by equation; shape `(n,)` each.
    wrong
        The equations for which a cause is looked for.
    """
    with np.errstate(all='ignore'):
        return _Search(given, answers).causes(wrong)


class _Search:
    def __init__(self, given: Mapping[str, Floats], answers: Mapping[str, Floats]) -> None:
        self._given = given
        self._answers = answers
        self._right = Quantities(given)

    def causes(self, wrong: Sequence[str]) -> dict[str, str]:
        found = {name: text for name in wrong if (text := self._order(name))}
        left = [name for name in wrong if name not in found]
        # What accounts for the most equations, the right ones too, is what happened.
        accounts = sorted(
            ((mistake.says, self._accounts_for(mistake)) for mistake in MISTAKES),
            key=lambda account: -len(account[1]),
        )
        for says, names in accounts:
            for name in names.intersection(left):
                found.setdefault(name, says)
        for name in left:
            if name not in found and (pair := self._pair(name)):
                found[name] = f'two things at once: {pair[0].says}; and {pair[1].says}'
        return found

    def _order(self, name: str) -> str | None:
        """Return what to say of another quantity in this one's place."""
        for other in NAMES:
            if other != name and self._is(name, self._right[f'{other}_next']):
                return (
                    f'{other}_next is returned where {name}_next belongs: the order is '
                    '[x_next, y_next, psi_next, v_next]'
                )
        return None

    def _is(self, name: str, values: Floats) -> bool:
        return bool(close(self._answers[name], values).all())

    def _accounts_for(self, mistake: Mistake) -> set[str]:
        """Return the equations whose answers are what they would be with this mistake."""
        made = Quantities(self._given, mistake.changes)
        return {name for name in NAMES if self._is(name, made[f'{name}_next'])}

    def _pair(self, name: str) -> tuple[Mistake, Mistake] | None:
        right = self._right[f'{name}_next']
        telling = [
            mistake
            for mistake in MISTAKES
            if not close(Quantities(self._given, mistake.changes)[f'{name}_next'], right).all()
        ]
        for first, second in combinations(telling, 2):
            if first.changes.keys().isdisjoint(second.changes):
                both = {**first.changes, **second.changes}
                if self._is(name, Quantities(self._given, both)[f'{name}_next']):
                    return first, second
        return None
