"""One mistake more never gives more points: pairs of the mistakes of all labs.

A pair is left out where the second mistake cancels a part of the first one: where a result of the
two comes closer to the right one than with the first alone.
"""

from __future__ import annotations

from functools import cache
from itertools import permutations
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import test_wrong_estimates as estimates
import test_wrong_lanes as lanes
import test_wrong_lines as lines
import test_wrong_programs as programs
from user_files import IDENTIFY, LANE, PLAIN_CONTROLLER, RACELINE, LocalCode, Program

from barc_sim.lab.files import CALLED
from barc_sim.lab.grade.grade import load_rubric
from barc_sim.lab.labs import hills, identify, lane, raceline
from barc_sim.lab.user_code.code import UserCode

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from barc_sim.lab.judge import Functions
    from barc_sim.lab.law import Floats, Mistake

ROUNDING = 0.02  #: points
FUNCTIONS = {
    'lab': hills.FUNCTIONS,
    'lane': lane.FUNCTIONS,
    'raceline': raceline.FUNCTIONS,
    'identify': identify.FUNCTIONS,
}
SEED = 131


class MadeCode(LocalCode):
    """A user's functions that compute what a law gives with some formulas replaced."""

    def __init__(self, functions: Functions, formulas: Mapping[str, str]) -> None:
        super().__init__(None)
        self._functions, self._formulas = functions, formulas
        (first, *_) = functions.law.situations.values()
        self._usual = first[0].inputs(SEED, 1)

    def rows(self, name: str, rows: Sequence[Sequence[Any]], corrected: object = None) -> list[Any]:
        """Return the numbers of a function for rows of arguments."""
        law = self._functions.law
        inputs: dict[str, Floats] = {
            key: np.repeat(value, len(rows)) for key, value in self._usual.items()
        }
        columns = [np.array(each, np.float64) for each in zip(*rows, strict=True)]
        inputs |= dict(zip((CALLED[name].takes or '').split(), columns, strict=True))
        changes = dict(self._formulas)
        if corrected:
            called, _, results = corrected  # type: ignore[misc]  # a tuple, see `RightResults`
            inputs[called] = np.array(results)  # type: ignore[has-type]
        values = law.compute(inputs, changes)
        results = [values.get(each, np.array(1e-9)) for each in self._functions.results[name]]
        shape = (len(rows), CALLED[name].numbers)
        stacked = results[0] if len(results) == 1 else np.stack(np.broadcast_arrays(*results), -1)
        return np.broadcast_to(stacked, shape).tolist()

    def line_of(self, *_: object) -> str:
        """Return nothing: there are no lines."""
        return ''


def points_with(rubric: str, formulas: Mapping[str, str]) -> float:
    """Return the points of the functions of a lab with these mistakes."""
    loaded = load_rubric(rubric)
    findings, _ = FUNCTIONS[rubric].judge(
        MadeCode(FUNCTIONS[rubric], formulas), SEED, loaded.points
    )
    return sum(map(loaded.points_for, findings))


@np.errstate(all='ignore')
def errors_with(functions: Functions, formulas: Mapping[str, str]) -> Floats:
    """Return the size of the error of each judged result in each situation."""
    errors = []
    for name, situations in functions.law.situations.items():
        for each in situations:
            inputs = each.inputs(SEED, 40)
            right, wrong_results = (
                functions.law.compute(inputs),
                functions.law.compute(inputs, formulas),
            )
            for result in functions.results[name]:
                if result in functions.criteria:
                    error = (
                        np.broadcast_to(wrong_results[result], right[result].shape) - right[result]
                    )
                    errors.append(float(np.sqrt(np.mean(error**2))))
    return np.array(errors)


def drawn_pairs(rubric: str, count: int, seed: int) -> list[tuple[Mistake, Mistake]]:
    """Return pairs of mistakes of a lab's law that replace different formulas."""
    mistakes = FUNCTIONS[rubric].law.mistakes
    pairs = [
        (a, b) for a, b in permutations(mistakes, 2) if not a.formulas.keys() & b.formulas.keys()
    ]
    draw = Random(f'{rubric} {seed}')  # noqa: S311 (a test)
    return draw.sample(pairs, min(count, len(pairs)))


