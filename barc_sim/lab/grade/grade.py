"""The grade of a submission: the findings of `lab.check`, weighted by the rubric."""

from __future__ import annotations

import hashlib
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.lab.check.judging import Printed, Report, gains_used, judge, judge_folder
from barc_sim.lab.confined.code import ConfinedCode
from barc_sim.lab.confined.process import ON_LINUX
from barc_sim.lab.grade.submissions import PARTS, graded
from barc_sim.lab.text import printable
from barc_sim.lab.user_code.loading import FILES

if TYPE_CHECKING:
    from barc_sim.lab.check.findings import Comparison, Trajectory
    from barc_sim.lab.check.judging import Settings
    from barc_sim.lab.confined.process import Limits
    from barc_sim.lab.grade.rubric import Rubric
    from barc_sim.lab.grade.submissions import Submission


class Item(NamedTuple):
    """The points for one criterion."""

    criterion: str
    points: float  #: rounded to hundredths
    max_points: float
    message: str
    evidence: Comparison | Trajectory | None


@dataclass(frozen=True)
class Grade:
    """The points of a submission, with its notes and output."""

    name: str
    title: str  #: the rubric's
    seed: int
    visibility: str
    items: tuple[Item, ...]
    notes: tuple[str, ...]
    printed: str  #: the first output of its code
    hashes: tuple[tuple[str, str], ...]  #: file, SHA-256
    gains: str = ''  #: that drove the roads, and where they come from
    tolerated: tuple[str, ...] = ()  #: a phrase each

    @property
    def score(self) -> float:
        """Return the sum of the items' points."""
        return round(sum(item.points for item in self.items), 2)

    @property
    def max_score(self) -> float:
        """Return the sum of the items' greatest points."""
        return round(sum(item.max_points for item in self.items), 2)


def _judge(folder: Path, settings: Settings, limits: Limits, *, sandbox: bool) -> Report:
    """Judge files; their functions are called in a process with limits."""
    if not ON_LINUX:  # as `barc check` does, where no process can be confined
        assert not sandbox  # noqa: S101 (refused before)
        return judge_folder(folder, settings, budget=limits.call, deadline=limits.total)
    with ConfinedCode(folder, limits, sandbox=sandbox) as code:
        found = judge(code, settings)
        gains = gains_used(code, settings) if code.has('controller') else None
        tolerated = code.tolerated()
    return Report(found, Printed(code.printed), gains, tolerated)


def grade(submission: Submission, rubric: Rubric, limits: Limits, *, sandbox: bool) -> Grade:
    """Judge a submission; its code runs in a separate process and folder.

    A criterion's points are its greatest points times the finding's score, rounded to hundredths.
    """
    notes = submission.notes
    files = graded(submission.files)
    if not files:
        wanted = ' nor '.join(FILES[part] for part in PARTS)
        notes = (f'it has neither {wanted} at its top', *notes)
    if not sandbox:
        notes = (*notes, 'its code was not confined, as --unconfined asks for')
    with tempfile.TemporaryDirectory(prefix='barc_sim_grade_') as folder:
        submission.write(Path(folder))
        found = _judge(Path(folder), rubric.settings, limits, sandbox=sandbox)
    findings = {finding.criterion: finding for finding in found.findings}
    items = []
    for criterion, worth in rubric.worth(findings.values()).items():
        finding = findings[criterion]
        points = rubric.points_for(finding)
        items.append(Item(criterion, points, worth, printable(finding.message), finding.evidence))
    return Grade(
        name=submission.name,
        title=rubric.title,
        seed=rubric.seed,
        visibility=rubric.visibility,
        items=tuple(items),
        notes=notes,
        gains=printable(str(found.gains or '')),
        tolerated=tuple(map(printable, found.tolerated)),
        printed=printable(found.printed.text),
        hashes=tuple((name, hashlib.sha256(submission.files[name]).hexdigest()) for name in files),
    )
