"""Many gains driven at once, and their scores: for a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.control.pid import ACCELERATION_LIMIT, KD, KI, KP, SPEED_REFERENCE
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import DISTANCE
from barc_sim.tuning import batch
from barc_sim.tuning.cost import scores
from barc_sim.tuning.course import Course
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from os import PathLike

    from numpy.typing import ArrayLike


def sweep(
    kp: ArrayLike = KP,
    ki: ArrayLike = KI,
    kd: ArrayLike = KD,
    *,
    road: Road | str | PathLike[str] = 'lab',
    vehicle: Vehicle | None = None,
    noise: float = 0.0,
    delay: float = 0.0,
    speed_reference: float = SPEED_REFERENCE,
    distance: float = DISTANCE,
    seed: int = 0,
    acceleration_limit: float = ACCELERATION_LIMIT,
    ts: float = 0.02,
) -> np.recarray:
    """Drive one closed loop for each of the gains, and return the scores of all.

    Each is the run that `simulate` makes with the same arguments.

    Parameters
    ----------
    kp, ki, kd
        Numbers or arrays of gains, broadcast against one another.
    road, vehicle, speed_reference, distance, seed, acceleration_limit, ts
        As in `simulate`.
    noise
        [m/s] standard deviation of the measured speed.
    delay
        [s] from a command to its effect, a multiple of `ts`.

    Returns
    -------
    A record array of the broadcast shape. Its fields are the gains `kp`, `ki`, `kd` and the scores
    `rms_error` and `max_error`, of the speed after the first 10 m [m/s], `overshoot`, a share of
    the speed, and `effort`, the RMS command [m/s²]. The scores of a loop that never arrives are
    infinite.

    Raises
    ------
    UserError
        where the road cannot be read, or the delay is not a multiple of `ts`.

    Examples
    --------
    >>> import numpy as np
    >>> found = sweep(kp=np.linspace(1.0, 60.0, 200), ki=20.0, kd=0.0)
    >>> best = found[found.rms_error.argmin()]
    >>> print(f'{best.kp:.1f} {best.rms_error:.3f}')
    60.0 0.037
    """
    steps = round(delay / ts)
    if abs(steps * ts - delay) > 1e-6 * ts:
        raise UserError(f'delay {delay!r} s must be a multiple of the step, {ts!r} s')
    course = Course(
        road=road if isinstance(road, Road) else Road.named(str(road)),
        speed=speed_reference,
        distance=distance,
        noise=noise,
        seed=seed,
        delay=steps,
        limit=acceleration_limit,
        vehicle=vehicle or Vehicle(),
        ts=ts,
    )
    gains = np.broadcast_arrays(*(np.asarray(gain, dtype=np.float64) for gain in (kp, ki, kd)))
    found = scores(course, batch.drive(course, np.column_stack([gain.ravel() for gain in gains])))
    names = ('kp', 'ki', 'kd', 'rms_error', 'max_error', 'overshoot', 'effort')
    columns = dict(zip(names, (*gains, *found), strict=True))
    record = np.recarray(gains[0].shape, dtype=[(name, np.float64) for name in columns])
    for name, values in columns.items():
        record[name] = values.reshape(record.shape)
    return record
