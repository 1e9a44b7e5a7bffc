"""The code of a submission, called in a confined process."""

from __future__ import annotations

import json
import time
from collections import Counter
from itertools import chain, islice
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

from barc_sim.lab.grade.process import Ended, Failed, Process
from barc_sim.lab.grade.protocol import (
    COMMAND_COLUMNS,
    NOTES_COLUMNS,
    STATE_COLUMNS,
    Operation,
)
from barc_sim.lab.grade.start import Limits
from barc_sim.lab.grade.text import one_line
from barc_sim.lab.user_code.call import without_addresses
from barc_sim.lab.user_code.gains import ChosenGains
from barc_sim.lab.user_code.loading import find_file
from barc_sim.lab.user_code.relay_program import MOST_COMMANDS
from barc_sim.lab.user_code.ros_world import Command
from barc_sim.lab.user_code.source import UserCodeError
from barc_sim.vehicle.bike_model import L_F, L_R

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from typing_extensions import Self

    from barc_sim.lab.check.code import Next, Row, Sample
    from barc_sim.lab.user_code.ros_world import TimedTwist

_MAX_ENDS = 2  # a function that has ended its process so often is not called again
_MODEL, _CONTROLLER, _RELAY, _NOTES = 'bikeFE', 'PID', 'relay', 'notes'


class ConfinedCode:
    """The functions of the files in `folder`, called in a process that is confined to it.

    If a call ends the process, it fails, and the next call uses a new process. Each failure is a
    UserCodeError. All calls together have `Limits.total` seconds; after that each one fails.
    """

    def __init__(self, folder: Path, limits: Limits | None = None, *, sandbox: bool = True) -> None:
        """Use the files in `folder`; the process starts at the first call."""
        self._folder = folder
        self._limits = limits or Limits()
        self._sandbox = sandbox
        self._process: Process | None = None
        self._left = self._limits.total
        self._ends: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self._printed = b''

    def __enter__(self) -> Self:
        """Return the code; its process ends with the block."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        self.close()

    def has(self, part: str, /) -> bool:
        """Return whether there is the file of this part."""
        return find_file(self._folder, part) is not None

    @property
    def printed(self) -> str:
        """The first output of the processes that have ended."""
        text = without_addresses(self._printed[: self._limits.output].decode(errors='replace'))
        return f'{text}\n[and more]' if len(self._printed) > self._limits.output else text

    def bike_fe(self, rows: Sequence[Row], *, l_f: float = L_F, l_r: float = L_R) -> list[Next]:
        """Return the result of `bikeFE` for each row."""
        values = (l_f, l_r, *chain.from_iterable(rows))
        answers = self.call(_MODEL, Operation.MODEL, values, STATE_COLUMNS * len(rows))
        return [
            (x, y, psi, v) for x, y, psi, v in zip(*[iter(answers)] * STATE_COLUMNS, strict=True)
        ]

    def new_pid(
        self, kp: float, ki: float, kd: float, *, limit: float = inf, fresh: bool = True
    ) -> ConfinedController:
        """Return a new `PID` with these gains, see `JudgedCode`."""
        values = (kp, ki, kd, limit, float(fresh))
        (number,) = self.call(_CONTROLLER, Operation.NEW_PID, values, 1)
        return ConfinedController(self, number, self._process)

    def chosen_gains(self) -> ChosenGains | None:
        """Return the gains that `controller.py` chooses."""
        try:
            kp, ki, kd, origin = self._notes()['gains']
            gains = ChosenGains(float(kp), float(ki), float(kd), one_line(str(origin)))
        except (KeyError, TypeError, ValueError):
            return None
        return gains if all(map(isfinite, gains[:3])) else None

    def relay_commands(self, twists: Sequence[TimedTwist], duration: float) -> list[Command]:
        """Return what a new relay commands from 0 to `duration` [s], while it gets `twists`."""
        values = (duration, *chain.from_iterable(twists))
        number, *rest = self.call(
            _RELAY, Operation.RELAY, values, 1 + COMMAND_COLUMNS * MOST_COMMANDS
        )
        rows = zip(*[iter(rest)] * COMMAND_COLUMNS, strict=True)
        return [Command(*row) for row in islice(rows, max(int(number), 0))]

    def tolerated(self) -> tuple[str, ...]:
        """Return what was tolerated in the files that are loaded, a phrase each."""
        phrases = self._notes().get('tolerated')
        return tuple(map(one_line, map(str, phrases))) if isinstance(phrases, list) else ()

    def _notes(self) -> dict[str, Any]:
        """Return what the process says about the files; whatever it sends is only text."""
        if self._process is None:
            return {}
        try:
            points = self.call(_NOTES, Operation.NOTES, (), NOTES_COLUMNS)
            notes = json.loads(bytes(int(point) for point in points if point))
        except (UserCodeError, ValueError, RecursionError):
            return {}
        return notes if isinstance(notes, dict) else {}

    def call(
        self, function: str, operation: Operation, values: Sequence[float], count: int
    ) -> tuple[float, ...]:
        """Return the result of a request that calls `function`.

        Raises
        ------
        UserCodeError
            if the function fails, ends its process or returns numbers that are not finite.
        """
        if self._ends[function] >= _MAX_ENDS:
            raise UserCodeError(self._reasons[function])
        if self._left <= 0.0:
            raise UserCodeError(self._out_of_time())
        if self._process is None:
            self._process = Process(self._folder, self._limits, sandbox=self._sandbox)
        wait = min(self._limits.wait, self._left)
        began = time.monotonic()
        try:
            answers = self._process.request(operation, values, count, wait)
        except Failed as error:
            raise UserCodeError(str(error)) from None
        except Ended as error:
            if time.monotonic() - began >= self._left:
                self.close()
                raise UserCodeError(self._out_of_time()) from None
            self.close()
            self._ends[function] += 1
            self._reasons[function] = f'{function}: the process that called it {error}'
            raise UserCodeError(self._reasons[function]) from None
        finally:
            self._left -= time.monotonic() - began
        if not all(map(isfinite, answers)):
            raise UserCodeError(f'{function} returned numbers that are not finite')
        return answers

    def _out_of_time(self) -> str:
        return (
            f'the code has used up the {self._limits.total:g} s that a submission has '
            '(--time-limit); does it sleep, or wait for something?'
        )

    def is_current(self, process: Process | None) -> bool:
        """Return whether `process` is the current one."""
        return process is not None and process is self._process

    def close(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.close()
            self._printed += self._process.channel.printed
            self._process = None


class ConfinedController:
    """A `PID` in the process of `code`."""

    def __init__(self, code: ConfinedCode, number: float, process: Process | None) -> None:
        """Refer to the controller `number` of `process`."""
        self._code = code
        self._number = number
        self._process = process

    def acc_calculate(self, reference: float, current: float, dt: float, /) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        return self._call(Operation.STEPS, (self._number, reference, current, dt), 1)[0]

    def acc_sequence(self, rows: Sequence[Sample], /) -> list[float]:
        """Return the results of `acc_calculate` for one sample after the other."""
        values = (self._number, *chain.from_iterable(rows))
        return [*self._call(Operation.STEPS, values, len(rows))]

    def reset(self) -> bool:
        """Call the controller's `reset`; return False if it has none."""
        return self._call(Operation.RESET, (self._number,), 1) == (1.0,)

    def _call(
        self, operation: Operation, values: tuple[float, ...], count: int
    ) -> tuple[float, ...]:
        if not self._code.is_current(self._process):
            raise UserCodeError(f'{_CONTROLLER}: the process of this controller has ended')
        return self._code.call(_CONTROLLER, operation, values, count)
