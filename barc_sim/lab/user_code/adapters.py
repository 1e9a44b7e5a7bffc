"""Adapts user code to the interfaces of barc_sim's controllers, lane laws and driver."""

from __future__ import annotations

from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.control.driver import Driver, limited
from barc_sim.control.lane import LaneAdapter, LaneLaw
from barc_sim.control.pilots import Pilot
from barc_sim.control.planning import line_beside
from barc_sim.control.speed import KD, KI, KP, PID, Adapter, Gain, SpeedAdapter
from barc_sim.errors import UserError
from barc_sim.interfaces.records import Command
from barc_sim.lab.files import POINTS
from barc_sim.lab.user_code.code import UserCode, gains_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from barc_sim.control.lane import Curvature
    from barc_sim.control.situation import Situation
    from barc_sim.lab.user_code.code import UserObject
    from barc_sim.vehicle.track import Track

COMMANDS = 60.0  #: [s] duration of the commands of `identify.py`
_HALF_STEP = 0.01  # [s]


class _OfUserObject(Adapter):
    """Keeps a `UserObject`: gains are set as attributes only if its instance has them."""

    def _set(self, values: Mapping[str, float]) -> None:
        self._object.set_gains(values)

    def _read(self, name: str) -> float:
        value: float = self._object.read(name)
        return value


class UserController(_OfUserObject, SpeedAdapter):
    """Uses a user's class `PID` as a `Controller`.

    Its constructor gets the gains, and the limits if it takes them.
    """

    kp: float
    ki: float
    kd: float

    def __init__(self, code: UserCode) -> None:
        """Make a controller with the gains that its file chooses, else with the run's gains."""
        self._code = code
        values = code.gains.values if code.gains else (KP, KI, KD)
        gains = dict(zip(PID.gains, values, strict=True))
        super().__init__(self._new_pid, PID.gains, gains, PID.terms)

    def __reduce__(self) -> tuple[Callable[..., UserController], tuple[UserCode, dict[str, Any]]]:
        """Travel to another process with files, gains and limits; a run there begins with a reset.

        Nothing of the user's runs before that, so that its error is that of the run.
        """
        kept = {'gains', 'terms', 'output_min', 'output_max', 'saturated', *self.gains, *self.terms}
        state = {name: value for name, value in vars(self).items() if name in kept}
        return _arrived_controller, (self._code, state)

    def _new_pid(self, **gains: float) -> UserObject:
        limits: Any = {'output_min': self.output_min, 'output_max': self.output_max}
        return self._code.new_pid(*gains.values(), **limits)


def _arrived_controller(code: UserCode, state: dict[str, Any]) -> UserController:
    """Return a controller that was sent to this process."""
    controller = UserController.__new__(UserController)
    vars(controller).update(state, _code=code, _new=controller._new_pid)  # noqa: SLF001 (its class)
    return controller


def controller_of(file: Path) -> UserController:
    """Load a `controller.py`, and return a new controller of it; its printed text is dropped."""
    return UserController(UserCode({'controller': file}, output=lambda _: None).load())


class UserCommands(Pilot):
    """Commands a user's function `command` of the time [s], whatever the car does."""

    def __init__(self, code: UserCode) -> None:
        """Begin at 0 s."""
        self._command: Any = code.identify
        self._limit = inf
        self._is_limited = False

    @property
    def follows_reference(self) -> bool:
        """Whether it holds a speed: it does not."""
        return False

    @property
    def saturated(self) -> bool:
        """Whether the limit cut the latest command."""
        return self._is_limited

    def limit(self, acceleration: float) -> None:
        """Limit the commanded acceleration [m/s²], either way."""
        self._limit = acceleration

    def command(self, situation: Situation) -> Command:
        """Return the command at the time of a situation."""
        raw = 0.0
        if situation.t < COMMANDS - _HALF_STEP:
            raw = float(self._command(situation.t))
        motor = limited(raw, self._limit)
        self._is_limited = motor != raw
        return Command(motor, 0.0)


class UserLane(_OfUserObject, LaneAdapter):
    """Uses a user's class `Lane` as a steering law."""

    def __init__(self, code: UserCode) -> None:
        """Begin with the defaults of its constructor as gains."""
        defaults = gains_of(code.lane)
        gains = {
            name: Gain(value, '-', f'{name} of lane.py', 2.0 * abs(value) or 1.0, (-1e6, 1e6))
            for name, value in defaults.items()
        }
        super().__init__(partial(code.new, 'lane'), gains, defaults, LaneLaw.terms)

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the steering angle [rad] for errors [m, rad] and a speed [m/s]."""
        output: float = self._call('__call__', e_y, e_psi, speed, curvature)
        return output


def line_arguments(track: Track) -> list[Any]:
    """Return the arguments of a user's `line`; `half` leaves a fifth of the width at each edge."""
    points = track.place(track.length / POINTS * np.arange(POINTS))
    columns = [np.asarray(values).tolist() for values in points]
    return [*columns, 0.3 * track.width]


def line_along(track: Track, offsets: Sequence[float]) -> Track:
    """Return the track along the offsets [m] that a user's `line` returned."""
    maximum = max(map(abs, offsets))
    edge = 0.5 * track.width
    if maximum >= edge:
        raise UserError(
            f'an offset of line is {maximum:.3g} m, but the edges of {track.name} are {edge:g} m '
            'from its centre line'
        )
    try:
        return line_beside(track, np.array(offsets))
    except UserError:
        raise UserError(
            'the offsets of line jump from point to point: no car can follow them'
        ) from None


class UserDriver(Driver):
    """Uses a user's relay as a `Driver`: it handles all input except the brake.

    Its commands are clamped to the car's limits.
    """

    def __init__(self, code: UserCode) -> None:
        """Start with a new relay."""
        self._code = code
        super().__init__()

    def reset(self) -> None:
        """Clear the request, and start with a new relay."""
        super().reset()
        self._relay = self._code.new_relay()

    def command(self, t: float, speed: float) -> Command:
        """Return the command from `t` [s] on, at a true speed of `speed` [m/s]."""
        without_relay = super().command(t, speed)
        if self.request.brake:
            return without_relay

        motor, servo = self._relay(self.request.forward, self.request.turn, dt=self.dt)
        max_acceleration = max(self.limits.acceleration, self.limits.deceleration)
        self.servo = limited(servo, self.limits.steering)
        return Command(limited(motor, max_acceleration), self.servo)
