"""A ride, state by state: the quantities to mirror, and the path so far (without ROS)."""

from __future__ import annotations

from math import hypot
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.nodes.mirrors.car import (
    WHEELS,
    Acceleration,
    Pose,
    Wheel,
    acceleration,
    is_continuous,
    pose,
    wheels,
)

if TYPE_CHECKING:
    from barc_sim.vehicle.bike_model import Motion, Vehicle
    from barc_sim.vehicle.road import Road

_NANOSECONDS = 1e9


class MirroredState(NamedTuple):
    """The quantities of one state that mirrors publish."""

    stamp: int  #: [ns]
    pose: Pose
    motion: Motion
    acceleration: Acceleration
    wheels: tuple[Wheel, ...]
    rolled: tuple[float, ...]  #: [rad] rolling angle of each wheel since the start
    is_first: bool  #: whether the ride starts here


class Ride:
    """Follows a car from state to state; a jump of the car starts a new ride.

    Examples
    --------
    >>> from barc_sim.vehicle.bike_model import Motion, Vehicle
    >>> from barc_sim.vehicle.road import Road
    >>> ride, start = Ride(Road.named('lab'), Vehicle()), Motion(0.0, 0.0, 0.0, 8.0, 0.0, 0.0)
    >>> _ = ride.update(0, start, servo=0.0)
    >>> state = ride.update(20_000_000, start._replace(x=0.16, v_x=8.04), servo=0.0)
    >>> round(state.acceleration.x, 3)
    2.0
    """

    def __init__(self, road: Road, vehicle: Vehicle) -> None:
        """Follow a car with the axles of `vehicle` on `road`."""
        self._road = road
        self._vehicle = vehicle
        self._last: MirroredState | None = None

    def update(self, stamp: int, motion: Motion, servo: float) -> MirroredState:
        """Return the quantities of the next state, at `stamp` [ns], steered by `servo` [rad]."""
        last = self._last
        dt = (stamp - last.stamp) / _NANOSECONDS if last else 0.0
        if last and not is_continuous(last.motion, motion, dt):
            last = None
        self._last = MirroredState(
            stamp=stamp,
            pose=pose(motion, self._road),
            motion=motion,
            acceleration=acceleration(last.motion, motion, dt) if last else Acceleration(),
            wheels=wheels(motion, servo, self._vehicle),
            rolled=_roll(last, dt) if last else (0.0,) * len(WHEELS),
            is_first=last is None,
        )
        return self._last


def _roll(last: MirroredState, dt: float) -> tuple[float, ...]:
    """Return the rolling angles `dt` seconds later; each wheel keeps its speed meanwhile."""
    return tuple(
        rolled + wheel.speed * dt for rolled, wheel in zip(last.rolled, last.wheels, strict=True)
    )


class Trail:
    """The path so far, in at most `limit` poses: when it is full, every other pose is dropped.

    Attributes
    ----------
    poses
        In the order of driving, each with its stamp [ns].
    spacing
        [m] between two of them.

    Examples
    --------
    >>> from barc_sim.vehicle.bike_model import Motion, Vehicle
    >>> from barc_sim.vehicle.road import Road
    >>> ride, trail = Ride(Road.named('lab'), Vehicle()), Trail()
    >>> for k in range(1152):
    ...     motion = Motion(0.16 * k, 0.0, 0.0, 8.0, 0.0, 0.0)
    ...     trail.add(ride.update(20_000_000 * k, motion, servo=0.0))
    >>> len(trail.poses), trail.spacing
    (151, 1.0)
    """

    def __init__(self, limit: int = 200, spacing: float = 0.5) -> None:
        """Begin with no pose; `limit` is at least 2."""
        self.poses: list[tuple[int, Pose]] = []
        self.spacing = self._finest = spacing
        self._limit = limit

    def add(self, state: MirroredState) -> None:
        """Add the pose of a state, unless it is too close to the last one."""
        if state.is_first:
            self.poses.clear()
            self.spacing = self._finest
        here = state.pose
        if self.poses:
            last = self.poses[-1][1]
            if hypot(here.x - last.x, here.y - last.y, here.z - last.z) < self.spacing:
                return
        if len(self.poses) == self._limit:
            del self.poses[1::2]
            self.spacing *= 2.0
        self.poses.append((state.stamp, here))
