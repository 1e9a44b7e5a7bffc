"""Recorded speeds through a controller, to see whether it makes the recorded commands of them."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Protocol

from barc_sim.control.pid import FIRST_DT
from barc_sim.errors import UserError
from barc_sim.lab.regrade.verdict import Verdict, deviation

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from barc_sim.simulation.log import Log


class Controller(Protocol):
    """What makes commands of speeds."""

    def acc_calculate(self, reference: float, current: float, dt: float, /) -> float:
        """Return the acceleration [m/s²]."""


def judge(
    log: Log,
    new: Callable[[], Controller],
    code: str,
    *,
    limit: float,
    subtract_error: bool = False,
    resets: Collection[int] = (),
) -> Verdict:
    """Show a controller the recorded speeds; its commands are cut to ±`limit` [m/s²].

    With `subtract_error` it is shown the true ones. It begins anew at the states `resets`.
    """
    verdict = Verdict('controller', code, resets=len(resets))
    speeds = log.speed if subtract_error else log.v_x
    columns = (log.t, log.reference, speeds, log.motor)
    previous = None
    try:
        controller = new()
        for k, (t, reference, speed, motor) in enumerate(
            zip(*(column.tolist() for column in columns), strict=True)
        ):
            if k in resets:
                controller, previous = new(), None
            if not (isfinite(reference) and isfinite(motor)):
                continue  # it was not asked, or what it said is not known
            # As the node takes it from stamps, which are whole nanoseconds.
            dt = FIRST_DT if previous is None else (round(t * 1e9) - round(previous * 1e9)) / 1e9
            previous = t
            made = min(max(controller.acc_calculate(reference, speed, dt), -limit), limit)
            verdict.add(
                deviation(motor, made),
                f'at {t:.2f} s (state {k}) the command is {motor:.9g} m/s², where {code} makes '
                f'{made:.9g} of a speed of {speed:.9g} m/s: were gains changed while it drove?',
            )
    except UserError as error:
        verdict.fail(str(error))
    return verdict
