"""What a run shows in the terminal: a live line, and a table at the end."""

from __future__ import annotations

import time
from math import isnan
from typing import TYPE_CHECKING, Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.simulation.metrics import Summary

#: [s] between two drawings of the live line, and between two plain lines.
_LIVE_PERIOD = 0.1
_PLAIN_PERIOD = 1.0


class Display(Protocol):
    """Shows how far a run is."""

    def show(self, t: float, distance: float, speed: float, error: float, grade: float) -> None:
        """Take note of a state; what is drawn, and when, is the display's choice."""

    def say(self, line: str) -> None:
        """Print a line of somebody else's."""

    def close(self) -> None:
        """Leave the terminal in order."""


def display(distance: float, *, quiet: bool) -> Display:
    """Return what suits the terminal, for a run of `distance` [m]; 0 for one without end."""
    if quiet:
        return Nothing()
    console = Console(highlight=False)
    return LiveLine(console, distance) if console.is_terminal else PlainLines()


class Nothing:
    """Shows nothing."""

    def show(self, t: float, distance: float, speed: float, error: float, grade: float) -> None:
        """Do nothing."""

    def say(self, line: str) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


def _text(t: float, distance: float, speed: float, error: float, grade: float) -> str:
    return (
        f'{t:6.2f} s  {distance:6.1f} m  {speed:6.3f} m/s  error {error:+.3f} m/s  '
        f'grade {grade:+.0f}°'
    )


class PlainLines:
    """A line a second, for a pipe or a file."""

    def __init__(self) -> None:
        """Print at the first state."""
        self._next = 0.0

    def show(self, t: float, distance: float, speed: float, error: float, grade: float) -> None:
        """Print a line if the last is a second old."""
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _PLAIN_PERIOD
            print(_text(t, distance, speed, error, grade), flush=True)  # noqa: T201

    def say(self, line: str) -> None:
        """Print a line."""
        print(line)  # noqa: T201

    def close(self) -> None:
        """Do nothing."""


class LiveLine:
    """A bar and figures, drawn in place.

    It is drawn by the caller's thread, right after a step, when there is most time until the next:
    a thread of its own would hold the interpreter's lock when a step is due.
    """

    def __init__(self, console: Console, distance: float) -> None:
        """Draw a bar to `distance` [m]; a pulse where that is 0."""
        self._progress = Progress(
            BarColumn(bar_width=24),
            TextColumn('{task.description}'),
            console=console,
            auto_refresh=False,
        )
        self._task = self._progress.add_task('', total=distance or None)
        self._next = 0.0
        self._latest: tuple[float, float, float, float, float] | None = None

    def show(self, t: float, distance: float, speed: float, error: float, grade: float) -> None:
        """Draw if the last drawing is a tenth of a second old."""
        self._latest = (t, distance, speed, error, grade)
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _LIVE_PERIOD
            self._draw()

    def _draw(self) -> None:
        if self._latest:
            self._progress.start()
            self._progress.update(
                self._task,
                completed=self._latest[1],
                description=_text(*self._latest),
                refresh=True,
            )

    def say(self, line: str) -> None:
        """Print a line above the one that is drawn."""
        self._progress.console.print(line, markup=False, soft_wrap=True)

    def close(self) -> None:
        """Draw the last state and go to the next line."""
        self._draw()
        self._progress.stop()


def print_summary(summary: Summary, slipped: int) -> None:
    """Print the table of a run's speed errors, and its other figures.

    `slipped` is the number of periods by which simulated time fell behind the wall clock.
    """
    console = Console(highlight=False)
    table = Table(title='Speed error', title_justify='left', box=None, pad_edge=False)
    for heading in ('', 'grade', 'RMS, m/s', 'greatest, m/s'):
        table.add_column(heading, justify='left' if not heading else 'right')
    rows = [
        ('whole run', '', summary.rms_error, summary.max_error),
        ('after 10 m', '', summary.rms_error_after_run_up, summary.max_error_after_run_up),
    ]
    for part in summary.stretches:
        where = f'{part.start:5.1f} to {part.end:5.1f} m'
        rows.append((where, f'{part.theta_deg:+.0f}°', part.rms_error, part.max_error))
    for where, grade, rms, greatest in rows:
        table.add_row(where, grade, _figure(rms, '.4f'), _figure(greatest, '.4f'))
    console.print(table)
    console.print(
        f'overshoot {_figure(summary.overshoot, ".1%")}, '
        f'settling time (2 %) {_figure(summary.settling_time, ".2f")} s, '
        f'missed deadlines {summary.missed_deadlines}, clock slips {slipped}'
    )


def print_summaries(summaries: Mapping[str, Summary], slipped: int) -> None:
    """Print a line for each car, by its name; `slipped` is all cars' together."""
    console = Console(highlight=False)
    table = Table(title='Speed error after 10 m', title_justify='left', box=None, pad_edge=False)
    for heading in ('car', 'RMS, m/s', 'greatest, m/s', 'missed deadlines'):
        table.add_column(heading, justify='left' if heading == 'car' else 'right')
    for name, summary in summaries.items():
        table.add_row(
            name,
            _figure(summary.rms_error_after_run_up, '.4f'),
            _figure(summary.max_error_after_run_up, '.4f'),
            str(summary.missed_deadlines),
        )
    console.print(table)
    console.print(f'clock slips {slipped}')


def _figure(value: float, form: str) -> str:
    return '–' if isnan(value) else format(value, form)  # noqa: RUF001 (what tables have there)
