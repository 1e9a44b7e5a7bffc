"""What decides: a pilot answers the situation of a car with a command.

The class of a pilot says what it decides: `SpeedPilot` the acceleration, `LanePilot` the steering,
`PlanPilot` the steering and a speed of its own, `LaneKeeping` both, with a pilot for each. Users'
objects become pilots in `as_pilot` and `as_lane_pilot`.

The way from a state to a command; each method calls those that are indented below it::

    CruiseController._on_state            the node takes the message of a state
        CruiseControl.take_state          checks the state, and finds dt from the stamps
            Navigator.situation           finds the place on the track, and the speed to hold
            LaneKeeping.command           on a track only
                LanePilot.command
                    steer_calculate       of a steering law, such as LaneLQR
                SpeedPilot.command        without a track, take_state calls it
                    PID.acc_calculate     or any object of a user with this method
                        pid               the law, which compiled loops call, too
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from math import nan
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from barc_sim.control.lane import LANE, STEERING_LIMIT, LaneLaw, as_steering_law
from barc_sim.control.speed import PID, as_controller, limited_output, read_term, set_gains
from barc_sim.errors import UserError
from barc_sim.interfaces.records import Command

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.control.lane import SteeringLaw
    from barc_sim.control.situation import Situation
    from barc_sim.control.speed import Controller, Gain
    from barc_sim.vehicle.track import Frenet


class Pilot(ABC):
    """Decides: answers each situation of a car with a command.

    Parameters of the node `controller`, the page's sliders, the log's columns and the messages in
    the bag follow from `gains` and `terms`.
    """

    gains: Mapping[str, Gain] = {}
    terms: Mapping[str, str] = {}  #: parts of a command: their meaning by name
    #: Gains that show what each term does, by the name of the page's button.
    presets: Mapping[str, Mapping[str, float]] = {}

    @abstractmethod
    def command(self, situation: Situation) -> Command:
        """Return the command that answers a situation."""

    def reset(self) -> None:  # noqa: B027 (a pilot may keep nothing)
        """Forget the past: the next situation is the first."""

    @property
    def follows_reference(self) -> bool:
        """Whether the speed to hold means anything; if not, it is NaN in logs and messages."""
        return True

    @property
    def plans_speed(self) -> bool:
        """Whether a pilot that steers also commands the acceleration."""
        return False

    @property
    def saturated(self) -> bool:
        """Whether a limit cut the latest command."""
        return False

    @property
    def plan(self) -> NDArray[np.float64] | None:
        """The latest plan, shape `(n, 2)`: distance ahead and e_y [m]; None: it makes none."""
        return None

    @property
    def gain_values(self) -> dict[str, float]:
        """The present gains, by name."""
        return {}

    def set_gains(self, values: Mapping[str, float]) -> None:
        """Set gains by name; UserError: it has no such gain, or one is beyond its limits."""
        if values:
            raise UserError(f'{", ".join(values)}: this pilot has no gains')

    def limit(self, acceleration: float) -> None:  # noqa: B027 (a pilot may have no limit)
        """Limit the commanded acceleration [m/s²], either way."""

    def term(self, name: str) -> float:  # noqa: ARG002 (it has none)
        """Return a term of the latest command; NaN: it has no such term."""
        return nan

    def values(self) -> Sequence[float]:
        """Return the terms of the latest command, in the order of `terms`."""
        return [self.term(name) for name in self.terms]


class SpeedPilot(Pilot):
    """Commands the acceleration with a speed controller; the steering is 0."""

    def __init__(self, controller: Controller) -> None:
        """Drive with this controller, whose attributes its gains and terms are."""
        self.controller = controller
        self.gains = controller.gains
        self.terms = controller.terms
        if isinstance(controller, PID):
            self.presets = controller.presets
        self._read = _reader([*self.terms])

    def command(self, situation: Situation) -> Command:
        """Return the command that answers a situation."""
        motor = self.controller.acc_calculate(
            situation.reference, situation.measured.v_x, situation.dt
        )
        return Command(float(motor), 0.0)

    def reset(self) -> None:
        """Reset the controller."""
        self.controller.reset()

    @property
    def saturated(self) -> bool:
        """Whether a limit cut the controller's latest output."""
        return self.controller.saturated

    @property
    def gain_values(self) -> dict[str, float]:
        """The present gains, by name."""
        return {name: float(getattr(self.controller, name)) for name in self.gains}

    def set_gains(self, values: Mapping[str, float]) -> None:
        """Set gains by name."""
        set_gains(self.controller, values)

    def limit(self, acceleration: float) -> None:
        """Limit the commanded acceleration [m/s²], either way."""
        self.controller.output_min = -acceleration
        self.controller.output_max = acceleration

    def term(self, name: str) -> float:
        """Return a term of the latest command."""
        return float(getattr(self.controller, name))

    def values(self) -> Sequence[float]:
        """Return the terms of the latest command, in the order of `terms`."""
        return self._read(self.controller)


