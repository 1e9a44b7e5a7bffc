"""The cost of a closed loop: a weighted sum of its scores."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from barc_sim.simulation.straight_loop import Result
    from barc_sim.tuning.course import Course

    Floats = NDArray[np.float64]

_TERM = re.compile(r'(?:(?P<weight>[^*]+)\*)?(?P<name>[^*]+)')


class Scores(NamedTuple):
    """How well loops did, shape `(n,)` each; infinite for those that never arrived."""

    rms: Floats  #: [m/s] RMS speed error after the run-up
    max: Floats  #: [m/s] greatest absolute one
    overshoot: Floats  #: share of the reference by which the first stretch's speed passes it
    effort: Floats  #: [m/s²] RMS of the command, over the whole run


#: Their labels, in their order.
LABELS = (
    'RMS speed error [m/s]',
    'Greatest speed error [m/s]',
    'Overshoot',
    'RMS command [m/s²]',
)


def scores(course: Course, result: Result) -> Scores:
    """Return the scores of loops over `course` with these sums.

    Examples
    --------
    >>> from barc_sim.tuning.batch import drive_one
    >>> from barc_sim.tuning.course import Course
    >>> found = scores(Course(), drive_one(Course(), 10.0, 20.0, 0.0))
    >>> print(f'{float(found.rms):.3f} m/s')
    0.113 m/s
    """
    arrived = result.steps >= 0

    def where_arrived(values: Floats) -> Floats:
        return np.where(arrived, values, np.inf)

    with np.errstate(divide='ignore', invalid='ignore'):
        return Scores(
            rms=where_arrived(np.sqrt(result.squares / result.count)),
            max=where_arrived(result.greatest),
            overshoot=where_arrived(np.maximum(result.peak / course.speed - 1.0, 0.0)),
            effort=where_arrived(np.sqrt(result.effort / (result.steps + 1))),
        )


@dataclass(frozen=True)
class Cost:
    """A weighted sum of scores.

    Examples
    --------
    >>> cost = Cost.parse('rms+0.01*effort')
    >>> cost.weights
    (1.0, 0.0, 0.0, 0.01)
    """

    weights: tuple[float, float, float, float]  #: in the order of `Scores`
    text: str

    @classmethod
    def parse(cls, text: str) -> Cost:
        """Return the cost written as `rms`, or as a sum such as `rms+0.01*effort`.

        Raises
        ------
        UserError
            where a term is no score, or a weight no positive number.
        """
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
