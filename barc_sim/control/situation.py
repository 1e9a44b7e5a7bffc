"""The situation of a car, which a pilot answers with a command, and how it follows from a state."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from barc_sim.errors import UserError
from barc_sim.vehicle.track import Pose, locate

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.interfaces.records import VehicleState
    from barc_sim.vehicle.road import Signal
    from barc_sim.vehicle.track import Frenet, Track


class Gap(NamedTuple):
    """The gap to the car ahead."""

    distance: float  #: [m]
    rate: float  #: [m/s] at which it grows


class Situation(NamedTuple):
    """All that a pilot decides on."""

    t: float  #: [s] since the start
    dt: float  #: [s] since the situation before
    measured: VehicleState
    reference: float  #: [m/s] speed to hold
    track: Track | None = None
    place: Frenet | None = None  #: measured, on the track
    gap: Gap | None = None  #: None: there is no car ahead

    @property
    def along(self) -> float:
        """The measured position [m] along the track, or the road."""
        return self.measured.x if self.place is None else self.place.s

    def on_track(self) -> tuple[Track, Frenet]:
        """Return the track, and the place on it; UserError: there is none."""
        if self.track is None or self.place is None:
            raise UserError('this pilot steers along a track: give one, such as track="L"')
        return self.track, self.place


class Navigator:
    """Makes situations of measured motions: follows the car along its track, if there is one."""

    def __init__(self, track: Track | None = None) -> None:
        """Begin at the start of the track."""
        self.track = track
        self.reset()

    def reset(self) -> None:
        """Return to the start of the track."""
        self._s = 0.0  # [m] of the latest place
        self._segment = 0  # of the track

    def situation(
        self, t: float, dt: float, measured: VehicleState, reference: Signal
    ) -> Situation:
        """Return the situation at `t` [s], `dt` [s] after the one before.

        `reference` returns the speed to hold [m/s] at a time and a position.
        """
        track = self.track
        if track is None:
            return Situation(t, dt, measured, reference(t, measured.x))
        pose = Pose(measured.x, measured.y, measured.psi)
        place, self._segment = locate(track.line, track.width, pose, self._s, self._segment)
        self._s = place.s
        return Situation(t, dt, measured, reference(t, place.s), track, place)

    def poses(self, plan: NDArray[np.float64]) -> Pose:
        """Return the poses of a plan from the latest place on: distance ahead and e_y [m]."""
        assert self.track  # noqa: S101 (there is no plan without one)
        return self.track.place(self._s + plan[:, 0], plan[:, 1])
