"""What a drive by hand shows in the terminal: one line, drawn in place."""

from __future__ import annotations

import shutil
import sys
import time
from contextlib import suppress
from math import degrees
from typing import NamedTuple

from barc_sim.control.driver import COAST, DriverInput

#: [s] between two drawings in a terminal, and between two lines elsewhere.
_LIVE_PERIOD = 0.1
_PLAIN_PERIOD = 1.0
#: Python 3.10 says 0 where a terminal does not tell its size.
_UNKNOWN_WIDTH = 80


class Status(NamedTuple):
    """What is shown."""

    t: float  #: [s] of the drive
    speed: float  #: [m/s]
    steering: float  #: [rad]
    request: DriverInput = COAST


class StatusLine:
    """Draws in the caller's thread, now and then."""

    def __init__(self, *, quiet: bool = False) -> None:
        """Draw on stdout unless `quiet`."""
        self._live = sys.stdout.isatty()
        self._period = _LIVE_PERIOD if self._live else _PLAIN_PERIOD
        self._next = float('inf') if quiet else 0.0
        self._drawn = False

    def is_due(self) -> bool:
        """Return whether a status would be drawn now."""
        return time.monotonic() >= self._next

    def show(self, status: Status) -> None:
        """Draw if the last drawing is old enough."""
        if not self.is_due():
            return
        self._next = time.monotonic() + self._period
        self._drawn = True
        line = text(status)
        if not self._live:
            print(line, flush=True)  # noqa: T201
            return
        width = shutil.get_terminal_size().columns or _UNKNOWN_WIDTH
        # Not to the last column: the terminal would go on to the next line.
        self._write(f'\r\x1b[K{line[: width - 1]}')

    def say(self, line: str) -> None:
        """Print a line of somebody else's; the next drawing is below it."""
        self._write(f'\r\x1b[K{line}\n' if self._live else f'{line}\n')

    def close(self) -> None:
        """Go to the next line."""
        if self._live and self._drawn:
            self._write('\n')

    def _write(self, data: str) -> None:
        with suppress(OSError):  # a terminal that is gone: its signal ends the run in order
            sys.stdout.write(data)
            sys.stdout.flush()


def text(status: Status) -> str:
    """Return the line for `status`; its columns stay where they are."""
    request = status.request
    held = {
        '↑': request.forward > 0.0,
        '↓': request.forward < 0.0,
        '←': request.turn > 0.0,
        '→': request.turn < 0.0,
        'brake': request.brake > 0.0,
    }
    # Rounded first, and zero added: no negative zero is shown.
    speed, steering = round(status.speed, 2) + 0.0, round(degrees(status.steering), 1) + 0.0
    return (
        f'{status.t:7.1f} s  speed {speed:6.2f} m/s  steering {steering:5.1f}°  '
        f'held {" ".join(symbol for symbol, on in held.items() if on) or "-"}'
    )
