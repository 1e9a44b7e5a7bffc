"""What a run shows in the terminal: a live line, what user code prints, a table at the end."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from math import degrees, isnan
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.control.driver import COAST, DriverInput

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rich.console import Console
    from rich.progress import ProgressColumn

    from barc_sim.simulation.metrics import Summary

#: [s] between two drawings of the live line, and between two plain lines.
_LIVE_PERIOD = 0.1
_PLAIN_PERIOD = 1.0
#: Lines shown in a second; more would be too fast to read, and slow the run.
_LINES_PER_SECOND = 20


class CruiseStatus(NamedTuple):
    """A state of the cruise control."""

    t: float  #: [s]
    distance: float  #: [m]
    speed: float  #: [m/s]
    error: float  #: [m/s]
    grade_deg: float
    lap: int = 0  #: shown from 1, the second one, on

    def text(self) -> str:
        """Return the line for it."""
        lap = f'lap {self.lap + 1}  ' if self.lap else ''
        return (
            f'{lap}{self.t:6.2f} s  {self.distance:6.1f} m  {self.speed:6.3f} m/s  '
            f'error {self.error:+.3f} m/s  grade {self.grade_deg:+.0f}°'
        )


class DriveStatus(NamedTuple):
    """A state of a drive by hand."""

    t: float  #: [s]
    distance: float  #: [m]
    speed: float  #: [m/s]
    steering: float  #: [rad]
    request: DriverInput | None = COAST  #: None: it is unknown

    def text(self) -> str:
        """Return the line for it; its columns stay in place."""
        # Rounded first, and zero added: no negative zero is shown.
        speed, steering = round(self.speed, 2) + 0.0, round(degrees(self.steering), 1) + 0.0
        text = f'{self.t:7.1f} s  speed {speed:6.2f} m/s  steering {steering:5.1f}°'
        request = self.request
        if request is None:
            return text
        held = {
            '↑': request.forward > 0.0,
            '↓': request.forward < 0.0,
            '←': request.turn > 0.0,
            '→': request.turn < 0.0,
            'brake': request.brake > 0.0,
        }
        return f'{text}  held {" ".join(symbol for symbol, on in held.items() if on) or "-"}'


Status = CruiseStatus | DriveStatus


class Display:
    """Shows the states of a run; this one shows nothing."""

    def show(self, status: Status) -> None:
        """Take a state; the display decides whether to draw it."""

    def print_line(self, line: str) -> None:
        """Print a line of user code's output."""

    def close(self) -> None:
        """Leave the terminal in order."""


def display(*, quiet: bool, distance: float | None = None) -> Display:
    """Return the display that suits the terminal.

    With a `distance` [m] a bar shows how far the run is; it pulses for 0, a run without an end.
    """
    if quiet:
        return Display()
    if not sys.stdout.isatty():
        return PlainLines()
    return LiveLine(_console(), distance)


def _console() -> Console:
    from rich.console import Console  # noqa: PLC0415 (slow: not before a run)

    return Console(highlight=False)


class PlainLines(Display):
    """Prints a line a second, for a pipe or a file."""

    def __init__(self) -> None:
        """Print at the first state."""
        self._next = 0.0

    def show(self, status: Status) -> None:
        """Print a line if the last is a second old."""
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _PLAIN_PERIOD
            print(status.text(), flush=True)  # noqa: T201

    def print_line(self, line: str) -> None:
        """Print a line."""
        print(line)  # noqa: T201


