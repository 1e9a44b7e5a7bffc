"""Command: search the gains that hold the speed best."""

from __future__ import annotations

import sys
import time
from contextlib import nullcontext
from typing import TYPE_CHECKING

from barc_sim.cli.parser import call
from barc_sim.errors import UserError
from barc_sim.tuning import options as tune_options

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.tuning.goal import Goal
    from barc_sim.tuning.surface import Surface
    from barc_sim.tuning.workers import Costs

    Floats = NDArray[np.float64]

PROG = 'barc tune'
FORMATS = ('png', 'pdf', 'svg')
DPI = 150
#: Population, generations and points along a side of the map: for the PID, whose loops are driven
#: all at once, and for a user's controller, one by one.
_BATCHED = (256, 80, 101)
_OWN = (24, 40, 25)


def tune(options: Namespace) -> None:
    """Do what the options ask for.

    Raises
    ------
    UserError
        where an option cannot be used, or no gains in the ranges arrive.
    """
    import numpy as np  # noqa: PLC0415 (--help need not wait for it)

    from barc_sim.figures import output  # noqa: PLC0415
    from barc_sim.lab.user_code.adapters import UserControllerFile  # noqa: PLC0415
    from barc_sim.tuning import search, surface  # noqa: PLC0415
    from barc_sim.tuning import terminal as console  # noqa: PLC0415

    began = time.monotonic()
    path = output.target(options.save, FORMATS) if options.save is not None else None
    low, high = tune_options.ranges(options)
    if path:
        surface.free_axes(low, high)
    start = np.array([getattr(options, gain) for gain in tune_options.GAINS])
    goal = tune_options.goal(
        options, UserControllerFile(options.controller) if options.controller else None
    )
    goal(start[np.newaxis])  # an error in the controller ends the command here
    population, generations, points = _OWN if options.controller else _BATCHED
    with _shared(goal, options.scheduler) as cost, console.progress(generations) as show:
        found = search.search(
            cost,
            low,
            high,
            start,
            seed=options.seed,
            population=population,
            generations=generations,
            on_generation=show,
        )
        if not np.isfinite(found.cost):
            raise UserError(
                f'no gains in these ranges bring the car {options.distance:g} m far within '
                f'{goal.courses[0].max_duration:.0f} s on every road: widen the ranges, or take '
                'roads that it can climb'
            )
        took = time.monotonic() - began
        plane = surface.surface(cost, low, high, start, found.gains, points) if path else None
    for course in goal.courses:
        console.print_scores(goal, course, {'start': start, 'found': found.gains})
    print(f'{found.evaluations} closed loops per road in {took:.1f} s; to run it:')  # noqa: T201
    for command in tune_options.commands(options, found.gains.tolist()):
        print(command)  # noqa: T201
    if path and plane:
        _draw(path, plane, goal, (start, found.gains), tune_options.settings(options))
        print(path)  # noqa: T201


def _shared(goal: Goal, scheduler: str | None) -> AbstractContextManager[Costs]:
    """Share the goal's loops among the processes that the options select."""
    from barc_sim.tuning import workers  # noqa: PLC0415

    if scheduler:
        return workers.cluster(goal, scheduler)
    return workers.processes(goal) if goal.new_controller else nullcontext(goal)


def _draw(
    path: Path, plane: Surface, goal: Goal, gains: tuple[Floats, Floats], settings: str
) -> None:
    from barc_sim.figures import output  # noqa: PLC0415
    from barc_sim.figures.tuning_figure import Point, tuning_figure  # noqa: PLC0415

    start, found = (Point(each, goal.log(goal.courses[0], each)) for each in gains)
    figure = tuning_figure(
        plane,
        start,
        found,
        cost=goal.cost.label,
        title=f'Gains for the least {goal.cost}',
        settings=settings,
    )
    with output.replacing(path) as part:
        figure.savefig(part, dpi=DPI)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = tune_options.parse(PROG, argv)
    return call(PROG, lambda: tune(options))


if __name__ == '__main__':
    sys.exit(main())
