"""The code of a submission, called in a confined process."""

from __future__ import annotations

import time
from collections import Counter
from typing import TYPE_CHECKING, Any

from barc_sim.lab.check.code import JudgedCode
from barc_sim.lab.confined.process import Ended, Failed, Limits, Process
from barc_sim.lab.user_code.call import without_addresses
from barc_sim.lab.user_code.loading import find_file
from barc_sim.lab.user_code.source import UserCodeError

if TYPE_CHECKING:
    from pathlib import Path

    from typing_extensions import Self

_MAX_ENDS = 2  # a function that has ended its process so often is not called again
#: The user's name for what a request calls.
_CALLED = {'model': 'bikeFE', 'relay': 'relay', 'notes': 'notes'}


class ConfinedCode(JudgedCode):
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
        super().__init__()

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

    def call(self, do: str, *arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        """Return the result of a request.

        Raises
        ------
        UserCodeError
            if the function fails or ends its process.
        """
        function = _CALLED.get(do, 'PID')
        if self._ends[function] >= _MAX_ENDS:
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
