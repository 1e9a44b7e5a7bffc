"""Judges each of the model's equations in seeded states, and finds the mistakes in them."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.lab.check.equations import NAMES, Quantities, arguments
from barc_sim.lab.check.findings import Finding, judges
from barc_sim.lab.check.mistakes import MISTAKES
from barc_sim.lab.check.results import (
    Results,
    call_text,
    close,
    find_randomness,
    run_general,
    run_situations,
)
from barc_sim.lab.check.situations import REVERSE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from barc_sim.lab.check.code import JudgedCode
    from barc_sim.lab.check.equations import Floats, Mistake
    from barc_sim.lab.check.findings import Judged


@np.errstate(all='ignore')
def judge_equations(code: JudgedCode, seed: int) -> list[Finding]:
    """Return a finding for each of the four equations, in states of the lab's road.

    An equation's score is a product. The first factor is the share of states in which it is right,
    as a mean over the situations that test it. The second is the same share over all other
    situations.
    """
    results = run_situations(code, seed)
    random = find_randomness(code, results)
    scores = {name: _score(results, name) for name in NAMES}
    wrong = [name for name in NAMES if scores[name] < 1.0]
    finite = [part for part in results if not part.failure]
    found = {} if random or not finite else _causes(finite, wrong)
    findings = []
    for name in NAMES:
        if name not in wrong and not random:
            message = _right(results)
        else:
            message = random or _message(results, name, found.get(name))
        score = 0.0 if random else scores[name]
        findings.append(
            Finding(f'model.{name}', score, message, {'shares': _shares(results, name)})
        )
    return findings


@judges('model.reverse')
def judge_reverse(code: JudgedCode, seed: int) -> Judged:
    """Return the finding on all equations together, at negative speeds."""
    return _judge_beyond(code, seed, run_situations(code, seed, REVERSE))


@judges('model.general')
def judge_general(code: JudgedCode, seed: int) -> Judged:
    """Return the finding on all equations together, with another car."""
    return _judge_beyond(code, seed, run_general(code, seed))


def _judge_beyond(code: JudgedCode, seed: int, results: list[Results]) -> Judged:
    """Judge the results in states that the lab's road has not."""
    shares = [part.right(column) for part in results for column in range(len(NAMES))]
    score = float(np.mean([np.mean(share) for share in shares]))
    if score == 1.0:
        return 1.0, _right(results)
    wrong = [name for name in NAMES if _score(results, name) < 1.0]
    # A cause must explain the results on the lab's road, too.
    finite = [part for part in (*run_situations(code, seed), *results) if not part.failure]
    found = _causes(finite, wrong) if finite else {}
    return score, _message(results, wrong[0], found.get(wrong[0]))


def _right(results: Sequence[Results]) -> str:
    return f'right in all {sum(len(part.rows) for part in results):,} states'


def _score(results: Sequence[Results], name: str) -> float:
    column = NAMES.index(name)
    tested: list[float] = []
    other: list[float] = []
    for part in results:
        share = float(np.mean(part.right(column)))
        (tested if name in part.situation.concerns.split() else other).append(share)
    return float(np.mean(tested or [1.0]) * np.mean(other or [1.0]))


def _shares(results: Sequence[Results], name: str) -> dict[str, float]:
    column = NAMES.index(name)
    return {part.situation.name: float(np.mean(part.right(column))) for part in results}


def _causes(results: Sequence[Results], wrong: Sequence[str]) -> dict[str, str]:
    given = arguments(
        [row for part in results for row in part.rows],
        [part.l_f for part in results for _ in part.rows],
        [part.l_r for part in results for _ in part.rows],
    )
    got = np.concatenate([part.got for part in results])
    return causes(given, dict(zip(NAMES, got.T, strict=True)), wrong)


def _message(results: Sequence[Results], name: str, cause: str | None) -> str:
    failed = [part for part in results if part.failure]
    if failed:
        where = '' if len(failed) == len(results) else f' ({failed[0].situation.name})'
        return f'{failed[0].failure}{where}'
    if cause:
        return cause
    column = NAMES.index(name)
    bad = [part.situation.name for part in results if not part.right(column).all()]
    where = 'everywhere' if len(bad) == len(results) else f'in: {", ".join(bad)}'
    return f'{name}_next is wrong {where}. {_largest(results, column)}'


def _largest(results: Sequence[Results], column: int) -> str:
    """Return a sentence on the state with the largest error."""
    errors = [np.abs(part.got[:, column] - part.expected[:, column]) for part in results]
    part, error = max(zip(results, errors, strict=True), key=lambda item: float(item[1].max()))
    row = int(error.argmax())
    return (
        f'The largest error: {call_text(part.rows[row])} gave {part.got[row, column]:.9g}, '
        f'expected {part.expected[row, column]:.9g}'
    )


def causes(
    given: Mapping[str, Floats], results: Mapping[str, Floats], wrong: Sequence[str]
) -> dict[str, str]:
    """Return a hint for each equation of `wrong` that a known mistake, or two, explain exactly.

    Parameters
    ----------
    given
        The arguments, see `equations.arguments`.
    results
        What the user's function returned, by equation; shape `(n,)` each.
    wrong
        The wrong equations.
    """

    def explains(name: str, changes: Mapping[str, str], quantity: str = '') -> bool:
        found = Quantities(given, changes)[f'{quantity or name}_next']
        return bool(close(results[name], found).all())

    found: dict[str, str] = {}
    for name, other in ((name, other) for name in wrong for other in NAMES if other != name):
        if explains(name, {}, other):
            hint = (
                f'{other}_next is returned in place of {name}_next: the order is '
                '[x_next, y_next, psi_next, v_next]'
            )
            found.setdefault(name, hint)
    left = [name for name in wrong if name not in found]
    explained = [
        (mistake.hint, [name for name in NAMES if explains(name, mistake.changes)])
        for mistake in MISTAKES
    ]
    # The mistake that explains the most equations, right ones included, comes first.
    for hint, names in sorted(explained, key=lambda item: -len(item[1])):
        found |= {name: hint for name in names if name in left and name not in found}
    for name in left:
        if name not in found:
            relevant = [each for each in MISTAKES if _matters(name, each, given)]
            for first, second in combinations(relevant, 2):
                both = {**first.changes, **second.changes}
                if len(both) == len(first.changes) + len(second.changes) and explains(name, both):
                    found[name] = f'two mistakes: {first.hint}; and {second.hint}'
                    break
    return found


def _matters(name: str, mistake: Mistake, given: Mapping[str, Floats]) -> bool:
    """Return whether a mistake changes an equation."""
    right, wrong = (Quantities(given, changes)[f'{name}_next'] for changes in ({}, mistake.changes))
    return not close(wrong, right).all()
