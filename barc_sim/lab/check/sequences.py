"""Seeded sequences of speeds for a controller, small enough to stay within its limits."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.lab.check.situations import TS

if TYPE_CHECKING:
    from barc_sim.lab.check.code import Sample
    from barc_sim.lab.check.equations import Floats

LENGTH = 120


@dataclass(frozen=True, eq=False)
class Sequence:
    """What a controller is asked, one sample every `TS`; arrays of shape `(n,)`."""

    reference: Floats  #: [m/s]
    measured: Floats  #: [m/s]

    @property
    def error(self) -> Floats:
        """Reference minus measured [m/s]."""
        return self.reference - self.measured

    @property
    def rows(self) -> list[Sample]:
        """The arguments of each call."""
        pairs = zip(self.reference.tolist(), self.measured.tolist(), strict=True)
        return [(reference, measured, TS) for reference, measured in pairs]


def wandering(seed: int, name: str, amplitude: float) -> Sequence:
    """Return errors of either sign up to `amplitude` [m/s], about a reference that changes."""
    uniform = Random(f'{seed} {name}').uniform  # noqa: S311 (a simulation, not a secret)
    error = np.array([uniform(-1.0, 1.0) for _ in range(LENGTH)])
    error[40:60] = uniform(0.5, 1.0)  # the same error for a while
    steps = [uniform(-0.5, 0.5) for _ in range(4)]
    reference = 8.0 + amplitude * np.repeat(steps, LENGTH // 4)
    return Sequence(reference, reference - amplitude * error)


def constant(error: float, count: int) -> Sequence:
    """Return the same `error` [m/s], `count` times."""
    reference = np.full(count, 8.0)
    return Sequence(reference, reference - error)
