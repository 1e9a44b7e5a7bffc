"""The lab of the hills as data: its parts, their criteria, and how each of them is judged.

It uses no ROS, no clock and only seeded random numbers: a score is the same on every machine.
Tolerances are far above the differences between maths libraries, and far below any mistake.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING

from barc_sim.control.pid import KD, KI, KP
from barc_sim.errors import UserError
from barc_sim.lab.check.code import Finding, JudgedCode, Part, judge_parts
from barc_sim.lab.confined.process import Limits
from barc_sim.lab.hills import controller, loop, model, relay
from barc_sim.lab.user_code.source import ChosenGains

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

#: For `check`: its user waits, and has written the code.
_CHECKED = Limits(call=2.0, wait=10.0, total=45.0)


def _judge_controller(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    with suppress(UserError):
        code.new_pid(KP, KI, KD)
    gains = code.chosen_gains()
    findings = [*controller.judge_controller(code, settings.seed, settings.criteria)]
    yield from findings
    if gains is None and controller.ignores_gains(code, settings.seed):
        gains = ChosenGains(KP, KI, KD, 'which have no effect')
    conditions = loop.Conditions(
        gains,
        settings.acceleration_limit,
        settings.thresholds,
        mended=controller.wrong_terms(findings),
    )
    if 'loop.lab_road' in settings.criteria:
        yield loop.judge_lab_road(code, conditions)
    if 'loop.random_roads' in settings.criteria:
        yield loop.judge_random_roads(code, conditions, settings.seed)


PARTS = {
    'model': Part(model.LABELS, lambda code, its: model.judge_model(code, its.seed, its.criteria)),
    'controller': Part({**controller.LABELS, **loop.LABELS}, _judge_controller),
    'relay': Part(relay.LABELS, lambda code, _: relay.judge_relay(code)),
}
#: Every criterion, with its name for readers, in the order of a report; a rubric names them.
LABELS = {name: label for part in PARTS.values() for name, label in part.labels.items()}
CRITERIA = tuple(LABELS)


@dataclass(frozen=True)
class Settings:
    """How user code is judged."""

    seed: int = 0  #: of the states, the sequences of speeds and the random roads
    acceleration_limit: float = inf  #: [m/s²] on the roads; the lab's car has none
    thresholds: loop.Thresholds = field(default_factory=loop.Thresholds)
    criteria: Collection[str] = CRITERIA


def judge(code: JudgedCode, settings: Settings | None = None) -> list[Finding]:
    """Return a finding for each criterion of `settings`, in the order of `CRITERIA`."""
    settings = settings or Settings()
    return judge_parts(code, PARTS, settings.criteria, settings)


@dataclass(frozen=True)
class Report:
    """The findings on a folder, and the text that its code printed."""

    findings: list[Finding]  #: of each criterion asked for
    printed: str  #: the first output of its code
    gains: ChosenGains | None  #: that drove the roads
    tolerated: tuple[str, ...]  #: a phrase each

    @property
    def judged(self) -> list[Finding]:
        """The findings on what is there, and can be judged."""
        return [each for each in self.findings if not (each.skipped or each.open)]

    @property
    def drive(self) -> loop.Drive | None:
        """The drive over the lab's road, if there is one."""
        evidence = (each.evidence for each in self.findings)
        return next((each for each in evidence if isinstance(each, loop.Drive)), None)


def judge_folder(
    folder: Path, settings: Settings, limits: Limits = _CHECKED, *, sandbox: bool = False
) -> Report:
    """Return the findings on the files in `folder`; a process with limits calls their functions.

    There may be no files. Without `sandbox` their code is not confined: it is the user's own.
    """
    with JudgedCode(folder, limits, sandbox=sandbox) as code:
        found = judge(code, settings)
        gains = code.chosen_gains() if code.has('controller') else None
        tolerated = code.tolerated()
    return Report(found, code.printed, gains, tolerated)