class LanePilot(Pilot):
    """Steers along a track with a steering law; the acceleration is 0."""

    def __init__(self, controller: SteeringLaw) -> None:
        """Steer with this controller, whose attributes its gains and terms are."""
        self.controller = controller
        self.gains = controller.gains
        self.terms = controller.terms

    def command(self, situation: Situation) -> Command:
        """Return the command that answers a situation, without a limit of the angle."""
        track, place = situation.on_track()

        def curvature(ahead: float) -> float:
            return track.curvature(place.s + ahead)

        speed = situation.measured.v_x
        return Command(
            0.0, self.controller.steer_calculate(place.e_y, place.e_psi, speed, curvature)
        )

    def reset(self) -> None:
        """Reset the controller."""
        self.controller.reset()

    @property
    def plan(self) -> NDArray[np.float64] | None:
        """The latest plan of the controller."""
        plan: NDArray[np.float64] | None = self.controller.prediction
        return plan

    @property
    def gain_values(self) -> dict[str, float]:
        """The present gains, by name."""
        return {name: float(getattr(self.controller, name)) for name in self.gains}

    def set_gains(self, values: Mapping[str, float]) -> None:
        """Set gains by name."""
        set_gains(self.controller, values)

    def term(self, name: str) -> float:
        """Return a term of the latest command."""
        return read_term(self.controller, name)


class PlanPilot(LanePilot):
    """Steers along a track with a law that plans the speed, too."""

    def command(self, situation: Situation) -> Command:
        """Return the command that answers a situation, without a limit of the angle."""
        steering = super().command(situation)
        return Command(float(self.controller.acceleration or 0.0), steering.servo)

    @property
    def plans_speed(self) -> bool:
        """Whether it commands the acceleration: it does."""
        return True


class StraightAhead(Pilot):
    """Keeps the wheel straight on a track."""

    def command(self, situation: Situation) -> Command:  # noqa: ARG002 (whatever it is)
        """Return the command that answers a situation."""
        return Command(0.0, 0.0)


#: What `LaneKeeping.steering_values` returns, by the names of LaneState's fields.
STEERING = (*LaneLaw.terms, 'saturated')


