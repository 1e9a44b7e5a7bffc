"""Prints a run in the terminal: a live line, and a table at the end."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from math import degrees, inf, isnan
from typing import TYPE_CHECKING

from barc_sim.cli.parser import columns
from barc_sim.control.driver import COAST, DriverInput
from barc_sim.simulation.metrics import LAP_HEADINGS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from rich.console import Console
    from rich.progress import Progress, TaskID

    from barc_sim.interfaces.records import TrackState
    from barc_sim.simulation.metrics import Summary, TrackLaps

_MIN_TIME = 1.0  #: [s] after which a lap that is not finished is shown
_LIVE_PERIOD = 0.1  #: [s] between two drawings of the live line
_PLAIN_PERIOD = 1.0  #: [s] between two plain lines


def cruise_line(
    t: float, distance: float, speed: float, error: float, grade_deg: float, lap: int = 0
) -> str:
    """Return the line of a state: [s], [m], [m/s], [m/s]; the lap is shown from the second on."""
    number = f'lap {lap + 1}  ' if lap else ''
    off = '' if isnan(error) else f'error {error:+.3f} m/s  '
    return f'{number}{t:6.2f} s  {distance:6.1f} m  {speed:6.3f} m/s  {off}grade {grade_deg:+.0f}°'


def track_line(t: float, place: TrackState, speed: float) -> str:
    """Return the line of a state on a track: [s], [m/s]."""
    return (
        f'lap {place.lap + 1}  {place.lap_time:6.2f} s  {place.s:6.1f} m  {speed:6.3f} m/s  '
        f'e_y {place.e_y:+.3f} m  e_psi {degrees(place.e_psi):+.1f}°  run {t:.1f} s'
    )


def drive_line(t: float, speed: float, steering: float, request: DriverInput | None = COAST) -> str:
    """Return the line of a state, whose columns stay in place: [s], [m/s], [rad].

    `request` is None if the driver's input is unknown.
    """
    # Rounded first, and zero added: no negative zero is shown.
    speed = round(speed, 2) + 0.0
    steering_deg = round(degrees(steering), 1) + 0.0
    text = f'{t:7.1f} s  speed {speed:6.2f} m/s  steering {steering_deg:5.1f}°'
    if request is None:
        return text

    is_held = {
        '↑': request.forward > 0.0,
        '↓': request.forward < 0.0,
        '←': request.turn > 0.0,
        '→': request.turn < 0.0,
        'brake': request.brake > 0.0,
    }
    symbols = [symbol for symbol, on in is_held.items() if on]
    return f'{text}  held {" ".join(symbols) or "-"}'


def _console() -> Console:
    from rich.console import Console  # noqa: PLC0415 (slow: not before a run)

    return Console(highlight=False)


class Display:
    """Shows the states of a run: a line drawn in place in a terminal, else one line a second.

    The caller's thread draws the line right after a step, when the next step is furthest away:
    another thread would hold the interpreter's lock when a step is due. If the terminal is gone,
    nothing is drawn: its signal ends the run. The output of user code appears above the line.
    """

    def __init__(self, distance: float | None = None) -> None:
        """Draw also a bar to `distance` [m], if given; the bar pulses if that is infinite."""
        self._progress = _progress(distance) if sys.stdout.isatty() else None
        self._task: TaskID | None = None
        self._total = None if distance == inf else distance
        self._period = _LIVE_PERIOD if self._progress else _PLAIN_PERIOD
        self._next = 0.0
        self._latest: tuple[float, Callable[[], str]] | None = None

    def show(self, distance: float, line: Callable[[], str]) -> None:
        """Draw the line of a state, `distance` [m] from the start, unless the last is recent."""
        self._latest = (distance, line)
        now = time.monotonic()
        if now >= self._next:
            self._next = now + self._period
            self._draw()

    def _draw(self) -> None:
        if not self._latest:
            return

        distance, line = self._latest
        if not self._progress:
            print(line(), flush=True)  # noqa: T201
            return

        self._progress.console.width = _live_columns()
        with suppress(OSError):
            self._progress.start()
            if self._task is None:
                self._task = self._progress.add_task('', total=self._total)
            self._progress.update(self._task, completed=distance, description=line(), refresh=True)

    def close(self) -> None:
        """Draw the last state, and go to the next line."""
        if self._progress:
            self._draw()
            with suppress(OSError):
                self._progress.stop()


def _live_columns() -> int:
    """Return how many columns the live line can have.

    There is room for the terminal's ^C behind it: a line that wraps is not overwritten.
    """
    return max(columns() - len('^C'), 1)


def _progress(distance: float | None) -> Progress:
    from rich.progress import BarColumn, Progress, TextColumn  # noqa: PLC0415
    from rich.table import Column  # noqa: PLC0415

    bar = [] if distance is None else [BarColumn(bar_width=24)]
    text = TextColumn('{task.description}', table_column=Column(no_wrap=True))
    return Progress(*bar, text, console=_console(), auto_refresh=False)


def print_summary(summary: Summary, late: str) -> None:
    """Print the table of a run's speed errors and other metrics; `late` names missed deadlines."""
    rows = [
        _error_row('whole run', '', summary.rms_error, summary.max_error),
        _error_row(
            'after 10 m', '', summary.rms_error_after_run_up, summary.max_error_after_run_up
        ),
    ]
    for part in summary.stretches:
        place = f'{part.start:5.1f} to {part.end:5.1f} m'
        rows.append(_error_row(place, f'{part.theta_deg:+.0f}°', part.rms_error, part.max_error))

    headings = ('Speed error', '', 'grade', 'RMS, m/s', 'maximum, m/s')
    overshoot = _figure('.1%', summary.overshoot)
    settling_time = _figure('.2f', summary.settling_time)
    footer = f'overshoot {overshoot}, settling time (2 %) {settling_time} s, {late}'
    _print_table(headings, rows, footer)


