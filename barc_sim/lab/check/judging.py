"""Judges user code by the criteria of a rubric."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from math import inf
from typing import TYPE_CHECKING

from barc_sim.control.pid import KD, KI, KP
from barc_sim.lab.check.controller import judge_controller
from barc_sim.lab.check.findings import CRITERIA, EQUATIONS, LOOP, MODEL, PID, RELAY, Finding
from barc_sim.lab.check.findings import TERMS as TERM_CRITERIA
from barc_sim.lab.check.loop import Conditions, Thresholds, judge_lab_road, judge_random_roads
from barc_sim.lab.check.model import (
    judge_equations,
    judge_general,
    judge_reverse,
    judge_trajectory,
)
from barc_sim.lab.check.relay import judge_relay
from barc_sim.lab.user_code.gains import ChosenGains
from barc_sim.lab.user_code.loading import FILES

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping

    from barc_sim.lab.check.code import JudgedCode


_DEFAULT = ChosenGains(KP, KI, KD, "barc_sim's own, because controller.py chooses none")
_COMMAND_LINE = 'the command line'


@dataclass(frozen=True)
class Settings:
    """How user code is judged."""

    seed: int = 0  #: of the states, the sequences of speeds and the random roads
    kp: float | None = None  #: on the roads; None: the file's own
    ki: float | None = None
    kd: float | None = None
    acceleration_limit: float = inf  #: [m/s²] on the roads; the lab's car has none
    thresholds: Thresholds = field(default_factory=Thresholds)
    criteria: Collection[str] = CRITERIA


def judge(code: JudgedCode, settings: Settings | None = None) -> list[Finding]:
    """Return a finding for each criterion of `settings`, in the order of `findings.CRITERIA`.

    Errors of the code become findings.

    Examples
    --------
    >>> from barc_sim import PID
    >>> from barc_sim.lab.check.code import LocalCode
    >>> from barc_sim.lab.user_code.loading import UserCode
    >>> from barc_sim.vehicle.bike_model import bikeFE
    >>> code = LocalCode(UserCode(model=bikeFE, controller=PID))
    >>> all(finding.passed for finding in judge(code, Settings(criteria=('model.x', 'model.v'))))
    True
    """
    return list(findings(code, settings or Settings()))


def findings(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    """Yield the findings of `judge`, each as soon as it is known."""
    wanted = frozenset(settings.criteria)
    for part, criteria, judge_it in (
        ('model', MODEL, _judge_model),
        ('controller', (*PID, *LOOP), _judge_controller_and_roads),
        ('relay', RELAY, lambda code, _: iter(judge_relay(code))),
    ):
        found: Iterator[Finding] = iter(())
        if not code.has(part):
            message = f'there is no {FILES[part]}'
            found = (Finding(name, 0.0, message, skipped=True) for name in criteria)
        elif not wanted.isdisjoint(criteria):
            found = judge_it(code, settings)
        yield from (finding for finding in found if finding.criterion in wanted)


def gains_used(code: JudgedCode, settings: Settings) -> ChosenGains:
    """Return the gains with which the code drives: the command line's, the file's or barc_sim's.

    Examples
    --------
    >>> from barc_sim import PID
    >>> from barc_sim.lab.check.code import LocalCode
    >>> from barc_sim.lab.user_code.loading import UserCode
    >>> print(gains_used(LocalCode(UserCode(controller=PID)), Settings(kp=2.0, ki=0.0, kd=0.0)))
    kp 2, ki 0, kd 0 (the command line)
    """
    chosen = code.chosen_gains() or _DEFAULT
    given = (settings.kp, settings.ki, settings.kd)
    if given == (None, None, None):
        return chosen
    kp, ki, kd = (c if g is None else g for g, c in zip(given, chosen[:3], strict=True))
    rest = '' if None not in given else f', the others from {chosen.origin}'
    return ChosenGains(kp, ki, kd, _COMMAND_LINE + rest)


def _judge_model(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    if not set(EQUATIONS).isdisjoint(settings.criteria):
        yield from judge_equations(code, settings.seed)
    yield from _judged(
        {
            'model.trajectory': partial(judge_trajectory, code),
            'model.reverse': partial(judge_reverse, code, settings.seed),
            'model.general': partial(judge_general, code, settings.seed),
        },
        settings.criteria,
    )


def _judge_controller_and_roads(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    controller = [*judge_controller(code, settings.seed, settings.criteria)]
    yield from controller
    factors = {finding.criterion: finding.factor or 1.0 for finding in controller}
    conditions = Conditions(
        gains_used(code, settings),
        settings.acceleration_limit,
        settings.thresholds,
        [factors[criterion] for criterion in TERM_CRITERIA],
    )
    yield from _judged(
        {
            'loop.lab_road': partial(judge_lab_road, code, conditions),
            'loop.random_roads': partial(judge_random_roads, code, conditions, settings.seed),
        },
        settings.criteria,
    )


def _judged(
    judges: Mapping[str, Callable[[], Finding]], wanted: Collection[str]
) -> Iterator[Finding]:
    """Call the judges of the criteria that are wanted."""
    return (judge_it() for criterion, judge_it in judges.items() if criterion in wanted)
