"""A ride, state by state: what the mirrors show of the present one, and the way so far (pure)."""

from __future__ import annotations

from math import hypot
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.nodes.mirrors.car import (
    WHEELS,
    Acceleration,
    Pose,
    Wheel,
    acceleration,
    goes_on,
    pose,
    wheels,
)

if TYPE_CHECKING:
    from barc_sim.vehicle.bike_model import Motion, Vehicle
    from barc_sim.vehicle.road import Road

_NANOSECONDS = 1e9


class Seen(NamedTuple):
    """What there is to show of one state."""

    stamp: int  #: [ns]
    pose: Pose
    motion: Motion
    acceleration: Acceleration
    wheels: tuple[Wheel, ...]
    rolled: tuple[float, ...]  #: [rad] by which each wheel has turned since the start
    begins: bool  #: whether the car starts here


class Ride:
    """Follows a car from state to state; where it jumps, a new ride begins."""

    def __init__(self, road: Road, vehicle: Vehicle) -> None:
        """Follow nothing yet, on `road`, of whose `vehicle` the axles count."""
        self._road = road
        self._vehicle = vehicle
        self._last: Seen | None = None

    def see(self, stamp: int, motion: Motion, servo: float) -> Seen:
        """Return what there is to show of a state, steered by `servo` [rad], at `stamp` [ns]."""
        last = self._last
        dt = (stamp - last.stamp) / _NANOSECONDS if last else 0.0
        if last and not goes_on(last.motion, motion, dt):
            last = None
        self._last = Seen(
            stamp=stamp,
            pose=pose(motion, self._road),
            motion=motion,
            acceleration=acceleration(last.motion, motion, dt) if last else Acceleration(),
            wheels=wheels(motion, servo, self._vehicle),
            rolled=_roll(last, dt) if last else (0.0,) * len(WHEELS),
            begins=last is None,
        )
        return self._last


def _roll(last: Seen, dt: float) -> tuple[float, ...]:
    """Return the wheels' turns after `dt` seconds; each is rolled by the speed at its start."""
    return tuple(
        rolled + wheel.speed * dt for rolled, wheel in zip(last.rolled, last.wheels, strict=True)
    )


class Trail:
    """The way so far, in at most `limit` poses: where it is full, every other one goes.

    Attributes
    ----------
    poses
        In the order of driving, each with its stamp [ns].
    spacing
        [m] between two of them.
    """

    def __init__(self, limit: int = 200, spacing: float = 0.5) -> None:
        """Begin with no pose; `limit` is at least 2."""
        self.poses: list[tuple[int, Pose]] = []
        self.spacing = self._finest = spacing
        self._limit = limit

    def follow(self, seen: Seen) -> bool:
        """Take a state's pose, where it is far enough from the last; return whether it was."""
        if seen.begins:
            self.poses.clear()
            self.spacing = self._finest
        here = seen.pose
        if self.poses:
            last = self.poses[-1][1]
            if hypot(here.x - last.x, here.y - last.y, here.z - last.z) < self.spacing:
                return False
        if len(self.poses) == self._limit:
            del self.poses[1::2]
            self.spacing *= 2.0
        self.poses.append((seen.stamp, here))
        return True
