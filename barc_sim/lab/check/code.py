"""Interfaces of the user code that is judged, and `LocalCode`, which runs it in this process."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from barc_sim.errors import UserError
from barc_sim.vehicle.bike_model import L_F, L_R

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.lab.user_code.gains import ChosenGains
    from barc_sim.lab.user_code.loading import UserCode
    from barc_sim.lab.user_code.ros_world import Command, TimedTwist


class Row(NamedTuple):
    """The positional arguments of `bikeFE`, in its units.

    Examples
    --------
    >>> from barc_sim.vehicle.bike_model import bikeFE
    >>> flat = Row(0.0, 0.0, 0.0, v=8.0, a=1.0, d_f=0.0, a0=0.0, m=2e3, Ff=0.0, theta=0.0, ts=0.02)
    >>> bikeFE(*flat)
    [0.16, 0.0, 0.0, 8.02]
    """

    x: float
    y: float
    psi: float
    v: float
    a: float
    d_f: float
    a0: float
    m: float
    Ff: float
    theta: float
    ts: float


Next = tuple[float, float, float, float]  #: x, y, psi, v one step later
Sample = tuple[float, float, float]  #: [m/s] reference, [m/s] measured, [s] since the last


class JudgedController(Protocol):
    """One instance of the user's `PID`; each of its errors is a UserError."""

    def acc_calculate(self, reference: float, current: float, dt: float, /) -> float:
        """Return the commanded acceleration [m/s²]."""

    def acc_sequence(self, rows: Sequence[Sample], /) -> list[float]:
        """Return the results of `acc_calculate` for one sample after the other."""

    def reset(self) -> bool:
        """Call the user's `reset()`; return False if the class has none."""


class JudgedCode(Protocol):
    """A user's model, controller and relay; each of their errors is a UserError."""

    def has(self, part: str, /) -> bool:
        """Return whether there is this part of `FILES`."""

    def bike_fe(self, rows: Sequence[Row], *, l_f: float = L_F, l_r: float = L_R) -> list[Next]:
        """Return the result of `bikeFE` for each row; lengths [m] are passed if it takes them."""

    def new_pid(
        self, kp: float, ki: float, kd: float, *, limit: float = inf, fresh: bool = True
    ) -> JudgedController:
        """Return a new `PID` with these gains.

        It gets the `limit` [m/s²] of its output if it takes one. With `fresh` its file is loaded
        again, so that no global variable has a value of an earlier run.
        """

    def chosen_gains(self) -> ChosenGains | None:
        """Return the gains that `controller.py` chooses; None if it has none."""

    def relay_commands(self, twists: Sequence[TimedTwist], duration: float) -> list[Command]:
        """Return what a new relay commands from 0 to `duration` [s], while it gets `twists`."""


class LocalCode:
    """User code called in this process: nothing stops an endless loop.

    Examples
    --------
    >>> from barc_sim import PID
    >>> from barc_sim.lab.user_code.loading import UserCode
    >>> code = LocalCode(UserCode(controller=PID))
    >>> code.new_pid(2.0, 0.0, 0.0).acc_calculate(8.0, 7.0, 0.02)
    2.0
    """

    def __init__(self, user_code: UserCode) -> None:
        """Judge the parts of `user_code`."""
        self._user_code: Any = user_code

    def has(self, part: str, /) -> bool:
        """Return whether there is this part of `FILES`."""
        return getattr(self._user_code, part) is not None

    def bike_fe(self, rows: Sequence[Row], *, l_f: float = L_F, l_r: float = L_R) -> list[Next]:
        """Return the result of `bikeFE` for each row."""
        model = self._user_code.model
        return [(x, y, psi, v) for row in rows for x, y, psi, v in [model(*row, l_f=l_f, l_r=l_r)]]

    def new_pid(
        self, kp: float, ki: float, kd: float, *, limit: float = inf, fresh: bool = True
    ) -> JudgedController:
        """Return a new `PID` with these gains."""
        controller = self._user_code.controller
        if fresh and (again := getattr(controller, 'fresh', None)):
            controller = again()
        return _LocalController(controller(kp, ki, kd, output_min=-limit, output_max=limit))

    def chosen_gains(self) -> ChosenGains | None:
        """Return the gains that `controller.py` chooses."""
        return getattr(self._user_code.controller, 'chosen', None)

    def relay_commands(self, twists: Sequence[TimedTwist], duration: float) -> list[Command]:
        """Return what a new relay commands from 0 to `duration` [s], while it gets `twists`."""
        commands: list[Command] = self._user_code.relay.commands(twists, duration)
        return commands


class _LocalController:
    def __init__(self, pid: Any) -> None:  # noqa: ANN401 (a user's class)
        self._pid = pid
        # `barc_sim.lab.user_code` wraps the user's object as `instance`.
        self._reset = getattr(getattr(pid, 'instance', pid), 'reset', None)

    def acc_calculate(self, reference: float, current: float, dt: float, /) -> float:
        return float(self._pid.acc_calculate(reference, current, dt))

    def acc_sequence(self, rows: Sequence[Sample], /) -> list[float]:
        return [self.acc_calculate(*row) for row in rows]

    def reset(self) -> bool:
        if self._reset is None:
            return False
        try:
            self._reset()
        except (Exception, SystemExit) as error:
            raise UserError(
                f'reset() raised {type(error).__name__}: {error}; expected it to clear the PID'
            ) from error
        return True
