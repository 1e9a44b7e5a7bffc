"""Judges a user's model, controller and relay by the criteria of a rubric.

`judge` calls the code through the object that it gets; `judge_folder` does so in a separate
process, where the code cannot hang or end the command.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from math import inf
from typing import TYPE_CHECKING

from barc_sim.control.pid import KD, KI, KP
from barc_sim.lab.check.code import JudgedCode
from barc_sim.lab.check.controller import judge_controller
from barc_sim.lab.check.findings import CRITERIA, EQUATIONS, LOOP, MODEL, PID, RELAY, Finding
from barc_sim.lab.check.loop import Conditions, Thresholds, judge_lab_road, judge_random_roads
from barc_sim.lab.check.model import (
    judge_equations,
    judge_general,
    judge_reverse,
    judge_trajectory,
)
from barc_sim.lab.check.relay import judge_relay
from barc_sim.lab.confined.process import Limits
from barc_sim.lab.handout import FILES
from barc_sim.lab.user_code.source import ChosenGains

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping
    from pathlib import Path

_DEFAULT = ChosenGains(KP, KI, KD, "barc_sim's own, because controller.py chooses none")
#: Of `check`: whoever waits has written the code.
_CHECKED = Limits(call=2.0, wait=10.0, total=45.0)


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
    """
    settings = settings or Settings()
    findings: list[Finding] = []
    wanted = frozenset(settings.criteria)
    for part, criteria, judge_part in (
        ('model', MODEL, _judge_model),
        ('controller', (*PID, *LOOP), _judge_controller),
        ('relay', RELAY, lambda code, _: judge_relay(code)),
    ):
        found: Iterator[Finding] = iter(())
        if not code.has(part):
            message = f'there is no {FILES[part]}'
            found = (Finding(name, 0.0, message, skipped=True) for name in criteria)
        elif not wanted.isdisjoint(criteria):
            found = iter(judge_part(code, settings))
        findings += [finding for finding in found if finding.criterion in wanted]
    return findings


def _judge_model(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    if not set(EQUATIONS).isdisjoint(settings.criteria):
        yield from judge_equations(code, settings.seed)
    judges: Mapping[str, Callable[[], Finding]] = {
        'model.trajectory': partial(judge_trajectory, code),
        'model.reverse': partial(judge_reverse, code, settings.seed),
        'model.general': partial(judge_general, code, settings.seed),
    }
    yield from (judge() for name, judge in judges.items() if name in settings.criteria)


def _judge_controller(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    yield from judge_controller(code, settings.seed, settings.criteria)
    gains = gains_used(code.chosen_gains(), settings)
    conditions = Conditions(gains, settings.acceleration_limit, settings.thresholds)
    if 'loop.lab_road' in settings.criteria:
        yield judge_lab_road(code, conditions)
    if 'loop.random_roads' in settings.criteria:
        yield judge_random_roads(code, conditions, settings.seed)


def gains_used(chosen: ChosenGains | None, settings: Settings) -> ChosenGains:
    """Return the gains with which the code drives: the command line's, the file's or barc_sim's."""
    chosen = chosen or _DEFAULT
    options = (settings.kp, settings.ki, settings.kd)
    if options == (None, None, None):
        return chosen
    kp, ki, kd = (c if g is None else g for g, c in zip(options, chosen[:3], strict=True))
    rest = '' if None not in options else f', the others from {chosen.origin}'
    return ChosenGains(kp, ki, kd, f'the command line{rest}')


@dataclass(frozen=True)
class Report:
    """The findings on a folder, and the text that its code printed."""

    findings: list[Finding]  #: of each criterion asked for
    printed: str  #: the first output of its code
    gains: ChosenGains | None  #: that drove the roads
    tolerated: tuple[str, ...]  #: a phrase each


def judge_folder(
    folder: Path, settings: Settings, limits: Limits = _CHECKED, *, sandbox: bool = False
) -> Report:
    """Return the findings on the files in `folder`, whose functions a process with limits calls.

    There may be no files. Without `sandbox` their code is not confined: it is the user's own.
    """
    with JudgedCode(folder, limits, sandbox=sandbox) as code:
        found = judge(code, settings)
        gains = gains_used(code.chosen_gains(), settings) if code.has('controller') else None
        tolerated = code.tolerated()
    return Report(found, code.printed, gains, tolerated)
