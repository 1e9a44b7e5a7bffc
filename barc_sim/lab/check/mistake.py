"""A mistake that is made with the model's equations, and kinds of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from barc_sim.lab.check.equations import Changes


class Mistake(NamedTuple):
    """A way to get an equation wrong."""

    says: str  #: what to look at
    changes: Changes


def zero(name: str) -> Changes:
    """Return what leaves out a quantity."""
    return {name: lambda q: np.zeros_like(q.v)}


def own(name: str, value: float) -> Changes:
    """Return what has a value of its own for a quantity."""
    return {name: lambda q: np.full_like(q.v, value)}


def in_degrees(name: str) -> list[Mistake]:
    """Return what goes wrong with the unit of an angle."""
    return [
        Mistake(
            f'{name} arrives in radians: is it taken for degrees and converted once more?',
            {name: lambda q: np.radians(q.given[name])},
        ),
        Mistake(
            f'{name} is in degrees where sin, cos and tan take radians: it arrives in radians',
            {name: lambda q: np.degrees(q.given[name])},
        ),
    ]
