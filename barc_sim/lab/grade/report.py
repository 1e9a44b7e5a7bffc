"""From a submission to the files that tell its grade: what one worker does."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from barc_sim.lab.grade import gradescope, html, page
from barc_sim.lab.grade.grade import grade

if TYPE_CHECKING:
    from barc_sim.lab.grade.rubric import Rubric
    from barc_sim.lab.grade.start import Limits
    from barc_sim.lab.grade.submissions import Submission


class Report(NamedTuple):
    """A grade in numbers, and its files' contents by their names."""

    name: str
    score: float
    max_score: float
    points: dict[str, float]  #: by criterion
    remark: str  #: what stands in the way of full marks the most; empty with those
    files: dict[str, bytes]


def report(submission: Submission, rubric: Rubric, limits: Limits, *, sandbox: bool) -> Report:
    """Judge a submission and write its files, in memory."""
    result = grade(submission, rubric, limits, sandbox=sandbox)
    sheet, figures = page.draw(result)
    worst = max(result.items, key=lambda item: item.max_points - item.points)
    lost = worst.max_points - worst.points
    return Report(
        name=result.name,
        score=result.score,
        max_score=result.max_score,
        points={item.criterion: item.points for item in result.items},
        remark='; '.join((*result.notes, *([worst.message] if lost > 0.0 else ()))),
        files={
            'results.json': gradescope.results(result).encode(),
            'report.html': html.page(result, figures).encode(),
            'report.png': sheet,
        },
    )