def rises(rubric: str, count: int, seed: int) -> Iterator[str]:
    """Yield a sentence for each drawn pair that gets more points than its first mistake alone."""
    functions, points = FUNCTIONS[rubric], {}
    for a, b in drawn_pairs(rubric, count, seed):
        formulas_of_both = {**a.formulas, **b.formulas}
        alone, with_second = (
            errors_with(functions, a.formulas),
            errors_with(functions, formulas_of_both),
        )
        if not np.all(with_second >= alone * (1.0 - 1e-9)):
            continue
        for formulas in (a.formulas, formulas_of_both):
            key = str(formulas)
            points[key] = points.get(key) or points_with(rubric, formulas)
        if points[str(formulas_of_both)] > points[str(a.formulas)] + ROUNDING:
            yield (
                f'{points[str(a.formulas)]:.2f} → {points[str(formulas_of_both)]:.2f}: '
                f'{a.sentence} + {b.sentence}'
            )


@pytest.mark.parametrize('rubric', FUNCTIONS)
def test_a_second_wrong_formula_gives_no_points(rubric: str) -> None:
    assert [*rises(rubric, 6, seed=1)] == []


@pytest.mark.slow
@pytest.mark.parametrize('rubric', FUNCTIONS)
def test_no_second_wrong_formula_gives_points(rubric: str) -> None:
    assert [*rises(rubric, 500, seed=2)] == []


def test_the_same_mistake_in_one_more_result_gives_no_points() -> None:
    of_one_mistake = points_with('lab', {'v_ts': '1'})
    assert points_with('lab', {'v_ts': '1', 'x_ts': '1'}) <= of_one_mistake < 50.0


#: By lab: the right text, the table of its wrong programs, and what their texts stand for.
TABLES: dict[str, tuple[str, dict[str, Program], dict[str, str]]] = {
    'lab': (PLAIN_CONTROLLER, programs.PROGRAMS, {}),
    'lane': (LANE, lanes.PROGRAMS, lanes.TEXTS),
    'raceline': (RACELINE, lines.PROGRAMS, {}),
    'identify': (IDENTIFY, estimates.PROGRAMS, {}),
}


def text_with(rubric: str, *names: str) -> str:
    """Return the program with these mistakes of a table; empty if they exclude each other.

    They do where a mistake replaces what another one has replaced or inserted.
    """
    right, table, long = TABLES[rubric]
    text = right
    for old, new in (pair for name in names for pair in table[name].changes):
        is_elsewhere = text.count(old) > right.count(old) > 0
        if old not in text or is_elsewhere:
            return ''
        text = text.replace(old, new)
    for short, replacement in long.items():
        text = text.replace(short, replacement)
    return text


@cache
def points_of_text(rubric: str, text: str) -> float:
    """Return the points of a file."""
    loaded = load_rubric(rubric)
    part, name = [*loaded.lab.handout.files.items()][rubric == 'lab']
    with TemporaryDirectory() as folder:
        path = Path(folder, name)
        path.write_text(text, encoding='utf-8')
        code = LocalCode(UserCode({part: path}, is_judged=True))
        findings = loaded.lab.judge(code, loaded.settings)
    return sum(loaded.points_for(each) for each in findings if each.criterion in loaded.points)


