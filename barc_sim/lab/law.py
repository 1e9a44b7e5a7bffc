"""Reads the laws of a lab and the common mistakes in them; recognises a mistake by its numbers.

A mistake is a wrong program of a few lines. User code has the mistake if it gives the same numbers
for the same inputs.

The laws are text files such as `labs/bike.txt`. Formulas are Python expressions over NumPy arrays.
A short one; the notes after `<-` are not part of it::

    The speed of a car after a step.             <- a description, without ` = `
    RATE = a / m                                 <- a text: it replaces {RATE} below
        rate = {RATE}                            <- the right formulas are indented
        v_next = v + ts * rate

    # Inputs
    of all functions                             <- any line: each section needs one
        v = 0, 20                                <- an input, random between two numbers
        a = 1                                    <- an input that is always 1

    # Situations; step                           <- the test cases of the function `step`
    braking; v_next                              <- a name, and the results that it tests
        a = -8, -1                               <- the inputs that differ from `Inputs`

    # Signs; name in v; other in a m             <- a topic; its loops, none or several
    {name} falls: is {RATE} negative?            <- a mistake: the message to the user
        {name}_next = {name} - ts * rate         <- its wrong formulas

The arguments of `read_law` replace their names in braces, too. A section with loops is repeated
with each choice of their values, which must differ: above, with `v` in place of `{name}`, and `a`
or `m` in place of `{other}`. A topic that begins with `Absent` is for a result that is missing:
each costs all its points. All other mistakes cost no more than a wrong sign; see
`TrialJudge.scores` of `judge.py`.

`labs/lane_class.txt` has the same form with another meaning, because a whole class has no formulas
for its results. Its inputs are the measured angles. A mistake has two entries: `is_made`, a
condition on these angles, and `line`, the name of the situation whose line the message names.
`lane.py` reads them; `Law.explain` does not.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cache
from itertools import product
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
    from types import CodeType

    Formulas = Mapping[str, str]
    Inputs = Mapping[str, 'Floats']
    Case = tuple[Inputs, 'Floats']  # the inputs of a function, and one of its results
    Agree = Callable[['Floats', 'Floats'], bool]

Floats = NDArray[np.float64]
Range = tuple[float, float]  #: uniform between the two

_SAMPLE = 100  # calls on which each mistake is tried first
_FUNCTIONS = {**vars(np), 'atan': np.arctan}  #: that formulas can call


class Mistake(NamedTuple):
    """A mistake in user code: a common one of a law, or one without formulas."""

    topic: str  #: the section of the law; empty without formulas
    sentence: str  #: the message to the user
    formulas: Formulas  #: the wrong formulas, by quantity
    kind: str  #: the message before names are put in: the same for one mistake in several results


class LawSituation(NamedTuple):
    """A test case of a law: its inputs, and the results that they test."""

    name: str
    tests: Collection[str]
    values: Mapping[str, float | Range]  #: by input

    def inputs(self, seed: int | str, count: int) -> dict[str, Floats]:
        """Return `count` values of each input, the same for the same seed."""
        # A string seeds the generator alike in every version of Python.
        uniform = Random(f'{seed} {self.name}').uniform  # noqa: S311 (a simulation, not a secret)
        rows = []
        for _ in range(count):
            row = {
                name: uniform(*value) if isinstance(value, tuple) else value
                for name, value in self.values.items()
            }
            rows.append([*row.values()])
        return dict(zip(self.values, np.array(rows).T, strict=True))


@dataclass(frozen=True)
class Law:
    """The right formulas for a user's functions, the common mistakes, and the situations."""

    formulas: Formulas
    mistakes: tuple[Mistake, ...]  #: the likelier ones first
    situations: Mapping[str, tuple[LawSituation, ...]] = field(default_factory=dict)  #: by function
    functions: Mapping[str, Any] = field(default_factory=dict)  #: and arrays that formulas use

    def compute(self, inputs: Inputs, changes: Formulas | None = None) -> dict[str, Floats]:
        """Return the values of all quantities; `changes` replace formulas and inputs.

        Changed inputs come first, because formulas use them; then the formulas in the order of the
        file; then quantities that only the changes have. An input with the name of a formula stays
        as it is: so the value of a quantity can be given in place of its formula.
        """
        changes = changes or {}
        of_inputs = {name: formula for name, formula in changes.items() if name in inputs}
        of_formulas = {name: formula for name, formula in changes.items() if name not in inputs}

        names = {**_FUNCTIONS, **self.functions}
        values = dict(inputs)
        for name, formula in {**of_inputs, **self.formulas, **of_formulas}.items():
            if name in inputs and name in self.formulas:
                continue
            values[name] = np.asarray(eval(_compiled(formula), names, values), np.float64)  # noqa: S307 (ours)
        return values

    def changed(self, inputs: Inputs, mistake: Mistake, at: Sequence[int]) -> list[float]:
        """Return the wrong values of the scalar quantities that a mistake changes, at an index."""
        # That of the inputs: one number for each call. Arrays in a call, such as the speeds of a
        # lap, have more axes, and no line assigns them as a number.
        scalar_shape = np.broadcast_shapes(
            *(np.shape(values) for name, values in inputs.items() if name not in self.formulas)
        )
        index = tuple(at[: len(scalar_shape)])
        wrong = self.compute(inputs, mistake.formulas)
        right = self.compute(inputs)

        changed = []
        for name, values in right.items():
            if values.ndim > len(scalar_shape):
                continue
            wrong_value = float(np.broadcast_to(wrong[name], scalar_shape)[index])
            if wrong_value != float(np.broadcast_to(values, scalar_shape)[index]):
                changed.append(wrong_value)
        return changed

    def explain(
        self, cases: Mapping[str, Case], wrong: Iterable[str], agree: Agree
    ) -> dict[str, Mistake]:
        """Return the mistake that explains each wrong result; results without one are left out.

        `cases` has the inputs and outputs of the user's function, by result: right results, too. If
        several mistakes match, the one that explains most results is returned.

        All mistakes are tried on a sample of the calls, because that is fast. Only those that match
        are compared with all calls: where few calls are wrong, none of them may be in the sample.
        """

        def explains(mistake: Mistake, name: str, case: Case) -> bool:
            inputs, got = case
            values = self.compute(inputs, mistake.formulas)[name]
            return agree(got, np.broadcast_to(values, got.shape))

        samples = {name: _sample_of(case) for name, case in cases.items()}
        names_by_mistake = []
        for mistake in self.mistakes:
            names = [name for name in cases if explains(mistake, name, samples[name])]
            names_by_mistake.append((mistake, names))
        names_by_mistake.sort(key=lambda pair: -len(pair[1]))

        causes: dict[str, Mistake] = {}
        for mistake, names in names_by_mistake:
            for name in wrong:
                is_matched = name in names and name not in causes
                if is_matched and explains(mistake, name, cases[name]):
                    causes[name] = mistake
        return causes


