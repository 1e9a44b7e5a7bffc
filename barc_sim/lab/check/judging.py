"""All criteria of user code."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.control.pid import KD, KI, KP
from barc_sim.lab.check.controller import judge_controller
from barc_sim.lab.check.finding import LOOP, MODEL, PID, Finding
from barc_sim.lab.check.loop import judge_lab_road, judge_random_roads
from barc_sim.lab.check.model import judge_equations
from barc_sim.lab.check.trajectory import judge_trajectory

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barc_sim.lab.check.code import Code
    from barc_sim.lab.check.stretches import Gains

GAINS: tuple[float, float, float] = (KP, KI, KD)  #: the run's


def judge(code: Code, seed: int = 0, gains: Gains = GAINS) -> list[Finding]:
    """Return a finding for each of `finding.CRITERIA`, in that order.

    Parameters
    ----------
    code
        What is judged; whatever it does wrong is a finding.
    seed
        Decides the states, the sequences of speeds and the random roads.
    gains
        kp, ki, kd with which the class drives the roads; defaults of its own are not looked at,
        as the run gives it gains, too.
    """
    return list(findings(code, seed, gains))


def findings(code: Code, seed: int = 0, gains: Gains = GAINS) -> Iterator[Finding]:
    """Yield what `judge` returns, each as soon as it is known."""
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
