"""Judges the model's equations, each in seeded states."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.lab.check.answers import Answered, ask, changing, shown
from barc_sim.lab.check.diagnosis import causes
from barc_sim.lab.check.equations import NAMES, arguments
from barc_sim.lab.check.finding import WHATEVER_COMES, Finding

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.lab.check.code import Code


@WHATEVER_COMES
def judge_equations(code: Code, seed: int) -> list[Finding]:
    """Return a finding for each of the four equations.

    An equation's score is the mean, over the situations that concern it, of the share of states in
    which it is right, times that share over the other situations, where it has nothing to do but
    to stay out of the way. Lengths that the function takes, and uses, are varied; those that it
    does not take are the lab's, in whatever way they are written.
    """
    answered = ask(code, seed)
    unsteady = changing(code, answered)
    scores = {name: _score(answered, name) for name in NAMES}
    wrong = [name for name in NAMES if scores[name] < 1.0]
    finite = [part for part in answered if not part.failure]
    found = {} if unsteady or not finite else _causes(finite, wrong)
    findings = []
    for name in NAMES:
        states = sum(len(part.rows) for part in answered)
        if name not in wrong and not unsteady:
            message = f'right in all {states:,} states'
        else:
            message = unsteady or _message(answered, name, found.get(name))
        score = 0.0 if unsteady else scores[name]
        findings.append(
            Finding(f'model.{name}', score, message, {'shares': _shares(answered, name)})
        )
    return findings


def _score(answered: Sequence[Answered], name: str) -> float:
    column = NAMES.index(name)
    concerned: list[float] = []
    other: list[float] = []
    for part in answered:
        share = float(np.mean(part.right(column)))
        (concerned if name in part.situation.concerns.split() else other).append(share)
    return float(np.mean(concerned) * np.mean(other))


def _shares(answered: Sequence[Answered], name: str) -> dict[str, float]:
    column = NAMES.index(name)
    return {part.situation.name: float(np.mean(part.right(column))) for part in answered}


def _causes(answered: Sequence[Answered], wrong: Sequence[str]) -> dict[str, str]:
    given = arguments(
        [row for part in answered for row in part.rows],
        [part.l_f for part in answered for _ in part.rows],
        [part.l_r for part in answered for _ in part.rows],
    )
    got = np.concatenate([part.got for part in answered])
    return causes(given, dict(zip(NAMES, got.T, strict=True)), wrong)


def _message(answered: Sequence[Answered], name: str, cause: str | None) -> str:
    failed = [part for part in answered if part.failure]
    if failed:
        where = '' if len(failed) == len(answered) else f' ({failed[0].situation.name})'
        return f'{failed[0].failure}{where}'
    if cause:
        return cause
    column = NAMES.index(name)
    bad = [part.situation.name for part in answered if not part.right(column).all()]
    within = 'everywhere' if len(bad) == len(answered) else f'in: {", ".join(bad)}'
    return f'{name}_next is wrong {within}. {_largest(answered, column)}'


def _largest(answered: Sequence[Answered], column: int) -> str:
    """Return the state with the largest error in words."""
    errors = [np.abs(part.got[:, column] - part.expected[:, column]) for part in answered]
    part, error = max(zip(answered, errors, strict=True), key=lambda item: float(item[1].max()))
    row = int(error.argmax())
    return (
        f'The largest error: {shown(part.rows[row])} gave {part.got[row, column]:.9g}, expected '
        f'{part.expected[row, column]:.9g}'
    )
