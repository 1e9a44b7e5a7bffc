"""Records, and a class that has some: the tests of `positions` read them."""

from __future__ import annotations

from typing import NamedTuple


class Pose(NamedTuple):
    """A place in the plane."""

    x: float
    y: float


class Place(NamedTuple):
    """A record with a record in it."""

    pose: Pose


class Track:
    """A class with records as attribute, as result and in a property."""

    start: Pose

    def place(self, s: float) -> Pose:
        """Return the place at `s`."""
        return Pose(s, 0.0)

    @property
    def poses(self) -> list[Pose]:
        """Return all places."""
        return [self.start]
