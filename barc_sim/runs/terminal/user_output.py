"""What user code prints, shown above the line that is drawn in place."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

#: Lines shown in a second; more would be too fast to read, and slow the run.
_LINES_PER_SECOND = 20


class UserOutput:
    r"""Takes text piece by piece, as user code prints it, and shows whole lines.

    A terminal shows some lines a second and how many are left out; a file or a pipe gets all.

    Examples
    --------
    >>> output, shown = UserOutput(), []
    >>> output.show_with(shown.append)
    >>> for text in ('v = ', '8.0\nerror', ' = 0.1'):
    ...     output(text)
    >>> output.close()
    >>> shown
    ['v = 8.0', 'error = 0.1']
    """

    def __init__(self, *, quiet: bool = False) -> None:
        """Show nothing if `quiet`."""
        self._quiet = quiet
        self._all = not sys.stdout.isatty()
        self._show: Callable[[str], None] = _print
        self._rest = ''
        self._left_out = self._shown = 0
        self._second = 0.0

    def show_with(self, show: Callable[[str], None]) -> None:
        """Show whole lines with `show` from now on."""
        self._show = show

    def __call__(self, text: str) -> None:
        """Take `text`."""
        if self._quiet:
            return
        *lines, self._rest = (self._rest + text).split('\n')
        for line in lines:
            self._take(line)

    def _take(self, line: str) -> None:
        now = time.monotonic()
        if now - self._second >= 1.0:
            self._show_left_out()
            self._second, self._shown = now, 0
        if self._all or self._shown < _LINES_PER_SECOND:
            self._shown += 1
            self._show(line)
        else:
            self._left_out += 1

    def _show_left_out(self) -> None:
        if self._left_out:
            self._show(f'… lines left out: {self._left_out} (with > FILE, all are kept)')
            self._left_out = 0

    def close(self) -> None:
        """Show what is left."""
        if self._rest:
            self('\n')
        self._show_left_out()


def _print(line: str) -> None:
    print(line)  # noqa: T201
