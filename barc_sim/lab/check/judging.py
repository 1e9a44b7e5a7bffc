"""Judges user code by every criterion."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from barc_sim.control.pid import KD, KI, KP
from barc_sim.lab.check.findings import LOOP, MODEL, PID, Finding
from barc_sim.lab.check.loop import judge_lab_road, judge_random_roads
from barc_sim.lab.check.memory import judge_reset
from barc_sim.lab.check.model import judge_equations
from barc_sim.lab.check.terms import TERMS, judge_term
from barc_sim.lab.check.trajectory import judge_trajectory
from barc_sim.lab.check.windup import judge_windup

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barc_sim.lab.check.code import JudgedCode
    from barc_sim.lab.check.stretches import Gains


GAINS: tuple[float, float, float] = (KP, KI, KD)  #: the run's


def judge(code: JudgedCode, seed: int = 0, gains: Gains = GAINS) -> list[Finding]:
    """Return a finding for each of `findings.CRITERIA`, in that order.

    Parameters
    ----------
    code
        The user code. Its errors become findings.
    seed
        Selects the states, the sequences of speeds and the random roads.
    gains
        kp, ki, kd with which the class drives the roads. The defaults of its constructor are not
        used: a run passes gains, too.
    """
    return list(findings(code, seed, gains))


def findings(code: JudgedCode, seed: int = 0, gains: Gains = GAINS) -> Iterator[Finding]:
    """Yield the findings of `judge`, each as soon as it is known."""
    if code.has_model:
        yield from judge_equations(code, seed)
        yield judge_trajectory(code)
    else:
        yield from _skipped(MODEL, 'there is no bike_model.py')
    if code.has_controller:
        yield from judge_controller(code, seed)
        yield judge_lab_road(code, gains)
        yield judge_random_roads(code, gains, seed)
    else:
        yield from _skipped((*PID, *LOOP), 'there is no controller.py')


def _skipped(criteria: tuple[str, ...], message: str) -> Iterator[Finding]:
    for criterion in criteria:
        yield Finding(criterion, 0.0, message, skipped=True)


def judge_controller(code: JudgedCode, seed: int) -> Iterator[Finding]:
    """Yield a finding for each criterion `pid.…`."""
    reset = judge_reset(code, seed)
    for term in TERMS:
        yield _with_cause(judge_term(code, term, seed), reset)
    yield _with_cause(judge_windup(code), reset)
    yield reset


def _with_cause(finding: Finding, reset: Finding) -> Finding:
    """Put values left from an earlier run first in the message: they change every other result."""
    if finding.passed or not reset.details.get('leaks'):
        return finding
    return replace(finding, message=f'{reset.message}. So: {finding.message}')