class LaneKeeping(Pilot):
    """Keeps a lane at a speed: one pilot steers, within a limit, and the other accelerates.

    Where the one that steers plans the speed, its acceleration counts; the other one is asked all
    the same, so that its terms are recorded.
    """

    def __init__(self, speed: Pilot, lane: Pilot) -> None:
        """Drive with these two; the gains of `lane` have `LANE` before their names."""
        self.speed = speed
        self.lane = lane
        self.gains = {**speed.gains, **{LANE + name: each for name, each in lane.gains.items()}}
        self.terms = {**speed.terms, **{LANE + name: each for name, each in lane.terms.items()}}
        #: The terms that `LaneLaw` does not have.
        self.own_terms = [name for name in lane.terms if name not in LaneLaw.terms]
        self._plans_speed = lane.plans_speed
        self._reset_lane()

    def reset(self) -> None:
        """Reset both."""
        self.speed.reset()
        self._reset_lane()

    def _reset_lane(self) -> None:
        self.lane.reset()
        self._place: Frenet | None = None
        self._is_limited = False
        self.output = 0.0  #: [rad] the latest front angle

    def command(self, situation: Situation) -> Command:
        """Return the command that answers a situation."""
        self._place = situation.place
        steering = self.lane.command(situation)
        driving = self.speed.command(situation)

        raw = steering.servo
        output, _ = limited_output(raw, -STEERING_LIMIT, STEERING_LIMIT)
        self.output = float(output)
        # At the limit except for rounding, like the plan of an MPC; NaN, too.
        self._is_limited = not abs(raw) < STEERING_LIMIT * (1.0 - 1e-9)
        motor = steering.motor if self._plans_speed else driving.motor
        return Command(motor, self.output)

    @property
    def follows_reference(self) -> bool:
        """Whether a pilot that follows the reference decides the acceleration."""
        return self.speed.follows_reference and not self._plans_speed

    @property
    def plans_speed(self) -> bool:
        """Whether the pilot that steers plans the speed."""
        return self._plans_speed

    @property
    def saturated(self) -> bool:
        """Whether the latest front angle is at its limit."""
        return self._is_limited

    @property
    def plan(self) -> NDArray[np.float64] | None:
        """The latest plan of the pilot that steers."""
        return self.lane.plan

    @property
    def gain_values(self) -> dict[str, float]:
        """The present gains, by name."""
        of_lane = {LANE + name: value for name, value in self.lane.gain_values.items()}
        return {**self.speed.gain_values, **of_lane}

    def set_gains(self, values: Mapping[str, float]) -> None:
        """Set gains by name."""
        of_lane = {name for name in values if name.startswith(LANE)}
        self.lane.set_gains({name.removeprefix(LANE): values[name] for name in of_lane})
        self.speed.set_gains({name: values[name] for name in values.keys() - of_lane})

    def limit(self, acceleration: float) -> None:
        """Limit the acceleration [m/s²] of the pilot of the speed, either way."""
        self.speed.limit(acceleration)

    def term(self, name: str) -> float:
        """Return a term of the latest command."""
        if name.startswith(LANE):
            return self.lane.term(name.removeprefix(LANE))
        return self.speed.term(name)

    def steering_values(self) -> list[float]:
        """Return what `STEERING` names; NaN: the law has no such term."""
        terms = [float(self.lane.term(name)) for name in LaneLaw.terms]
        return [*terms, self._is_limited]

    def own_values(self) -> list[float]:
        """Return the values of `own_terms`."""
        return [float(self.lane.term(name)) for name in self.own_terms]

    def computed(self) -> dict[str, Any]:
        """Return the fields of LaneState for the latest front angle."""
        place = self._place
        return {
            'e_y': place.e_y if place else 0.0,
            'e_psi': place.e_psi if place else 0.0,
            'output': self.output,
            **dict(zip(STEERING, self.steering_values(), strict=True)),
            'names': self.own_terms,
            'values': self.own_values(),
        }


def _reader(names: Sequence[str]) -> Callable[[object], Sequence[float]]:
    """Return a fast function that reads these attributes of an object."""
    if len(names) > 1:
        return attrgetter(*names)

    def read(owner: object) -> list[float]:
        return [getattr(owner, name) for name in names]

    return read


def as_pilot(controller: object) -> Pilot:
    """Return the pilot of a speed controller: any object with the lab's `acc_calculate`.

    A pilot is returned as it is. UserError: it is no such object.
    """
    if isinstance(controller, Pilot):
        return controller
    return SpeedPilot(as_controller(controller))


def as_lane_pilot(lane: object) -> Pilot:
    """Return the pilot of a steering law: any object with `steer_calculate`.

    A pilot is returned as it is; without a law the pilot goes straight ahead. UserError: it is no
    such object.
    """
    if lane is None:
        return StraightAhead()
    if isinstance(lane, Pilot):
        return lane
    controller = as_steering_law(lane)
    if controller.acceleration is None:
        return LanePilot(controller)
    return PlanPilot(controller)
