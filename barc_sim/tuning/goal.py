"""What a search minimises: a cost made of the scores of closed loops, which `sweep` returns."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.control.controller import gain_parameters
from barc_sim.control.pid import PID, speed_controller
from barc_sim.control.types import as_controller
from barc_sim.errors import UserError
from barc_sim.simulation.log import import_pandas
from barc_sim.simulation.metrics import summary
from barc_sim.tuning.batch import Course, run_batch
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    import pandas as pd
    from numpy.typing import ArrayLike, NDArray

    from barc_sim.control.controller import Controller
    from barc_sim.simulation.log import Log
    from barc_sim.tuning.batch import Sums

    Floats = NDArray[np.float64]


class Scores(NamedTuple):
    """How well loops did, shape `(n,)` each; infinite for those that never arrived."""

    rms: Floats  #: [m/s] RMS speed error after the run-up
    max: Floats  #: [m/s] maximum absolute one
    overshoot: Floats  #: share of the reference by which the first stretch's speed passes it
    effort: Floats  #: [m/s²] RMS of the command, over the whole run


#: The names of the scores in a `Sweep`, in their order.
_GAINS = ('kp', 'ki', 'kd')
_SCORES = ('rms_error', 'max_error', 'overshoot', 'effort')
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
            overshoot=where_arrived(np.maximum(sums.peak / course.speed_reference - 1.0, 0.0)),
            effort=where_arrived(np.sqrt(sums.effort / (sums.steps + 1))),
        )


class Cost(NamedTuple):
    """A score, and a weight of the effort beside it."""

    score: str = 'rms'  #: one of `Scores`
    effort: float = 0.0  #: weight

    def of(self, scored: Scores) -> Floats:
        """Return what each loop costs, shape `(n,)`."""
        cost: Floats = getattr(scored, self.score)
        # A weight of zero times an infinite score would be NaN.
        return cost + self.effort * scored.effort if self.effort else cost

    @property
    def label(self) -> str:
        """The label of an axis with this cost."""
        return f'Cost: {self}' if self.effort else LABELS[Scores._fields.index(self.score)]

    def __str__(self) -> str:
        """Return the sum in a line."""
        return f'{self.score} + {self.effort:g} effort' if self.effort else self.score


@dataclass(frozen=True)
class Goal:
    """The mean cost over courses; a call with gains returns what each costs."""

    courses: tuple[Course, ...]
    cost: Cost
    #: Makes a controller with the gains kp, ki and kd; without it, the PID drives.
    new_controller: Callable[[], Controller] | None = None

    def scores(self, course: Course, gains: Floats) -> Scores:
        """Return the scores over `course` for `gains`, shape `(n, 3)`: kp, ki, kd."""
        if not self.new_controller:
            return scores(course, run_batch(course, gains))
        return scores_of_runs(course, self.new_controller(), _GAINS, gains)

    def __call__(self, gains: Floats) -> Floats:
        """Return what each of `gains`, shape `(n, 3)`, costs, shape `(n,)`."""
        costs = [self.cost.of(self.scores(course, gains)) for course in self.courses]
        return np.asarray(np.mean(costs, axis=0))

    def log(self, course: Course, gains: Floats) -> Log:
        """Return the run over `course` with `gains`, shape `(3,)`."""
        new = self.new_controller or speed_controller
        return course.drive(with_gains(new(), _GAINS, gains))


def with_gains(controller: Controller, names: Iterable[str], gains: Floats) -> Controller:
    """Return `controller` with these gains."""
    for name, gain in zip(names, gains.tolist(), strict=True):
        setattr(controller, name, gain)
    return controller


def scores_of_runs(
    course: Course,
    controller: Controller,
    names: Iterable[str],
    gains: Floats,
    **options: Any,  # noqa: ANN401 (of `simulate`)
) -> Scores:
    """Return the scores of runs one by one, of `controller` with each row of `gains`."""
    rows = []
    for row in gains:
        log = course.drive(with_gains(controller, names, row), **options)
        rows.append(_scored(log) if log.distance[-1] >= course.distance else (np.inf,) * 4)
    return Scores(*np.array(rows).reshape(-1, len(Scores._fields)).T)


def _scored(log: Log) -> tuple[float, float, float, float]:
    """Return the scores of a run that has arrived."""
    found = summary(log)
    effort = float(np.sqrt(np.mean(np.square(log.motor))))
    return found.rms_error_after_run_up, found.max_error_after_run_up, found.overshoot, effort


class Sweep(np.recarray):
    """The scores of many loops, by the names of gains and scores; as many as there are gains."""

    def to_frame(self) -> pd.DataFrame:
        """Return a DataFrame with a row for each loop; needs pandas."""
        frame: pd.DataFrame = import_pandas().DataFrame(
            {n: self[n].ravel() for n in self.dtype.names or ()}
        )
        return frame


def sweep(
    kp: ArrayLike | None = None,
    ki: ArrayLike | None = None,
    kd: ArrayLike | None = None,
    *,
    controller: object | None = None,
    **options: Any,  # noqa: ANN401 (of `simulate`)
) -> Sweep:
    """Drive one closed loop for each of the gains, and return the scores of all.

    Each is the run that `simulate` makes with the same arguments. Loops of the PID whose delay is
    a multiple of the step are driven all at once: 10,000 take some seconds.

    Parameters
    ----------
    kp, ki, kd
        Numbers or arrays of gains, broadcast against one another; those of `acc` where not given.
    controller
        An object as in `simulate`, in the place of the PID. Its gains, by name, are options.
    options
        All other arguments of `simulate`. A loop ends after `max_duration`, by default three times
        as long as it should take.

    Returns
    -------
    A record array of the broadcast shape. Its fields are the gains and the scores: `rms_error` and
    `max_error`, of the speed after the first 10 m [m/s], `overshoot`, a share of the speed, and
    `effort`, the RMS command [m/s²]. The scores of a loop that never arrives are infinite.

    Raises
    ------
    UserError
        where an argument is out of its limits, as in `simulate`.

    Examples
    --------
    >>> import numpy as np
    >>> found = sweep(kp=np.linspace(1.0, 60.0, 200), ki=20.0, kd=0.0)
    >>> best = found[found.rms_error.argmin()]
    >>> print(f'{best.kp:.1f} {best.rms_error:.3f}')
    60.0 0.037
    """
    drives = PID() if controller is None else deepcopy(as_controller(controller))
    given = {'kp': kp, 'ki': ki, 'kd': kd} | {
        name: options.pop(name) for name in drives.gains if name in options
    }
    axes = _axes(drives, {name: gain for name, gain in given.items() if gain is not None})
    options['road'] = Road.of(options.get('road', 'lab'))
    of_course = {
        each.name: options.pop(each.name) for each in fields(Course) if each.name in options
    }
    course = Course(**of_course)
    rows = np.column_stack([axis.ravel() for axis in axes.values()])
    if controller is None and not options and course.is_batchable:
        found = scores(course, run_batch(course, rows))
    else:
        found = scores_of_runs(course, drives, axes, rows, **options)
    columns = axes | dict(zip(_SCORES, found, strict=True))
    shape = next(iter(axes.values())).shape
    record = np.recarray(shape, dtype=[(name, np.float64) for name in columns]).view(Sweep)
    for name, column in columns.items():
        record[name] = column.reshape(shape)
    return record


def _axes(controller: Controller, given: Mapping[str, ArrayLike]) -> dict[str, Floats]:
    """Return all gains of `controller`, in the broadcast shape, with those that are `given`."""
    axes = {}
    for row in gain_parameters(controller):
        axes[row.name] = np.asarray(given.get(row.name, row.default), dtype=np.float64)
        for bound in (axes[row.name].min(), axes[row.name].max()):
            row.check(bound)
    if unknown := ', '.join(given.keys() - axes.keys()):
        raise UserError(f'{unknown}: the controller has no such gain, but {", ".join(axes)}')
    return dict(zip(axes, np.broadcast_arrays(*axes.values()), strict=True))
