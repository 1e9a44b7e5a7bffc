"""The user code that is judged: its functions, called in this process or in another one."""

from __future__ import annotations

from itertools import count
from math import inf, isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.control.driver import RATE, STALE_AFTER
from barc_sim.lab.text import one_line
from barc_sim.lab.user_code.gains import ChosenGains
from barc_sim.lab.user_code.loading import Functions, UserCode, find_file
from barc_sim.lab.user_code.relay_program import MOST_COMMANDS, Command, TimedTwist
from barc_sim.lab.user_code.source import UserCodeError
from barc_sim.vehicle.bike_model import L_F, L_R

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


class Row(NamedTuple):
    """The positional arguments of `bikeFE`, in its units."""

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
_STATE = 4  # numbers
_MAX_PHRASES = 20
Sample = tuple[float, float, float]  #: [m/s] reference, [m/s] measured, [s] since the last


class JudgedCode:
    """A user's model, controller and relay; each of their errors is a UserCodeError.

    A subclass makes the calls, which return values of JSON, and whatever values these are.
    """

    def __init__(self) -> None:
        """Start without a controller."""
        self._numbers = count()

    def has(self, part: str, /) -> bool:
        """Return whether there is this part of `FILES`."""
        raise NotImplementedError

    def call(self, do: str, *arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        """Return the result of a function of `Functions`."""
        raise NotImplementedError

    def bike_fe(self, rows: Sequence[Row], *, l_f: float = L_F, l_r: float = L_R) -> list[Next]:
        """Return the result of `bikeFE` for each row; lengths [m] are passed if it takes them."""
        found = self.call('model', rows, l_f, l_r)
        return _rows('bikeFE', found, len(rows), _STATE)

    def new_pid(
        self, kp: float, ki: float, kd: float, *, limit: float = inf, fresh: bool = True
    ) -> JudgedController:
        """Return a new `PID` with these gains.

        It gets the `limit` [m/s²] of its output if it takes one. With `fresh` its file is loaded
        again, so that no global variable has a value of an earlier run.
        """
        number = next(self._numbers)
        self.call('new_pid', number, kp, ki, kd, limit, fresh)
        return JudgedController(self, number)

    def relay_commands(self, twists: Sequence[TimedTwist], duration: float) -> list[Command]:
        """Return what a new relay commands from 0 to `duration` [s], while it gets `twists`."""
        found = self.call('relay', twists, duration, _relay_calls(twists, duration))
        rows = min(len(found), MOST_COMMANDS) if isinstance(found, list) else -1
        return [Command(*row) for row in _rows('relay', found, rows, len(Command._fields))]

    def chosen_gains(self) -> ChosenGains | None:
        """Return the gains that `controller.py` chooses; None if it has none."""
        try:
            kp, ki, kd, origin = self._notes()['gains']
            gains = ChosenGains(float(kp), float(ki), float(kd), one_line(str(origin), 100))
        except (KeyError, TypeError, ValueError, OverflowError):
            return None
        return gains if all(map(isfinite, gains[:3])) else None

    def tolerated(self) -> tuple[str, ...]:
        """Return what was tolerated in the files that are loaded, a phrase each."""
        phrases = self._notes().get('tolerated')
        known = phrases[:_MAX_PHRASES] if isinstance(phrases, list) else ()
        return tuple(one_line(str(phrase)) for phrase in known)

    def _notes(self) -> dict[str, Any]:
        try:
            notes = self.call('notes')
        except UserCodeError:
            return {}
        return notes if isinstance(notes, dict) else {}


class JudgedController:
    """One instance of the user's `PID`."""

    def __init__(self, code: JudgedCode, number: int) -> None:
        """Refer to the controller `number` of `code`."""
        self._code, self._number = code, number

    def acc_calculate(self, reference: float, current: float, dt: float, /) -> float:
        """Return the commanded acceleration [m/s²]."""
        return self.acc_sequence([(reference, current, dt)])[0]

    def acc_sequence(self, rows: Sequence[Sample], /) -> list[float]:
        """Return the results of `acc_calculate` for one sample after the other."""
        found = self._code.call('steps', self._number, rows)
        return _numbers('PID', found, len(rows))

    def reset(self) -> bool:
        """Call the user's `reset()`; return False if the class has none."""
        return self._code.call('reset', self._number) is True


class LocalCode(JudgedCode):
    """User code called in this process: nothing stops an endless loop."""

    def __init__(self, source: UserCode | Path) -> None:
        """Judge the parts of user code, or the files in a folder."""
        super().__init__()
        self._source = source
        self._functions = Functions(source)

    def has(self, part: str, /) -> bool:
        """Return whether there is this part of `FILES`."""
        if isinstance(self._source, UserCode):
            return getattr(self._source, part) is not None
        return find_file(self._source, part) is not None

    def call(self, do: str, *arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        """Return the result of a function of `Functions`."""
        return self._functions.call(do, *arguments)


def _relay_calls(twists: Sequence[TimedTwist], duration: float) -> list[TimedTwist]:
    """Return the calls of a function `relay`, as its node makes them: zeros after stale Twists."""
    calls, nothing = [], TimedTwist(-inf, 0.0, 0.0)
    for k in range(round(duration * RATE)):
        t = k * (1.0 / RATE)
        latest = max((each for each in twists if each.t <= t + 1e-9), default=nothing)
        used = latest if t - latest.t <= STALE_AFTER else nothing
        calls.append(used._replace(t=t))
    return calls


def _rows(function: str, found: Any, rows: int, columns: int) -> list[Any]:  # noqa: ANN401
    """Return rows of numbers; whatever a process sends is only numbers."""
    if not isinstance(found, list) or len(found) != rows:
        raise UserCodeError(f'{function} returned something else than {rows} rows of numbers')
    return [tuple(_numbers(function, row, columns)) for row in found]


def _numbers(function: str, found: Any, size: int) -> list[float]:  # noqa: ANN401
    if not isinstance(found, (list, tuple)) or len(found) != size:
        raise UserCodeError(f'{function} returned something else than {size} numbers')
    if not all(type(value) is float and isfinite(value) for value in found):
        raise UserCodeError(f'{function} returned numbers that are not finite')
    return [*found]