class LiveLine(Display):
    """Draws a line in place, with a bar if the run has a distance.

    The caller's thread draws it, right after a step, when the next is furthest away: a
    thread of its own would hold the interpreter's lock when a step is due. If the terminal is
    gone, nothing is drawn: its signal ends the run.
    """

    def __init__(self, console: Console, distance: float | None) -> None:
        """Draw a bar to `distance` [m], one that pulses for 0, or none for None."""
        from rich.progress import BarColumn, Progress, TextColumn  # noqa: PLC0415
        from rich.table import Column  # noqa: PLC0415

        columns: list[ProgressColumn] = [] if distance is None else [BarColumn(bar_width=24)]
        text = TextColumn('{task.description}', table_column=Column(no_wrap=True))
        self._progress = Progress(*columns, text, console=console, auto_refresh=False)
        self._task = self._progress.add_task('', total=distance or None)
        self._next = 0.0
        self._latest: Status | None = None

    def show(self, status: Status) -> None:
        """Draw if the last drawing is a tenth of a second old."""
        self._latest = status
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _LIVE_PERIOD
            self._draw()

    def _draw(self) -> None:
        if self._latest:
            with suppress(OSError):
                self._progress.start()
                self._progress.update(
                    self._task,
                    completed=self._latest.distance,
                    description=self._latest.text(),
                    refresh=True,
                )

    def print_line(self, line: str) -> None:
        """Print a line above the one that is drawn."""
        with suppress(OSError):
            self._progress.console.print(line, markup=False, soft_wrap=True)

    def close(self) -> None:
        """Draw the last state and go to the next line."""
        self._draw()
        with suppress(OSError):
            self._progress.stop()


class UserOutput:
    """Takes text piece by piece, as user code prints it, and shows whole lines.

    A terminal shows some lines a second and how many are left out; a file or a pipe gets all.
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


def print_summary(summary: Summary, slipped: int) -> None:
    """Print the table of a run's speed errors, and its other figures.

    `slipped` is the number of periods by which simulated time fell behind the wall clock.
    """
    from rich.table import Table  # noqa: PLC0415

    console = _console()
    table = Table(title='Speed error', title_justify='left', box=None, pad_edge=False)
    for heading in ('', 'grade', 'RMS, m/s', 'maximum, m/s'):
        table.add_column(heading, justify='left' if not heading else 'right')
    rows = [
        ('whole run', '', summary.rms_error, summary.max_error),
        ('after 10 m', '', summary.rms_error_after_run_up, summary.max_error_after_run_up),
    ]
    for part in summary.stretches:
        where = f'{part.start:5.1f} to {part.end:5.1f} m'
        rows.append((where, f'{part.theta_deg:+.0f}°', part.rms_error, part.max_error))
    for where, grade, rms, maximum in rows:
        table.add_row(where, grade, _figure(rms, '.4f'), _figure(maximum, '.4f'))
    console.print(table)
    console.print(
        f'overshoot {_figure(summary.overshoot, ".1%")}, '
        f'settling time (2 %) {_figure(summary.settling_time, ".2f")} s, '
        f'missed deadlines {summary.missed_deadlines}, clock slips {slipped}'
    )


def print_summaries(kind: str, summaries: Mapping[str, Summary], slipped: int) -> None:
    """Print a line for each car or lap, the `kind`, by its name; `slipped` is all cars' together.

    A lap that a reset has cut short has its line, too.
    """
    from rich.table import Table  # noqa: PLC0415

    console = _console()
    table = Table(title='Speed error after 10 m', title_justify='left', box=None, pad_edge=False)
    headings = ('RMS, m/s', 'maximum, m/s', 'overshoot', 'settling, s', 'missed')
    table.add_column(kind, no_wrap=True)
    for heading in headings:
        table.add_column(heading, justify='right')
    for name, summary in summaries.items():
        table.add_row(
            name,
            _figure(summary.rms_error_after_run_up, '.4f'),
            _figure(summary.max_error_after_run_up, '.4f'),
            _figure(summary.overshoot, '.1%'),
            _figure(summary.settling_time, '.2f'),
            str(summary.missed_deadlines),
        )
    console.print(table)
    missed = sum(summary.missed_deadlines for summary in summaries.values())
    console.print(f'missed deadlines {missed}, clock slips {slipped}')


def _figure(value: float, form: str) -> str:
    return '–' if isnan(value) else format(value, form)  # noqa: RUF001 (what tables have there)
