"""The record of a run: the plant's options, what decides, the speed to hold, and the end."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from os import PathLike  # noqa: TC003 (`parameters_of` evaluates it)
from typing import Annotated

from barc_sim.control.cruise_control import LIMIT, SPEED, reference_of
from barc_sim.control.lane import LaneController, check_steering_law
from barc_sim.control.pilots import Pilot
from barc_sim.control.speed import ACCELERATION_LIMIT, PID, SPEED_REFERENCE
from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import UNBOUNDED, parameters_of
from barc_sim.vehicle.parameters import PlantOptions, needs_track
from barc_sim.vehicle.road import Profile, Signal
from barc_sim.vehicle.track import Track


@dataclass(frozen=True, kw_only=True, repr=False)
class Scenario(PlantOptions):
    """A run as a value: `simulate(scenario=…)` drives it.

    The fields have the names, the defaults and the limits of the arguments of `simulate`, which
    describes them. In addition, `motor` and `servo` are the actuators, and `laps` ends a run on a
    track. The first of the ends counts: `laps`, `distance` or `max_duration`. With 0 laps, the
    default, a track has no end of its own, as a road never has; with 1, its end is the finish line.
    (`barc acc` and the node `vehicle_simulator` drive one lap by default; on a road a lap ends at
    `distance`.) A scenario never changes: `dataclasses.replace` makes another one.

    Raises
    ------
    UserError
        if a field is out of its limits, a file cannot be read, or fields contradict one another.

    Examples
    --------
    >>> from dataclasses import replace
    >>> calm = Scenario(track='oval', laps=1, distance=0.0, speed_reference=5.0)
    >>> windy = replace(calm, disturbance=-900.0)
    >>> windy == calm, windy.changes().keys() - calm.changes().keys()
    (False, {'disturbance'})
    """

    kp: float | None = None
    ki: float | None = None
    kd: float | None = None
    controller: object | None = None
    acceleration_limit: Annotated[float, LIMIT] = ACCELERATION_LIMIT
    lane: LaneController | Pilot | None = None
    speed_reference: Annotated[float, SPEED] = SPEED_REFERENCE
    reference: str | PathLike[str] | Signal | None = None
    distance: Annotated[
        float, 'where each lap of a road ends, or a run on a track [m]; 0: nowhere', 0.0, 1e6
    ] = 180.0
    laps: Annotated[
        int,
        'number of laps after which a run ends, on a track without a stop between them; 0: the run '
        'ends at no lap',
        0,
        10**6,
    ] = 0
    max_duration: Annotated[float, 'simulated time [s]', 0.0, 1e5] = 600.0

    def __post_init__(self) -> None:
        """Check the fields, and read the files that they name."""
        super().__post_init__()

        if self.controller is not None and self.gains:
            raise UserError(
                f'{", ".join(self.gains)} are gains of the PID, which '
                f'controller={self.controller!r} replaces: give one or the other'
            )
        if self.gains:
            PID(**self.gains)  # which checks them

        lane = self.lane
        if lane is not None and not isinstance(lane, Pilot):
            check_steering_law(lane)
        if lane is not None and not self.track:
            raise needs_track(f'lane={lane!r}')
        if self.track and self.laps:
            Track.of(self.track).check_laps(self.laps)

        if self.reference is not None:
            reference = reference_of(self.reference)
            if isinstance(reference, Profile):
                self._set('reference', reference)

    @property
    def end(self) -> float:
        """The position [m] at which each lap of a road ends, or a run on a track; inf: none."""
        track = Track.of(self.track) if self.track else None  # as it is: it has been read
        laps = self.laps * track.length if track else 0.0
        return min(self.distance or inf, laps or inf)

    @property
    def gains(self) -> dict[str, float]:
        """The gains of the PID that are not its defaults, by name."""
        gains = {'kp': self.kp, 'ki': self.ki, 'kd': self.kd}
        return {name: gain for name, gain in gains.items() if gain is not None}

    def signal(self) -> Signal | None:
        """Return `reference` as a function: the speed to hold [m/s] over time and position.

        None: there is none, and the speed to hold is the number `speed_reference`.
        """
        return None if self.reference is None else reference_of(self.reference)


#: The numbers of a scenario with their limits, by name.
LIMITS = {row.name: row for row in parameters_of(Scenario) if row.between != UNBOUNDED}
