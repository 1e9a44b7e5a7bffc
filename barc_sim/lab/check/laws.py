"""A law as formulas, and the mistakes in it: wrong formulas, each with its sentence.

A lab gives its right law, a formula for each quantity, a table of mistakes, and situations in which
the user's code is called. A mistake replaces some formulas: a wrong program of a few lines. It is
named if it gives the same numbers as the user's code, for the same inputs. Formulas are in Python,
over arrays of NumPy.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from itertools import combinations
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from types import CodeType

    Formulas = Mapping[str, str]
    Inputs = Mapping[str, Any]  # arrays by name, or numbers
    Agree = Callable[['Floats', 'Floats'], bool]

Floats = NDArray[np.float64]
Range = tuple[float, float]  #: uniform between the two

_FUNCTIONS = {
    'atan': np.arctan,
    **{name: getattr(np, name) for name in ('abs', 'clip', 'cos', 'maximum', 'sign', 'sin', 'tan')},
    **{name: getattr(np, name) for name in ('degrees', 'radians')},
}


class Mistake(NamedTuple):
    """A common mistake in a law."""

    sentence: str  #: what to check, as the user reads it
    formulas: dict[str, str]  #: the wrong ones, by quantity


def read(table: str) -> tuple[Mistake, ...]:
    """Return the mistakes of a table: a line for the sentence, then wrong formulas, indented."""
    mistakes: list[Mistake] = []
    for line in filter(None, table.splitlines()):
        if line.startswith(' '):
            name, _, formula = line.strip().partition(' = ')
            mistakes[-1].formulas[name] = formula
        else:
            mistakes.append(Mistake(line, {}))
    return tuple(mistakes)


class Situation(NamedTuple):
    """Inputs of a law, drawn from ranges, and the results that they test."""

    name: str
    concerns: str  #: as in `'x y v'`
    ranges: Mapping[str, Range]  #: of each input
    fixed: Mapping[str, float]  #: further inputs

    def rows(self, seed: int, count: int) -> list[list[float]]:
        """Return `count` rows of inputs, the same for the same seed."""
        # A string seeds the generator alike in every version of Python.
        uniform = Random(f'{seed} {self.name}').uniform  # noqa: S311 (a simulation, not a secret)
        return [[uniform(*each) for each in self.ranges.values()] for _ in range(count)]


@dataclass(frozen=True)
class Law:
    """The right formulas of what a user's function computes, and the wrong ones."""

    formulas: Formulas
    mistakes: tuple[Mistake, ...]  #: the likelier ones first
    alternatives: tuple[Formulas, ...] = ({},)  #: equally right formulas
    functions: Mapping[str, Callable[..., Any]] = field(default_factory=dict)  #: of the formulas

    def compute(self, inputs: Inputs, changes: Formulas | None = None) -> Quantities:
        """Return all quantities; `changes` replace formulas, and inputs before they are used."""
        return Quantities(inputs, {**self.formulas, **(changes or {})}, self.functions)

    def right(self, inputs: Inputs, name: str) -> list[Floats]:
        """Return the right values of the quantity `name`, by each alternative."""
        return [self.compute(inputs, each)[name] for each in self.alternatives]

    @np.errstate(all='ignore')
    def explain(
        self,
        inputs: Inputs,
        results: Mapping[str, Floats],
        wrong: Iterable[str],
        agree: Agree,
    ) -> dict[str, str]:
        """Return a sentence for each wrong result that one mistake, or two, explain.

        Parameters
        ----------
        inputs
            What the user's function got.
        results
            What it returned, by quantity; right ones, too.
        wrong
            The names of the wrong ones.
        agree
            Whether two arrays are the same numbers.
        """

        def explains(name: str, changes: Formulas) -> bool:
            return any(
                agree(results[name], self.compute(inputs, {**each, **changes})[name])
                for each in self.alternatives
            )

        explained = [
            (mistake.sentence, {name for name in results if explains(name, mistake.formulas)})
            for mistake in self.mistakes
        ]
        found: dict[str, str] = {}
        # The mistake that explains the most results, right ones included, comes first.
        for sentence, names in sorted(explained, key=lambda item: -len(item[1])):
            found |= {name: sentence for name in wrong if name in names and name not in found}
        for name in (name for name in wrong if name not in found):
            for first, second in combinations(self._that_change(name, inputs, agree), 2):
                distinct = not first.formulas.keys() & second.formulas.keys()
                if distinct and explains(name, first.formulas | second.formulas):
                    found[name] = f'two mistakes: {first.sentence}; and {second.sentence}'
                    break
        return found

    def _that_change(self, name: str, inputs: Inputs, agree: Agree) -> list[Mistake]:
        right = self.compute(inputs)[name]
        changed = [self.compute(inputs, each.formulas)[name] for each in self.mistakes]
        return [
            each
            for each, values in zip(self.mistakes, changed, strict=True)
            if not agree(np.broadcast_to(values, right.shape), right)
        ]


class Quantities(dict[str, Any]):
    """The quantities of a law by name; each is computed when it is first used."""

    def __init__(self, inputs: Inputs, formulas: Formulas, functions: Mapping[str, Any]) -> None:
        """Compute from `inputs`; formulas of their names get the inputs as they are."""
        super().__init__(inputs)
        self._formulas = formulas
        self._functions = {**_FUNCTIONS, **functions}
        for name in inputs.keys() & formulas.keys():
            self[name] = self._computed(name, inputs)

    def __missing__(self, name: str) -> Floats:
        """Compute the quantity called `name`."""
        self[name] = self._computed(name, self)
        value: Floats = self[name]
        return value

    def _computed(self, name: str, values: Inputs) -> Floats:
        value = eval(_compiled(self._formulas[name]), self._functions, values)  # noqa: S307 (ours)
        return np.asarray(value, dtype=np.float64)


@cache
def _compiled(formula: str) -> CodeType:
    return compile(formula, formula, 'eval')
