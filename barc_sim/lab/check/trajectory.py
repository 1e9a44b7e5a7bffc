"""Judges the whole model: a drive over the lab's road with the commands of the reference."""

from __future__ import annotations

from functools import cache
from math import degrees, hypot, isfinite, sin
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.check.code import Row
from barc_sim.lab.check.findings import NOT_A_CAR, Trajectory, judges
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.bike_model import L_F, L_R, Command, State
from barc_sim.vehicle.plant import Plant

if TYPE_CHECKING:
    from barc_sim.lab.check.code import JudgedCode
    from barc_sim.lab.check.equations import Floats
    from barc_sim.lab.check.findings import Judged

#: [m, m, rad, m/s] Above the effect of friction's sign at a standstill, below that of any mistake.
TOLERANCE = 1e-4
_STEERING, _PACE = 0.06, 0.8  #: [rad] and [rad/s] of a slalom


@judges('model.trajectory')
def judge_trajectory(code: JudgedCode) -> Judged:
    """Return the finding on the trajectory; its score is the share of steps near the reference."""
    commands = _commands()
    failure = ''

    def model(*args: float, l_f: float = L_F, l_r: float = L_R, g: float = 0.0) -> list[float]:
        del l_f, l_r, g  # the lab's, which are the function's own
        return list(code.bike_fe([Row(*args)])[0])

    reference, own = (np.full((len(commands), len(State._fields)), np.nan) for _ in range(2))
    _fill(reference, Plant(), commands)
    try:
        _fill(own, Plant(model=model), commands)
    except UserError as error:
        failure = str(error)
    t: Floats = np.arange(len(reference), dtype=np.float64) * Plant().ts
    off: Floats = np.abs(own - reference)
    within = np.all(off <= TOLERANCE, axis=1)
    # The first state is given, not computed.
    score = float(np.mean(within[1:]))
    if failure:
        message = failure
    elif score == 1.0:
        message = f'follows the reference for {t[-1]:.0f} s and {len(t) - 1:,} steps'
    else:
        message = _away(t, off, int(np.flatnonzero(~within)[0]))
    drawn = Trajectory(t, own, reference) if np.isfinite(own[1:]).any() else None
    return score, message, {}, drawn


@cache
def _commands() -> tuple[Command, ...]:
    """Return the commands of the reference's run over the lab's road, and a slalom."""
    log = closed_loop()
    steering = [_STEERING * sin(_PACE * t) for t in log.t.tolist()]
    return tuple(Command(*command) for command in zip(log.motor.tolist(), steering, strict=True))


def _fill(states: Floats, plant: Plant, commands: tuple[Command, ...]) -> None:
    """Write the state before each command, up to the first one beyond all limits."""
    for k, command in enumerate(commands):
        if not np.all(np.abs(plant.state) < NOT_A_CAR):
            return
        states[k] = plant.state
        plant.advance(command)


def _away(t: Floats, off: Floats, first: int) -> str:
    x, y, psi, v = np.nan_to_num(off[-1], nan=np.inf)
    if not isfinite(x):
        return (
            f'leaves the reference after {t[first]:.2f} s, and then grows without limit: beyond '
            f'{NOT_A_CAR:g} it is not a car'
        )
    return (
        f'leaves the reference after {t[first]:.2f} s; at the end of the road it is '
        f'{hypot(x, y):.3g} m, {degrees(psi):.3g}° and {v:.3g} m/s away'
    )