def _sample_of(case: Case) -> Case:
    """Return at most about a hundred calls of a case."""
    inputs, got = case
    step = max(len(got) // _SAMPLE, 1)
    return {name: values[::step] for name, values in inputs.items()}, got[::step]


def read_law(name: str, functions: Mapping[str, Any] | None = None, **values: object) -> Law:
    """Return the law in a file of `labs`, which uses `functions` and arrays.

    Each `{NAME}` in it is replaced by the value of that name.
    """
    file = Path(__file__).parent / 'labs' / name
    parts = file.read_text(encoding='utf-8').split('\n# ')

    right: dict[str, str] = {}
    for line in parts[0].splitlines():
        quantity, equals, text = line.strip().partition(' = ')
        if equals:
            target: dict[str, Any] = right if line.startswith(' ') else values
            target[quantity] = text.format_map(values)

    mistakes: list[Mistake] = []
    inputs: dict[str, float | Range] = {}
    situations: dict[str, tuple[LawSituation, ...]] = {}
    for section in parts[1:]:
        title, _, text = section.partition('\n')
        topic, _, rest = title.partition('; ')
        if topic == 'Inputs':
            inputs = _ranges(next(_entries(text, values)).formulas)
        elif topic == 'Situations':
            situations[rest] = tuple(_situations(text, values, inputs))
        else:
            mistakes += _mistakes(topic, rest.split('; ') if rest else [], text, values)
    return Law(right, tuple(mistakes), situations, functions or {})


def _situations(
    text: str, values: Mapping[str, object], inputs: Mapping[str, float | Range]
) -> Iterator[LawSituation]:
    """Yield the situations of a section."""
    for entry in _entries(text, values):
        name, _, tests = entry.sentence.partition('; ')
        yield LawSituation(name, tests.split(), {**inputs, **_ranges(entry.formulas)})


def _mistakes(
    topic: str, loops: Sequence[str], text: str, values: Mapping[str, object]
) -> Iterator[Mistake]:
    """Yield the mistakes of a section, once for each choice of different values of its loops."""
    for choice in product(*map(_choices, loops)):
        names = dict(choice)
        if len({*names.values()}) == len(loops):
            for entry in _entries(text, {**values, **names}):
                yield entry._replace(topic=topic)


def _choices(loop: str) -> list[tuple[str, str]]:
    """Return the name and each value of a loop."""
    name, _, values = loop.partition(' in ')
    return [(name, value) for value in values.split()]


def _entries(text: str, values: Mapping[str, object]) -> Iterator[Mistake]:
    """Yield the entries of a section as mistakes without a topic."""
    for entry in re.split(r'\n(?! )', text.strip()):
        lines = entry.splitlines()
        kind = lines[0]
        wrong = {}
        for line in lines[1:]:
            name, _, formula = line.strip().format_map(values).partition(' = ')
            wrong[name] = formula
        yield Mistake('', kind.format_map(values), wrong, kind)


def _ranges(formulas: Formulas) -> dict[str, float | Range]:
    return {name: eval(text, dict(_FUNCTIONS)) for name, text in formulas.items()}  # noqa: S307 (ours)


@cache
def _compiled(formula: str) -> CodeType:
    return compile(formula, formula, 'eval')
