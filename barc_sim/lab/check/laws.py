"""A law as formulas, and the mistakes in it: wrong formulas, each with its sentence.

A lab has its laws in text files such as `hills/bike.txt`. After a description come texts in
capitals, then the right formulas, indented. Each section has a topic, and mistakes: a line for the
sentence, then the wrong formulas, indented. `name in x y` after a topic repeats its section with
each of these values for `{name}`; texts are put in in the same way. Formulas are Python over arrays
of NumPy.

A mistake is thus a wrong program of a few lines. It is named if it gives the same numbers as the
user's code, for the same inputs.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cache
from itertools import combinations, product
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path
    from types import CodeType

    Formulas = Mapping[str, str]
    Inputs = Mapping[str, Any]  # arrays by name, or numbers
    Agree = Callable[['Floats', 'Floats'], bool]

Floats = NDArray[np.float64]
Range = tuple[float, float]  #: uniform between the two

_NUMPY = ('abs', 'arctan2', 'clip', 'cos', 'degrees', 'maximum', 'radians', 'sign', 'sin', 'tan')
_FUNCTIONS = {'atan': np.arctan, **{name: getattr(np, name) for name in _NUMPY}}
_SAMPLE = 100  #: inputs with which pairs of mistakes are tried first


class Mistake(NamedTuple):
    """A mistake in a law: a common one, two at once, or one that has no formulas."""

    topic: str  #: of one common mistake
    sentence: str  #: what to check, as the user reads it
    formulas: Formulas  #: the wrong ones, by quantity
    kind: str  #: the sentence as the file has it: one mistake, made in several results

    @property
    def is_general(self) -> bool:
        """Whether it is any mistake in a quantity, whose value follows from what was returned."""
        return any('_got' in formula for formula in self.formulas.values())


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
    #: By result, changes to the formulas that are right, too.
    alternatives: Mapping[str, tuple[Formulas, ...]] = field(default_factory=dict)
    functions: Mapping[str, Callable[..., Any]] = field(default_factory=dict)  #: of the formulas

    def compute(self, inputs: Inputs, changes: Formulas | None = None) -> Quantities:
        """Return all quantities; `changes` replace formulas, and inputs before they are used."""
        return Quantities(inputs, {**self.formulas, **(changes or {})}, self.functions)

    def changed(self, inputs: Inputs, mistake: Mistake, at: Sequence[int]) -> list[float]:
        """Return the values that a mistake changes, at an index of the inputs."""
        shape = np.broadcast_shapes(*(np.shape(values) for values in inputs.values()))
        values = [
            [float(np.broadcast_to(made[name], shape)[tuple(at)]) for made in each]
            for each in [(self.compute(inputs, mistake.formulas), self.compute(inputs))]
            for name in {**self.formulas, **mistake.formulas}
        ]
        return [wrong for wrong, right in values if wrong != right]

    def right(self, inputs: Inputs, name: str, mistakes: Formulas | None = None) -> list[Floats]:
        """Return the values of the result `name` by each right form of it, with `mistakes`."""
        mistakes = mistakes or {}
        values: list[Floats] = []
        for form in self.alternatives.get(name, ({},)):
            made = self.compute(inputs, {**form, **mistakes})
            values.append(made[name])
            if not made.keys() & (form.keys() - mistakes.keys()):
                break  # the other forms give the same
        return values

    @np.errstate(all='ignore')
    def explain(
        self, inputs: Inputs, results: Mapping[str, Floats], wrong: Iterable[str], agree: Agree
    ) -> dict[str, Mistake]:
        """Return the mistake in each wrong result that one of them, or two, explain.

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

        def explains(name: str, mistakes: Formulas, part: slice = slice(None)) -> bool:
            got = results[name][part]
            return any(
                agree(got, np.broadcast_to(values, got.shape))
                for values in self.right(_sliced(inputs, part), name, mistakes)
            )

        explained = [
            (mistake, {name for name in results if explains(name, mistake.formulas)})
            for mistake in self.mistakes
        ]
        found: dict[str, Mistake] = {}
        # The mistake that explains the most results, right ones included, comes first.
        for mistake, names in sorted(explained, key=lambda m: (m[0].is_general, -len(m[1]))):
            new = [name for name in wrong if name in names and name not in found]
            if new[1:] or not mistake.is_general:
                found |= dict.fromkeys(new, mistake)
        for name in (name for name in wrong if name not in found):
            few = slice(None, None, max(len(results[name]) // _SAMPLE, 1))
            for first, second in self._pairs(_sliced(inputs, few), name, agree):
                both = {**first.formulas, **second.formulas}
                if explains(name, both, few) and explains(name, both):
                    text = f'two mistakes: {first.sentence}; and {second.sentence}'
                    found[name] = Mistake('', text, both, f'{first.kind}; {second.kind}')
                    break
        return found

    def _pairs(self, inputs: Inputs, name: str, agree: Agree) -> Iterator[tuple[Mistake, Mistake]]:
        """Yield pairs of mistakes that each change the result `name`, in different formulas."""
        right = self.compute(inputs)[name]
        changed = [self.compute(inputs, each.formulas)[name] for each in self.mistakes]
        changing = [
            each
            for each, values in zip(self.mistakes, changed, strict=True)
            if not agree(np.broadcast_to(values, right.shape), right)
        ]
        for first, second in combinations(changing, 2):
            if not first.formulas.keys() & second.formulas.keys():
                yield first, second


def _sliced(inputs: Inputs, part: slice) -> Inputs:
    return {name: values[part] if np.ndim(values) else values for name, values in inputs.items()}


def read(file: Path, **values: object) -> tuple[Formulas, tuple[Mistake, ...]]:
    """Return the right formulas and the mistakes of a law's file, with `values` put in."""
    head, *sections = file.read_text(encoding='utf-8').split('\n# ')
    right: dict[str, str] = {}
    mistakes: list[Mistake] = []
    for line in head.splitlines():
        name, equals, text = line.strip().partition(' = ')
        if equals:
            target: dict[str, Any] = right if line.startswith(' ') else values
            target[name] = text.format_map(values)
    for section in sections:
        title, _, text = section.partition('\n')
        topic, *loops = title.split('; ')
        for chosen in product(*map(_choices, loops)):
            if len({value for _, value in chosen}) == len(loops):
                mistakes += _mistakes(topic, text, {**values, **dict(chosen)})
    return right, tuple(mistakes)


def _choices(loop: str) -> list[tuple[str, str]]:
    """Return the name and each value of a loop: words, or whole numbers such as `2..59`."""
    name, _, text = loop.partition(' in ')
    first, dots, last = text.partition('..')
    values = map(str, range(int(first), int(last) + 1)) if dots else text.split()
    return [(name, value) for value in values]


def _mistakes(topic: str, text: str, values: Mapping[str, object]) -> Iterator[Mistake]:
    """Yield the mistakes of a section, with `values` put in."""
    for entry in re.split(r'\n(?! )', text.strip()):
        kind, *lines = entry.splitlines()
        formulas = (line.strip().format_map(values).partition(' = ') for line in lines)
        wrong = {name: formula for name, _, formula in formulas}
        yield Mistake(topic, kind.format_map(values), wrong, kind)


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
