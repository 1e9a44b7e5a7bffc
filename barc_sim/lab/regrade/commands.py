"""Compares the recorded commands with those of a controller for the recorded speeds."""

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
    """The method of a controller that is used here."""

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
    """Give a controller the recorded speeds; its commands are limited to ±`limit` [m/s²].

    With `subtract_error` it gets the true speeds. It is replaced by a new one at states `resets`.

    Examples
    --------
    >>> from barc_sim import PID, simulate
    >>> log = simulate(2.0, 0.0, 0.0)
    >>> judge(log, lambda: PID(2.0, 0.0, 0.0), 'controller.py', limit=8.0).possible
    True
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
                continue  # there was no command, or it was not recorded
            # As the node computes it, from stamps in whole nanoseconds.
            dt = FIRST_DT if previous is None else (round(t * 1e9) - round(previous * 1e9)) / 1e9
            previous = t
            computed = min(max(controller.acc_calculate(reference, speed, dt), -limit), limit)
            verdict.add(
                deviation(motor, computed),
                f'at {t:.2f} s (state {k}) the command is {motor:.9g} m/s², but {code} '
                f'computes {computed:.9g} for {speed:.9g} m/s: were gains changed during the run?',
            )
    except UserError as error:
        verdict.fail(str(error))
    return verdict
