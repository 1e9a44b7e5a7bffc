"""Judges the controller by itself: its terms, its windup, what it remembers."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from barc_sim.lab.check.memory import judge_reset
from barc_sim.lab.check.terms import TERMS, judge_term
from barc_sim.lab.check.windup import judge_windup

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barc_sim.lab.check.code import Code
    from barc_sim.lab.check.finding import Finding


def judge_controller(code: Code, seed: int) -> Iterator[Finding]:
    """Yield a finding for each of the criteria `pid.…`."""
    reset = judge_reset(code, seed)
    for term in TERMS:
        yield _beside(judge_term(code, term, seed), reset)
    yield _beside(judge_windup(code), reset)
    yield reset


def _beside(finding: Finding, reset: Finding) -> Finding:
    """Name what reaches from one run into the next first: it is in every other answer."""
    if finding.passed or not reset.details.get('leaks'):
        return finding
    return replace(finding, message=f'{reset.message}. So: {finding.message}')