def rises_of_texts(rubric: str, pairs: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Yield a sentence for each pair of programs that has more points than one of the two."""
    for a, b in pairs:
        if text_with_both := text_with(rubric, a, b):
            alone, with_second = (
                points_of_text(rubric, t) for t in (text_with(rubric, a), text_with_both)
            )
            if with_second > alone + ROUNDING:
                yield f'{alone:.2f} → {with_second:.2f}: {a} + {b}'


#: Points of a program that stops at once, or does nothing: it is no second mistake.
STOPPED = {'lab': 50.0, 'lane': 35.0, 'raceline': 0.0, 'identify': 0.0}
#: They replace the whole law, and with it the first mistake.
OTHER_LAWS = {'pure pursuit', 'Stanley', 'a PID on e_y'}
#: The second change takes the first mistake away, or mends a part of it.
MENDS = {
    ('no gains chosen', 'own gains'): 'the numbers in PID are chosen gains, with which it drives',
    ('a value that is None at first', 'the sum differentiated'): 'the wrong expression never runs',
    ('an attribute that is not made', 'I without a sum'): 'the attribute is set before it is used',
    ('the other side', 'the centre line'): 'offsets of 0 are on no side',
    ('a mean speed', 'no root'): 'all speeds are equal: their mean changes none of them',
    ('no friction', 'drag that grows with v'): 'the estimated delay comes closer to the true one',
}


def pairs_of(rubric: str) -> list[tuple[str, str]]:
    """Return the pairs of mistakes of a table that both can be made; each costs points alone."""
    right, table, _ = TABLES[rubric]
    maximum = table['right'].points
    names = [
        name
        for name, each in table.items()
        if each.changes and each.changes[0][0] in right and each.points < maximum
    ]
    if rubric == 'lane':  # a mistake in the functions alone does not change the drives
        head = len(right.partition('class ')[0])
        names = [name for name in names if right.find(table[name].changes[0][0]) >= head]
    return [
        (a, b)
        for a, b in permutations(names, 2)
        if table[b].points > STOPPED[rubric] and b not in OTHER_LAWS and text_with(rubric, a, b)
    ]


def drawn_pairs_of(rubric: str, count: int) -> list[tuple[str, str]]:
    pairs = [pair for pair in pairs_of(rubric) if pair not in MENDS]
    assert len(pairs) > count
    return Random(f'{rubric} texts').sample(pairs, count)  # noqa: S311 (a test)


@pytest.mark.parametrize(
    ('rubric', 'count'), [('lab', 12), ('lane', 2), ('raceline', 1), ('identify', 1)]
)
def test_a_second_mistake_in_a_program_gives_no_points(rubric: str, count: int) -> None:
    assert [*rises_of_texts(rubric, drawn_pairs_of(rubric, count))] == []


@pytest.mark.slow
@pytest.mark.parametrize('rubric', TABLES)
def test_no_second_mistake_in_a_program_gives_points(rubric: str) -> None:
    pairs = pairs_of(rubric)
    Random(7).shuffle(pairs)  # noqa: S311 (a test)
    judged = [pair for pair in pairs[:60] if pair not in MENDS]
    assert [*rises_of_texts(rubric, judged)] == []


@pytest.mark.parametrize(
    ('rubric', 'first', 'second'),
    [
        ('lab', 'a limit of 2', 'I with the wrong sign'),
        ('lab', 'it swings', 'I without a sum'),
        ('lab', 'a weak kp', 'own gains'),
        ('lane', 'no feedforward', "e_y's sign in Lane"),
        ('lane', 'a late curvature', "e_psi's sign in Lane"),
        # A D that is always 0 has no points, and no more as a multiple of the error.
        ('lab', 'D after the error is stored', 'the sum differentiated'),
        ('lab', 'D after the error is stored', 'D adds'),
        # The smaller error of swapped intervals was taken, though nothing was swapped.
        ('identify', 'no friction', 'intervals ten times as wide'),
        # Wide intervals around wrong estimates had points, because they contain the true values.
        ('identify', 'the delay ignored', 'intervals ten times as wide'),
        ('identify', 'the delay ignored', 'milliseconds'),
        ('identify', 'a guess', 'drag that grows with v'),
        # A result of 1 % of the right one had 1 % of the points.
        ('identify', 'no friction', 'swapped'),
    ],
)
def test_a_second_mistake_with_another_cause_gains_no_points(
    rubric: str, first: str, second: str
) -> None:
    assert [*rises_of_texts(rubric, [(first, second)])] == []
