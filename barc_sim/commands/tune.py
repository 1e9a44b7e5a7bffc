"""Searches the gains that hold the speed best."""

from __future__ import annotations

import time
from contextlib import nullcontext
from functools import partial
from typing import TYPE_CHECKING

from barc_sim.cli.files import saving, target
from barc_sim.errors import UserError
from barc_sim.tuning import command_line

if TYPE_CHECKING:
    from argparse import Namespace
    from contextlib import AbstractContextManager
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.tuning.goal import Goal
    from barc_sim.tuning.search import Surface
    from barc_sim.tuning.workers import Costs

    Floats = NDArray[np.float64]

add_arguments = command_line.add_arguments
FORMATS = ('png', 'pdf', 'svg')
DPI = 150
#: Population, generations and points along a side of the map: for the PID, whose loops run as one
#: batch, and for user code, whose loops run one by one.
_BATCHED = (256, 80, 101)
_USER_CODE = (24, 40, 25)


def run(options: Namespace) -> None:
    """Search, and print the gains with the lines to run them."""
    import numpy as np  # noqa: PLC0415 (slow: not for --help)

    from barc_sim.lab.user_code.adapters import controller_of  # noqa: PLC0415
    from barc_sim.tuning import search  # noqa: PLC0415

    began = time.monotonic()
    path = target(options.save, FORMATS) if options.save is not None else None
    low, high = command_line.ranges(options)
    if path:
        search.free_axes(low, high)
    start = np.array([getattr(options, gain) for gain in command_line.GAINS])
    goal = command_line.goal(
        options, partial(controller_of, options.controller) if options.controller else None
    )
    goal(start[np.newaxis])  # a mistake in the controller is reported from here
    population, generations, points = _USER_CODE if options.controller else _BATCHED
    with _distributed(goal) as cost, command_line.progress(generations) as show:
        best = search.search(
            cost,
            low,
            high,
            start,
            seed=options.seed,
            population=population,
            generations=generations,
            on_generation=show,
        )
        if not np.isfinite(best.cost):
            raise UserError(
                f'no gains in these ranges drive {options.distance:g} m within '
                f'{goal.courses[0].max_duration:.0f} s on every road: widen the ranges, or choose '
                'roads that the car can climb'
            )
        took = time.monotonic() - began
        plane = search.surface(cost, low, high, start, best.gains, points) if path else None
    for course in goal.courses:
        command_line.print_scores(goal, course, {'start': start, 'found': best.gains})
    print(f'{best.evaluations} closed loops per road in {took:.1f} s; to run it:')  # noqa: T201
    for command in command_line.commands(options, best.gains.tolist()):
        print(command)  # noqa: T201
    if path and plane:
        _draw(path, plane, goal, (start, best.gains), command_line.settings(options))
        print(path)  # noqa: T201


def _distributed(goal: Goal) -> AbstractContextManager[Costs]:
    """Give the goal, evaluated here, or for user code in worker processes."""
    from barc_sim.tuning import workers  # noqa: PLC0415

    return workers.processes(goal) if goal.new_controller else nullcontext(goal)


def _draw(
    path: Path, plane: Surface, goal: Goal, gains: tuple[Floats, Floats], settings: str
) -> None:
    from barc_sim.figures.tuning_figure import Point, tuning_figure  # noqa: PLC0415

    start, best = (Point(each, goal.log(goal.courses[0], each)) for each in gains)
    figure = tuning_figure(
        plane,
        start,
        best,
        cost=goal.cost.label,
        title=f'Gains for the minimum {goal.cost}',
        settings=settings,
    )
    with saving(path) as part:
        figure.savefig(part, dpi=DPI)
