"""What a search minimises: a cost made of the scores of closed loops, which `sweep` returns."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.control.pid import ACCELERATION_LIMIT, KD, KI, KP, SPEED_REFERENCE, speed_controller
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import DISTANCE
from barc_sim.simulation.metrics import summary
from barc_sim.tuning.batch import Course, run_batch
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable
    from os import PathLike

    from numpy.typing import ArrayLike, NDArray

    from barc_sim.control.controller import Controller
    from barc_sim.simulation.log import Log
    from barc_sim.tuning.batch import Sums

    Floats = NDArray[np.float64]

_TERM = re.compile(r'(?:(?P<weight>[^*]+)\*)?(?P<name>[^*]+)')


class Scores(NamedTuple):
    """How well loops did, shape `(n,)` each; infinite for those that never arrived."""

    rms: Floats  #: [m/s] RMS speed error after the run-up
    max: Floats  #: [m/s] maximum absolute one
    overshoot: Floats  #: share of the reference by which the first stretch's speed passes it
    effort: Floats  #: [m/s²] RMS of the command, over the whole run


#: Their labels, in their order.
LABELS = (
    'RMS speed error [m/s]',
    'Maximum speed error [m/s]',
    'Overshoot',
    'RMS command [m/s²]',
)


def scores(course: Course, sums: Sums) -> Scores:
    """Return the scores of loops over `course` with these sums."""
    arrived = sums.steps >= 0

    def where_arrived(values: Floats) -> Floats:
        return np.where(arrived, values, np.inf)

    with np.errstate(divide='ignore', invalid='ignore'):
        return Scores(
            rms=where_arrived(np.sqrt(sums.squares / sums.count)),
            max=where_arrived(sums.maximum),
            overshoot=where_arrived(np.maximum(sums.peak / course.speed - 1.0, 0.0)),
            effort=where_arrived(np.sqrt(sums.effort / (sums.steps + 1))),
        )


@dataclass(frozen=True)
class Cost:
    """A weighted sum of scores."""

    weights: tuple[float, float, float, float]  #: in the order of `Scores`
    text: str

    @classmethod
    def parse(cls, text: str) -> Cost:
        """Return the cost written as `rms`, or as a sum such as `rms+0.01*effort`."""
        weights = dict.fromkeys(Scores._fields, 0.0)
        # The plus of an exponent, as in 1e+3, separates no terms.
        for term in re.split(r'(?<![eE])\+', ''.join(text.split())):
            match = _TERM.fullmatch(term)
            if not match or match['name'] not in weights:
                *others, last = Scores._fields
                raise UserError(
                    f'term {term!r} of cost {text!r} must be one of {", ".join(others)} or {last}, '
                    'or a number times that, such as 0.01*effort'
                )
            weights[match['name']] += _weight(match['weight'] or '1', text)
        return cls(tuple(weights.values()), text)  # type: ignore[arg-type]

    def of(self, scored: Scores) -> Floats:
        """Return what each loop costs, shape `(n,)`."""
        weighted = zip(self.weights, scored, strict=True)
        # A weight of zero times an infinite score would be NaN.
        terms = [weight * score for weight, score in weighted if weight]
        return np.asarray(np.sum(terms, axis=0))

    @property
    def label(self) -> str:
        """The label of an axis with this cost."""
        if sorted(self.weights) != [0.0, 0.0, 0.0, 1.0]:
            return f'Cost: {self.text}'
        return LABELS[self.weights.index(1.0)]

    def __str__(self) -> str:
        """Return the text that it was parsed from."""
        return self.text


def _weight(text: str, cost: str) -> float:
    try:
        weight = float(text)
    except ValueError:
        weight = 0.0
    if not (isfinite(weight) and weight > 0.0):
        raise UserError(f'weight {text!r} in cost {cost!r} must be a positive number')
    return weight


@dataclass(frozen=True)
class Goal:
    """The mean cost over courses; a call with gains returns what each costs.

    It can be pickled for other processes, if `new_controller` can.
    """

    courses: tuple[Course, ...]
    cost: Cost
    #: Makes a controller with the gains kp, ki and kd; without it, the PID drives.
    new_controller: Callable[[], Controller] | None = None

    def scores(self, course: Course, gains: Floats) -> Scores:
        """Return the scores over `course` for `gains`, shape `(n, 3)`: kp, ki, kd."""
        if not self.new_controller:
            return scores(course, run_batch(course, gains))
        controller = self.new_controller()
        rows = [_scored(course, _drive(course, controller, each)) for each in gains]
        return Scores(*np.array(rows).reshape(-1, len(Scores._fields)).T)

    def __call__(self, gains: Floats) -> Floats:
        """Return what each of `gains`, shape `(n, 3)`, costs, shape `(n,)`."""
        costs = [self.cost.of(self.scores(course, gains)) for course in self.courses]
        return np.asarray(np.mean(costs, axis=0))

    def log(self, course: Course, gains: Floats) -> Log:
        """Return the run over `course` with `gains`, shape `(3,)`."""
        new = self.new_controller or speed_controller
        return _drive(course, new(), gains)


def _drive(course: Course, controller: Controller, gains: Floats) -> Log:
    """Return the run of a controller with these gains, from its beginning."""
    for name, gain in zip(('kp', 'ki', 'kd'), gains.tolist(), strict=True):
        setattr(controller, name, gain)
    controller.output_min, controller.output_max = -course.limit, course.limit
    controller.reset()
    return course.drive(controller)


def _scored(course: Course, log: Log) -> tuple[float, float, float, float]:
    """Return the scores of one run over `course`."""
    if not log.distance[-1] >= course.distance:
        return (np.inf,) * 4
    found = summary(log)
    effort = float(np.sqrt(np.mean(np.square(log.motor))))
    return found.rms_error_after_run_up, found.max_error_after_run_up, found.overshoot, effort


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
    found = scores(course, run_batch(course, np.column_stack([gain.ravel() for gain in gains])))
    names = ('kp', 'ki', 'kd', 'rms_error', 'max_error', 'overshoot', 'effort')
    columns = dict(zip(names, (*gains, *found), strict=True))
    record = np.recarray(gains[0].shape, dtype=[(name, np.float64) for name in columns])
    for name, values in columns.items():
        record[name] = values.reshape(record.shape)
    return record
