"""Compares the recorded states with those of a model for the recorded commands."""

from __future__ import annotations

import copy
from math import copysign, hypot, isfinite
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.errors import UserError
from barc_sim.figures.style import use_measurement
from barc_sim.lab.regrade.verdict import TOLERANCE, Verdict, deviation
from barc_sim.vehicle.bike_model import Command, Motion, State

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from barc_sim.simulation.log import Log
    from barc_sim.vehicle.plant import Plant

#: [steps] More than this between two stamps is a gap in the recording.
_GAP = 1.5


class _Row(NamedTuple):
    """A recorded state."""

    t: float
    measured: Motion
    true: Motion  #: measured minus error, up to rounding
    command: Command  #: the answer to it; NaN if there is none
    certain: bool  #: whether the next step used that command


def judge(
    log: Log,
    new_plant: Callable[[], Plant],
    code: str,
    *,
    placements: int = 0,
    braking: float | None = None,
) -> tuple[Verdict, set[int]]:
    """Drive a plant by the recorded commands.

    After a missed deadline, or with unsynchronised commands, the step used one of the commands
    around it; `braking` [m/s²] is the deceleration without any command. After a state that
    deviates, the plant continues from the recorded one.

    Returns
    -------
    verdict
        On all states.
    resets
        The states at which the car was reset.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> from barc_sim.vehicle.plant import Plant
    >>> verdict, resets = judge(simulate(), Plant, 'bike_model.py')
    >>> print(verdict.possible, verdict.greatest)
    True 0.0
    """
    verdict = Verdict('model', code)
    resets: set[int] = set()
    rows = list(_rows(log))
    plant = new_plant()
    anchored = False
    for k, row in enumerate(rows):
        if k:
            try:
                plant = _follow(plant, rows, k, braking)
            except UserError as error:
                verdict.fail(str(error))
                return verdict, resets
            anchored = row.t - rows[k - 1].t > _GAP * plant.ts
        off, message = _compare(plant, row, k, code)
        if off > TOLERANCE and k and _at_start(row):
            plant = new_plant()
            resets.add(k)
            off, message = _compare(plant, row, k, code)
        elif off > TOLERANCE and _at_rest(row) and verdict.placements < placements:
            verdict.placements += 1
            plant.place(_state(row))
            continue
        elif off > TOLERANCE and (anchored or not k):
            verdict.gaps += 1
            plant.state = _state(row)
            continue
        verdict.add(off, message)
        if off > TOLERANCE:
            plant.state = _state(row)
    verdict.resets = len(resets)
    return verdict, resets


def _rows(log: Log) -> Iterator[_Row]:
    measured = (log.x, log.y, log.psi, log.v_x, log.v_y, log.psi_dot)
    log = use_measurement(log)
    true = (
        log.distance,
        log.across,
        log.psi - log.e_epsi,
        log.v_x - log.e_v_x,
        log.v_y - log.e_v_y,
        log.psi_dot - log.e_psi_dot,
    )
    certain = ~log.missed & (log.reference == log.reference)
    columns = [column.tolist() for column in (log.t, *measured, *true, log.motor, log.servo)]
    for t, *values in zip(*columns, certain.tolist(), strict=True):
        yield _Row(
            t, Motion(*values[:6]), Motion(*values[6:12]), Command(*values[12:14]), values[14]
        )


def _follow(plant: Plant, rows: list[_Row], k: int, braking: float | None) -> Plant:
    """Return the plant one step later, by the command that led to state `k`."""
    before = rows[k - 1]
    if before.certain and _finite(before.command):
        plant.advance(before.command)
        return plant
    around = [rows[j].command for j in (k - 2, k - 1, k) if j >= 0]
    trials = []
    for command in [before.command, None, *around]:
        if command is None or _finite(command):
            trials.append(copy.deepcopy(plant))
            trials[-1].advance(command)
            if _off(trials[-1], rows[k]) <= TOLERANCE:
                return trials[-1]
    if braking is not None:
        trials.append(copy.deepcopy(plant))
        trials[-1].brake(braking)
    return min(trials, key=lambda trial: _off(trial, rows[k]))


def _finite(command: Command) -> bool:
    return isfinite(command.motor) and isfinite(command.servo)


def _off(plant: Plant, row: _Row) -> float:
    return _compare(copy.deepcopy(plant), row, 0, '')[0]


def _compare(plant: Plant, row: _Row, k: int, code: str) -> tuple[float, str]:
    """Return the deviation of the plant from a recorded state, as a number and a sentence."""
    seen = plant.observe()
    if seen.measured == row.measured:
        return 0.0, ''
    offs = [deviation(found, made) for found, made in zip(row.true, seen.true, strict=True)]
    worst = offs.index(max(offs))
    return offs[worst], (
        f'at {row.t:.2f} s (state {k}) {Motion._fields[worst]} is {row.true[worst]:.9g}, but '
        f'{code} computes {seen.true[worst]:.9g} from the state before: were parameters of '
        'the car changed during the run?'
    )


def _at_start(row: _Row) -> bool:
    return all(abs(value) <= TOLERANCE for value in row.true)


def _at_rest(row: _Row) -> bool:
    return all(abs(value) <= TOLERANCE for value in row.true[3:])


def _state(row: _Row) -> State:
    x, y, psi, v_x, v_y, _ = row.true
    return State(x, y, psi, copysign(hypot(v_x, v_y), v_x))
