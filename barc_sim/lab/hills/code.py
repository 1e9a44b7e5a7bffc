"""The requests of the hills lab: a user's `bikeFE`, `PID` and relay in their process."""

from __future__ import annotations

from itertools import count
from math import inf
from typing import TYPE_CHECKING, Any

from barc_sim.control.driver import RATE, STALE_AFTER
from barc_sim.errors import one_line
from barc_sim.lab.check.code import JudgedCode, numbers_of, rows_of
from barc_sim.lab.user_code.folder import MAX_COMMANDS, Command, TimedTwist
from barc_sim.vehicle.bike_model import L_F, L_R

if TYPE_CHECKING:
    from collections.abc import Sequence

Next = tuple[float, float, float, float]  #: x, y, psi, v one step later
Sample = tuple[float, float, float]  #: [m/s] reference, [m/s] measured, [s] since the last
#: The user's name for what a request calls; others call a PID.
_CALLED = {'functions': 'bikeFE', 'relay': 'relay', 'notes': 'notes'}
_STATE = 4  # numbers
_numbers = count()  # of the controllers


class HillsCode(JudgedCode):
    """A user's model, controller and relay."""

    def called(self, do: str, *_: Any) -> str:  # noqa: ANN401 (JSON)
        """Return the user's name for what a request calls."""
        return _CALLED.get(do, 'PID')

    def bike_fe(
        self, rows: Sequence[Sequence[float]], l_f: float = L_F, l_r: float = L_R
    ) -> list[Next]:
        """Return the result of `bikeFE` for each row of its arguments.

        Lengths [m] that are not the lab's are passed if it takes them, and replace the file's own.
        """
        request = self.request(rows, l_f, l_r)
        if (l_f, l_r) == (L_F, L_R):
            request = request[:-1]
        return rows_of('bikeFE', self.call('functions', *request), len(rows), _STATE)

    @staticmethod
    def request(rows: Sequence[Sequence[float]], l_f: float, l_r: float) -> tuple[Any, ...]:
        """Return the arguments of a request for `bikeFE`, whose file gets these lengths, too."""
        return 'bikeFE', rows, {'l_f': l_f, 'l_r': l_r}, {'lf': l_f, 'lr': l_r}

    def new_pid(
        self, kp: float, ki: float, kd: float, *, limit: float = inf, fresh: bool = True
    ) -> JudgedController:
        """Return a new `PID` with these gains.

        It gets the `limit` [m/s²] of its output if it takes one. With `fresh` its file is loaded
        again, so that no global variable has a value of an earlier run.
        """
        number = next(_numbers)
        self.call('new_pid', number, kp, ki, kd, limit, fresh)
        return JudgedController(self, number)

    def relay_commands(self, twists: Sequence[TimedTwist], duration: float) -> list[Command]:
        """Return what a new relay commands from 0 to `duration` [s], while it gets `twists`."""
        found = self.call('relay', twists, duration, _relay_calls(twists, duration))
        rows = min(len(found), MAX_COMMANDS) if isinstance(found, list) else -1
        return [Command(*row) for row in rows_of('relay', found, rows, len(Command._fields))]

    def relay_keys(self) -> str:
        """Return the keys that were pressed for a relay that reads them itself, or nothing."""
        return one_line(str(self._notes().get('keys', '')), 20)


class JudgedController:
    """One instance of the user's `PID`."""

    def __init__(self, code: HillsCode, number: int) -> None:
        """Refer to the controller `number` of `code`."""
        self._code, self.number = code, number

    def acc_calculate(self, reference: float, current: float, dt: float, /) -> float:
        """Return the commanded acceleration [m/s²]."""
        return self.acc_sequence([(reference, current, dt)])[0]

    def acc_sequence(self, rows: Sequence[Sample], /) -> list[float]:
        """Return the results of `acc_calculate` for one sample after the other."""
        found = self._code.call('steps', self.number, rows)
        return numbers_of('PID', found, len(rows))

    def reset(self) -> bool:
        """Call the user's `reset()`; return False if the class has none."""
        return self._code.call('reset', self.number) is True


def _relay_calls(twists: Sequence[TimedTwist], duration: float) -> list[TimedTwist]:
    """Return the calls of a function `relay`, as its node makes them: zeros after stale Twists."""
    calls, nothing = [], TimedTwist(-inf, 0.0, 0.0)
    for k in range(round(duration * RATE)):
        t = k * (1.0 / RATE)
        latest = max((each for each in twists if each.t <= t + 1e-9), default=nothing)
        used = latest if t - latest.t <= STALE_AFTER else nothing
        calls.append(used._replace(t=t))
    return calls