def _error_row(place: str, grade: str, rms: float, maximum: float) -> tuple[str, ...]:
    return place, grade, _figure('.4f', rms), _figure('.4f', maximum)


def print_summaries(kind: str, summaries: Mapping[str, Summary], late: str) -> None:
    """Print a line for each car or lap, the `kind`, by its name; `late` names all delays.

    A lap that a reset has cut short has a line, too.
    """
    rows = [
        (
            name,
            _figure('.4f', summary.rms_error_after_run_up),
            _figure('.4f', summary.max_error_after_run_up),
            _figure('.1%', summary.overshoot),
            _figure('.2f', summary.settling_time),
        )
        for name, summary in summaries.items()
    ]

    headings = (
        'Speed error after 10 m',
        kind,
        'RMS, m/s',
        'maximum, m/s',
        'overshoot',
        'settling, s',
    )
    _print_table(headings, rows, late)


def print_track_laps(cars: Mapping[str, TrackLaps], late: str) -> None:
    """Print a line for each lap of a track, by the name of the car, and the best laps.

    A last lap that is not finished has a line, too; `late` names all delays.
    """
    rows: list[Sequence[str]] = []
    footer: list[str] = []
    for name, laps in cars.items():
        table_laps = [*laps.finished]
        if not table_laps or laps.current.time > _MIN_TIME:
            table_laps.append(laps.current)

        for lap in table_laps:
            number = lap.cells[0]
            figures = lap.cells[1:]
            rows.append((f'{name} {number}'.strip(), *figures))

        if laps.best:
            footer.append(f'{name} best lap {laps.best.time:.2f} s'.strip())

    _print_table(('Laps', *LAP_HEADINGS), rows, *footer, late)


def _print_table(headings: Sequence[str], rows: Iterable[Sequence[str]], *footer: str) -> None:
    """Print a table, whose title is the first of the `headings`, and the lines of its footer."""
    from rich.table import Table  # noqa: PLC0415

    table = Table(box=None, pad_edge=False)
    table.add_column(headings[1], no_wrap=True)
    for heading in headings[2:]:
        table.add_column(heading, justify='right')
    for row in rows:
        table.add_row(*row)

    console = _console()
    console.print(headings[0])
    console.print(table)
    for line in footer:
        console.print(line)


def _figure(form: str, value: float) -> str:
    return '–' if isnan(value) else format(value, form)  # noqa: RUF001 (a dash for no value)
