"""Findings: how far user code meets the criteria of a lab, and what to check where it does not."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import wraps
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.handout import FILES

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping

    from barc_sim.lab.check.code import JudgedCode

_P = ParamSpec('_P')


@dataclass(frozen=True)
class Finding:
    """How far a criterion is met, and what to check if it is not."""

    criterion: str  #: a part and a name, as in `model.x`
    score: float  #: from 0 to 1; 1 is full marks
    message: str  #: one or two sentences, in the terms of the lab
    evidence: Any = field(default=None, compare=False, repr=False)  #: what a figure shows
    skipped: bool = False  #: there is no such file: the score is 0
    factor: float | None = None  #: of a term of the PID: 1 with the lab's formula, dt included

    @property
    def passed(self) -> bool:
        """Whether the criterion has full marks."""
        return self.score >= 1.0


#: Score, message and evidence of a finding.
Judged = tuple[float, str] | tuple[float, str, Any]


def judges(criterion: str) -> Callable[[Callable[_P, Judged]], Callable[_P, Finding]]:
    """Make a function that returns score and message return the finding on `criterion`.

    An error of user code becomes a finding without points. NumPy warns of no number: user code can
    return those of any size.
    """

    def decorate(judge: Callable[_P, Judged]) -> Callable[_P, Finding]:
        @wraps(judge)
        def judged(*args: _P.args, **kwargs: _P.kwargs) -> Finding:
            try:
                with np.errstate(all='ignore'):
                    return Finding(criterion, *judge(*args, **kwargs))
            except UserError as error:
                return Finding(criterion, 0.0, str(error))

        return judged

    return decorate


class Part(NamedTuple):
    """How a lab judges one part of user code."""

    labels: Mapping[str, str]  #: its criteria, with their names for readers
    judge: Callable[..., Iterable[Finding]]  #: gets the code and the lab's settings


def judge_parts(
    code: JudgedCode, parts: Mapping[str, Part], criteria: Collection[str], settings: object
) -> list[Finding]:
    """Return a finding for each of the `criteria`, in the order of the parts' labels.

    Errors of the code become findings.
    """
    findings: list[Finding] = []
    for name, part in parts.items():
        found: Iterable[Finding] = ()
        if not code.has(name):
            message = f'there is no {FILES[name]}'
            found = [Finding(each, 0.0, message, skipped=True) for each in part.labels]
        elif not part.labels.keys().isdisjoint(criteria):
            found = part.judge(code, settings)
        findings += [finding for finding in found if finding.criterion in criteria]
    return findings
