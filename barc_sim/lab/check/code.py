"""The user code that is judged, called in a process of its own, and the findings on it."""

from __future__ import annotations

import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from functools import wraps
from math import isfinite
from typing import TYPE_CHECKING, Any, ParamSpec

import numpy as np

from barc_sim.errors import UserError, one_line, without_addresses
from barc_sim.lab.confined.process import Ended, Failed, Limits, Process
from barc_sim.lab.handout import files_in
from barc_sim.lab.user_code.source import ChosenGains, UserCodeError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from typing_extensions import Self


_MAX_PHRASES = 20
_MAX_ENDS = 2  # a function that has ended its process, or looped, so often is not called again


class JudgedCode:
    """A user's files in `folder`, called in a process confined to it; a lab adds what it calls.

    Each failure is a UserCodeError. If a call ends the process, the next one uses a new process.
    All calls together have `Limits.total` seconds; after that each one fails.
    """

    def __init__(self, folder: Path, limits: Limits | None = None, *, sandbox: bool = True) -> None:
        """Use the files in `folder`; the process starts at the first call."""
        self._folder = folder
        self._limits = limits or Limits()
        self._sandbox = sandbox
        self._process: Process | None = None
        self._left = self._limits.total
        self._ends: Counter[str] = Counter()
        self._loops: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self._printed = b''
        self._gains: ChosenGains | None = None

    def __enter__(self) -> Self:
        """Return the code; its process ends with the block."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        self.close()

    def has(self, part: str) -> bool:
        """Return whether there is the file of this part."""
        return part in files_in(self._folder)

    def called(self, do: str, *_: Any) -> str:  # noqa: ANN401 (JSON)
        """Return the user's name for what a request calls."""
        return do

    def chosen_gains(self) -> ChosenGains | None:
        """Return the gains that `controller.py`, once loaded, chooses; None if it has none."""
        with suppress(KeyError, TypeError, ValueError, OverflowError):
            kp, ki, kd, origin = self._notes()['gains']
            gains = ChosenGains(float(kp), float(ki), float(kd), one_line(str(origin), 100))
            if all(map(isfinite, gains[:3])):
                self._gains = gains  # they stay known when the process has ended
        return self._gains

    def tolerated(self) -> tuple[str, ...]:
        """Return what was tolerated in the files that are loaded, a phrase each."""
        phrases = self._notes().get('tolerated')
        known = phrases[:_MAX_PHRASES] if isinstance(phrases, (list, tuple)) else ()
        return tuple(one_line(str(phrase)) for phrase in known)

    def line_of(
        self, do: str, arguments: Sequence[Any], values: Iterable[float], others: Iterable[float]
    ) -> str:
        """Return the file and line that first gives one of the `values` to a name in a request.

        Values that are among the `others` do not count. Where no line does, it is the one that
        returns; empty if that is not known.
        """
        try:
            lines = [(str(at), float(value)) for at, value in self.call('lines', do, *arguments)]
        except (UserCodeError, TypeError, ValueError):
            return ''
        usual = np.array([0.0, 1.0, *others])
        wrong = np.array([v for v in values if not np.isclose(v, usual, 1e-12, 0.0).any()])
        near = (at for at, value in lines if np.isclose(value, wrong, 1e-9, 0.0).any())
        return one_line(next(near, lines[-1][0] if lines else ''), 100)

    def _notes(self) -> dict[str, Any]:
        try:
            notes = self.call('notes')
        except UserCodeError:
            return {}
        return notes if isinstance(notes, dict) else {}

    @property
    def printed(self) -> str:
        """The first output of the processes that have ended."""
        text = without_addresses(self._printed[: self._limits.output].decode(errors='replace'))
        return f'{text}\n[and more]' if len(self._printed) > self._limits.output else text

    def call(self, do: str, *arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        """Return the result of a request.

        Raises
        ------
        UserCodeError
            if the function fails or ends its process.
        """
        function = self.called(do, *arguments)
        if max(self._ends[function], self._loops[function]) >= _MAX_ENDS:
            raise UserCodeError(self._reasons[function])
        if self._left <= 0.0:
            raise UserCodeError(self._out_of_time())
        if do == 'notes' and self._process is None:
            return {}
        if self._process is None:
            self._process = Process(self._folder, self._limits, sandbox=self._sandbox)
        began = time.monotonic()
        try:
            return self._process.request(do, *arguments, wait=min(self._limits.wait, self._left))
        except Failed as error:
            if 'is there an endless loop' in str(error):  # each such call takes all of its time
                self._loops[function] += 1
                self._reasons[function] = str(error)
            raise UserCodeError(str(error)) from None
        except Ended as error:
            self.close()
            if time.monotonic() - began >= self._left:
                raise UserCodeError(self._out_of_time()) from None
            self._ends[function] += 1
            self._reasons[function] = f'{function}: the process that called it {error}'
            raise UserCodeError(self._reasons[function]) from None
        finally:
            self._left -= time.monotonic() - began

    def _out_of_time(self) -> str:
        return (
            f'the code has used up the {self._limits.total:g} s that it has in all; does it '
            'sleep, or wait for something?'
        )

    def close(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.close()
            self._printed += self._process.printed
            self._process = None


def rows_of(function: str, found: Any, rows: int, columns: int) -> list[Any]:  # noqa: ANN401
    """Return rows of numbers: the process can send anything."""
    if not isinstance(found, list) or len(found) != rows:
        raise UserCodeError(f'{function} returned something else than {rows} rows of numbers')
    return [tuple(numbers_of(function, row, columns)) for row in found]


def numbers_of(function: str, found: Any, size: int) -> list[float]:  # noqa: ANN401
    """Return `size` finite numbers that a function returned."""
    if not isinstance(found, (list, tuple)) or len(found) != size:
        raise UserCodeError(f'{function} returned something else than {size} numbers')
    if not all(type(value) is float and isfinite(value) for value in found):
        raise UserCodeError(f'{function} returned numbers that are not finite')
    return [*found]


_P = ParamSpec('_P')


@dataclass(frozen=True)
class Finding:
    """How far a criterion is met, and what to check if it is not."""

    criterion: str  #: a part and a name, as in `model.x`
    score: float  #: from 0 to 1; 1 is full marks
    message: str  #: one or two sentences, in the terms of the lab
    evidence: Any = field(default=None, compare=False, repr=False)  #: what a figure shows
    skipped: bool = False  #: there is no such file: the score is 0
    open: bool = False  #: it cannot be judged here: the points are open

    @property
    def passed(self) -> bool:
        """Whether the criterion has full marks."""
        return self.score >= 1.0


#: Score, message and evidence of a finding.
Judged = tuple[float, str] | tuple[float, str, Any]


def judges(criterion: str) -> Callable[[Callable[_P, Judged]], Callable[_P, Finding]]:
    """Make a function that returns score and message return the finding on `criterion`.

    An error of user code becomes a finding without points. NumPy warns of no number: user code can
    return those of any size.
    """

    def decorate(judge: Callable[_P, Judged]) -> Callable[_P, Finding]:
        @wraps(judge)
        def judged(*args: _P.args, **kwargs: _P.kwargs) -> Finding:
            try:
                with np.errstate(all='ignore'):
                    return Finding(criterion, *judge(*args, **kwargs))
            except UserError as error:
                return Finding(criterion, 0.0, str(error))

        return judged

    return decorate
