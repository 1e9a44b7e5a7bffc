"""The terminal output of a search: its progress, and a table of its results."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from barc_sim.tuning.goal import LABELS
from barc_sim.tuning.options import GAINS, typed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from barc_sim.tuning.batch import Course
    from barc_sim.tuning.goal import Goal

    Floats = NDArray[np.float64]

#: Of the scores, in their order.
_FORMS = ('.4f', '.4f', '.2%', '.3f')


@contextmanager
def progress(generations: int) -> Iterator[Callable[[int, float], None]]:
    """Show a search's progress on stderr where that is a terminal."""
    shown = Progress(
        BarColumn(bar_width=24),
        TextColumn('{task.description}'),
        TimeElapsedColumn(),
        console=Console(stderr=True, highlight=False),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    with shown:
        task = shown.add_task('searching', total=generations)

        def show(generation: int, cost: float) -> None:
            minimum = f'minimum cost {cost:.4g}' if isfinite(cost) else 'none arrives yet'
            shown.update(
                task,
                completed=generation,
                description=f'generation {generation} of at most {generations}, {minimum}',
            )

        yield show


def print_scores(goal: Goal, course: Course, gains: dict[str, Floats]) -> None:
    """Print a table of the scores and costs over `course` of gains, shape `(3,)`, by name."""
    scores = goal.scores(course, np.array(list(gains.values())))
    table = Table(box=None, pad_edge=False)
    table.add_column(f'road {course.road.name}')
    for name in gains:
        table.add_column(name, justify='right')
    for axis, gain in enumerate(GAINS):
        table.add_row(gain, *(typed(each[axis]) for each in gains.values()))
    for label, form, values in zip(LABELS, _FORMS, scores, strict=True):
        table.add_row(label, *(_figure(value, form) for value in values))
    table.add_row(f'cost: {goal.cost}', *(_figure(cost, '.5g') for cost in goal.cost.of(scores)))
    Console(highlight=False, markup=False).print(table)


def _figure(value: float, form: str) -> str:
    return format(value, form) if isfinite(value) else '–'  # noqa: RUF001 (what tables have there)
