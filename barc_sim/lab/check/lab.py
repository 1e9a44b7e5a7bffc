"""A lab as a value: the parts of its code, their criteria, and how each of them is judged.

It uses no ROS, no clock and only seeded random numbers: a score is the same on every machine.
Tolerances are far above the differences between maths libraries, and far below any mistake.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

from barc_sim.lab.check.code import Finding, JudgedCode
from barc_sim.lab.confined.process import Limits

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from barc_sim.lab.handout import Handout
    from barc_sim.lab.user_code.source import ChosenGains

#: For `check`: its user waits, and has written the code.
_CHECKED = Limits(call=2.0, wait=10.0, total=45.0)


@dataclass(frozen=True)
class Thresholds:
    """Errors of a drive, RMS and maximum, for half of the marks each.

    Full marks up to `full_…`, none from `zero_…` on, linear in between. The defaults are those of
    the hills: speed errors [m/s] after the run-up.
    """

    full_rms: float = 0.15
    zero_rms: float = 1.5
    full_max: float = 0.5
    zero_max: float = 3.0

    def score(self, rms: float, maximum: float) -> float:
        """Return the score for the errors of a drive, from 0 to 1."""
        shares = (
            (self.zero_rms - rms) / (self.zero_rms - self.full_rms),
            (self.zero_max - maximum) / (self.zero_max - self.full_max),
        )
        # NaN is no error that is small.
        return sum(min(1.0, share) if share > 0.0 else 0.0 for share in shares) / len(shares)


@dataclass(frozen=True)
class Settings:
    """How user code is judged."""

    seed: int = 0  #: of the states, the sequences and the random roads and tracks
    acceleration_limit: float = inf  #: [m/s²] on the hills; the lab's car has none
    thresholds: Thresholds = field(default_factory=Thresholds)
    criteria: Collection[str] | None = None  #: None: all


class Table(NamedTuple):
    """What a drive was like, part by part, as text."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


@runtime_checkable
class Evidence(Protocol):
    """A judged drive, as `check` prints it, and as the figures of `check` and `grade` show it."""

    @property
    def table(self) -> Table:
        """The drive, part by part."""

    def figure(self, title: str = '') -> Figure:
        """Draw the drive."""


class Part(NamedTuple):
    """How a lab judges one part of user code."""

    labels: Mapping[str, str]  #: its criteria, with their names for readers
    judge: Callable[..., Iterable[Finding]]  #: gets the code, the settings and the criteria


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
    def drive(self) -> Evidence | None:
        """The drive that the findings show, if there is one."""
        return next((each.evidence for each in self.findings if each.evidence), None)


@dataclass(frozen=True)
class Lab:
    """A lab: what is handed out, and how what comes back is judged."""

    handout: Handout
    code: type[JudgedCode]  #: its requests
    parts: Mapping[str, Part]
    by_eye: frozenset[str] = frozenset()  #: criteria that a person judges, with a sum of their own

    @property
    def labels(self) -> dict[str, str]:
        """Every criterion, with its name for readers, in the order of a report."""
        return {name: label for part in self.parts.values() for name, label in part.labels.items()}

    def judge(self, code: JudgedCode, settings: Settings | None = None) -> list[Finding]:
        """Return a finding for each criterion of `settings`, in the order of the labels.

        Errors of the code become findings.
        """
        settings = settings or Settings()
        criteria = self.labels if settings.criteria is None else settings.criteria
        findings: list[Finding] = []
        for name, part in self.parts.items():
            found: Iterable[Finding] = ()
            if not code.has(name):
                message = f'there is no {self.handout.files[name]}'
                found = [Finding(each, 0.0, message, skipped=True) for each in part.labels]
            elif not part.labels.keys().isdisjoint(criteria):
                found = part.judge(code, settings, criteria)
            findings += [finding for finding in found if finding.criterion in criteria]
        return findings

    def judge_folder(
        self, folder: Path, settings: Settings, limits: Limits = _CHECKED, *, sandbox: bool = False
    ) -> Report:
        """Return the findings on the files in `folder`; a process with limits calls their code.

        There may be no files. Without `sandbox` their code is not confined: it is the user's own.
        """
        with self.code(folder, limits, sandbox=sandbox) as code:
            found = self.judge(code, settings)
            gains, tolerated = code.chosen_gains(), code.tolerated()
        return Report(found, code.printed, gains, tolerated)
