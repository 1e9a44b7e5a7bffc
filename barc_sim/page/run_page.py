"""Serves the page of a run: live, with buttons and keys, or recorded."""

from __future__ import annotations

import time
from contextlib import suppress
from threading import Event
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from websockets.asyncio.server import broadcast

from barc_sim.control.driver import COAST, FULL_BRAKE, STALE_AFTER, DriverInput
from barc_sim.control.lane import LANE
from barc_sim.errors import UserError
from barc_sim.figures.drawn_log import driven_road
from barc_sim.page.feed import columns_in, laps_in, rows_of
from barc_sim.page.protocol import (
    Pause,
    Press,
    RunFacts,
    Tune,
    encode,
    facts,
    lap_facts,
    road_facts,
    stretch_facts,
    track_facts,
)
from barc_sim.page.server import HOUR, ViewServer
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import LapSettings, lap_settings_of, settings_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from websockets.asyncio.server import ServerConnection

    from barc_sim.page.feed import Feed
    from barc_sim.page.protocol import Request
    from barc_sim.simulation.log import Log
    from barc_sim.simulation.metrics import Laps, TrackLaps

    #: Gets whether the request succeeded, and if not, the reason.
    OnDone = Callable[[bool, str], None]

_SLOW_PERIOD = 0.1  #: [s] between two polls while no page is open
_STATUS_PERIOD = 0.25  #: [s]
_MAX_WAIT = 2.0  #: [s] for the message `end` to be sent


class DriverArbiter:
    """Decides which of several pages drives: the one with the most recent key press.

    A page repeats its input while a key is held. The car must brake if the page closes, or sends
    nothing more, with a key held. Times are of a monotonic clock.
    """

    def __init__(self) -> None:
        self._page: object | None = None  # the page that drives
        self._requests: dict[object, DriverInput] = {}  # the latest of each page
        self._request = COAST  # the accepted one
        self._received = float('-inf')  # [s]

    def accepts(self, page: object, request: DriverInput, now: float) -> bool:
        """Return whether to use the input of `page` at `now` [s].

        A page takes over from another one only with a new key.
        """
        is_new = request != self._requests.get(page)
        self._requests[page] = request
        if page != self._page:
            nobody_drives = self._request == COAST or self._is_stale(now)
            takes_over = request != COAST and (is_new or nobody_drives)
            if not takes_over:
                return False

        self._page = page
        self._request = request
        self._received = now
        return True

    def leave(self, page: object) -> bool:
        """Forget a page that has closed; return whether the car must brake."""
        self._requests.pop(page, None)
        if page != self._page:
            return False
        return self._release()

    def times_out(self, now: float) -> bool:
        """Return whether the car must brake, because no input has come for a while."""
        if not self._is_stale(now):
            return False
        return self._release()

    def _is_stale(self, now: float) -> bool:
        return now - self._received > STALE_AFTER

    def _release(self) -> bool:
        """Release the keys of the page that drives; return whether the car must brake."""
        must_brake = self._request not in (COAST, FULL_BRAKE)
        if must_brake:
            self._request = FULL_BRAKE
        return must_brake


class RunPage(ViewServer):
    """Serves the live page of a run at `url`; the server's thread does all the work.

    Parameters
    ----------
    mode
        `acc` or `teleop`.
    host, port
        Where to serve it.
    run
        What the page shows that no topic has.
    feed
        The states.
    drive
        Publishes a driver's input, without blocking.
    request
        Passes any other request to the simulator or the controller, without blocking, and calls its
        `OnDone` in the server's thread.
    """

    def __init__(
        self,
        mode: str,
        host: str,
        port: int,
        run: RunFacts,
        feed: Feed,
        drive: Callable[[DriverInput], None],
        request: Callable[[Request, OnDone], None],
    ) -> None:
        super().__init__(host, port)
        self._mode = mode
        self.run = run
        self.feed = feed  #: with the laps so far
        self._drive = drive
        self._request = request
        self._drivers = DriverArbiter()

        # Of the sliders.
        self._values = run.values  # as last sent to the pages
        self._settings = LapSettings()  # their values in each lap
        self._values_at_start: dict[str, float] = {}
        self._changed_names: set[str] = set()

        # Of the run.
        self._next_lap = 0  # the first whose results the pages do not have
        self._is_paused = False
        self._has_ended = False
        self._next_status = 0.0

        self.start()

    def end(self, reason: str, bag: str = '') -> None:
        """Show the end of the run on all pages, with the reason and the path of the bag.

        Returns when feed and clients are no longer used. Any thread may call it except the
        server's own.
        """
        end_sent = Event()

        def end() -> None:
            self._send_rows()
            self._send_status()
            self._has_ended = True

            self.feed.laps.end()
            stretches = stretch_facts(self.feed.laps.best or self.feed.laps.current)
            laps = self._lap_facts(self._next_lap)
            self.send(encode('end', reason=reason, bag=bag, laps=laps, stretches=stretches))
            end_sent.set()

        self.call(end)
        end_sent.wait(_MAX_WAIT)

    # Only the server's thread calls the methods below.

    def greet(self) -> Iterator[str | bytes]:
        """Yield the messages for a new page."""
        yield encode('hello', **facts(self._mode, self.run), laps=self._lap_facts())
        yield self.feed.history()

    def receive(self, page: ServerConnection, request: Request) -> None:
        """Handle a page's request."""
        if self._has_ended:
            return

        match request:
            case DriverInput():
                if self._drivers.accepts(page, request, time.monotonic()):
                    self._drive(request)
            case Press('finish'):
                if self.run.finish:
                    self.run.finish()
            case Tune(name, value):
                self._tune(page, request, name, value)
            case _:
                self._pass(page, request)

    def _tune(self, page: ServerConnection, request: Tune, name: str, value: float) -> None:
        try:
            self.run.check(name, value)
        except UserError as error:
            broadcast([page], encode('refused', what=name, why=str(error)))
        else:
            self._pass(page, request)

    def _pass(self, page: ServerConnection, request: Request) -> None:
        """Pass a request to the simulator or the controller, and show the page the outcome."""

        def on_done(is_done: bool, reason: str) -> None:
            if is_done:
                self._confirm(page, request)
            else:
                self._refuse(page, request, reason)

        self._request(request, on_done)

    def leave(self, page: ServerConnection) -> None:
        """Release the keys of a page that has closed; brake if one was held."""
        if self._drivers.leave(page) and not self._has_ended:
            self._drive(FULL_BRAKE)

    def pulse(self) -> float:
        """Send new rows, and from time to time the status; return the time to the next call [s]."""
        if self._has_ended:
            return _SLOW_PERIOD

        now = time.monotonic()
        if self._drivers.times_out(now):
            self._drive(FULL_BRAKE)

        self._send_rows()
        self._note_settings()
        if now >= self._next_status:
            self._next_status = now + _STATUS_PERIOD
            self._send_changed_facts()
            if self.pages:
                self._send_status()

        return self.feed.until_next() if self.pages else _SLOW_PERIOD

    def _send_rows(self) -> None:
        rows = self.feed.poll()
        if rows:
            self.send(rows)

    def _send_changed_facts(self) -> None:
        """Send the facts of the run again if the value of a slider has changed."""
        values = self.run.values
        if values != self._values:
            self._values = values
            self.send(encode('facts', **facts(self._mode, self.run)))

    @property
    def _laps(self) -> Laps | TrackLaps:
        return self.feed.track_laps or self.feed.laps

    def _note_settings(self) -> None:
        """Add the present values of the sliders to the settings of the present lap."""
        values = {name.removeprefix(LANE): value for name, value in self.run.values.items()}
        if not self._values_at_start:
            self._values_at_start = values

        for name, value in values.items():
            if value != self._values_at_start.get(name):
                self._changed_names.add(name)

        if self.feed.time is not None:
            self._settings.add(self._laps.number, self.feed.time, values)

    def _settings_of(self, lap: int) -> str:
        """Return the gains of a lap in words, and what else has been changed in the run."""
        gains = {name.removeprefix(LANE) for name in self.run.gains}
        names = gains | self._changed_names

        def only_named(values: Mapping[str, float]) -> dict[str, float]:
            return {name: value for name, value in values.items() if name in names}

        return settings_text([only_named(values) for values in self._settings.of(lap)])

    def _lap_facts(self, first: int = 0) -> dict[str, Any]:
        """Return the laps, each with its gains; of those that have ended, from `first` on."""
        return lap_facts(self._laps, self._settings_of, first)

    def _send_status(self) -> None:
        laps = self._lap_facts(self._next_lap)
        self._next_lap = self._laps.number

        status = self.run.status()
        is_paused = self._is_paused if status.paused is None else status.paused
        self.send(
            encode(
                'status',
                factor=self.feed.realtime_factor(),
                missed=status.missed,
                laps=laps,
                plan=self.feed.plan,
                paused=is_paused,
            )
        )

    def _confirm(self, page: ServerConnection, request: Request) -> None:
        """Show what a request has changed: a parameter on the page itself, a pause on all pages."""
        match request:
            case Tune(name, value):
                new_value = self.run.values.get(name, value)
                broadcast([page], encode('tuned', name=name, value=new_value))
            case Pause(on):
                self._is_paused = on
                self._send_status()

    def _refuse(self, page: ServerConnection, request: Request, reason: str) -> None:
        """Show on the page why its request was refused."""
        match request:
            case Tune(name):
                broadcast([page], encode('refused', what=name, why=f'{name}: {reason}'))
            case Pause():
                broadcast([page], encode('refused', what='pause', why=reason))
            case Press(button):
                action = button.replace('reset_', 'reset the ')
                broadcast([page], encode('refused', what=action, why=reason))


class GhostRun(NamedTuple):
    """A second run that the page shows beside the first one."""

    log: Log
    title: str


def replay(log: Log, title: str, ghost: GhostRun | None = None) -> list[str | bytes]:
    """Return the messages from which the page replays a run.

    Parameters
    ----------
    log
        The run, with at least one state.
    title
        Its name on the page.
    ghost
        A second run.
    """
    road = driven_road(log)
    is_on_track = isinstance(log, TrackLog)
    is_from_above = is_on_track or bool(np.all(np.isnan(log.reference)))
    fields = facts('teleop' if is_from_above else 'acc', RunFacts())
    fields |= {
        'road': road and road_facts(road),
        'columns': columns_in(log),
        'terms': list(log.terms),
        'replay': {'title': title, 'missed': int(np.count_nonzero(log.missed))},
        'laps': recorded_laps(log),
    }
    if isinstance(log, TrackLog) and log.track:
        fields |= track_facts(log.track)

    messages: list[str | bytes] = [encode('hello', **fields)]
    if ghost:
        ghost_fields = {
            'title': ghost.title,
            'columns': columns_in(ghost.log),
            'laps': recorded_laps(ghost.log),
        }
        messages += [encode('other', **ghost_fields), rows_of(ghost.log)]
    messages.append(rows_of(log))
    return messages


def recorded_laps(log: Log) -> dict[str, Any]:
    """Return the laps of a recorded run, each with its gains."""
    laps, numbers = laps_in(log)
    return lap_facts(laps, lap_settings_of(log, numbers).text)


def serve(log: Log, title: str, host: str, port: int, ghost: GhostRun | None = None) -> None:
    """Serve the page of a recorded run until Ctrl-C; print its address, and open it on desktops.

    Parameters
    ----------
    log, title, ghost
        As of `replay`.
    host, port
        Where to serve it.
    """
    server = ViewServer(host, port, replay(log, title, ghost))

    server.start()
    try:
        with suppress(KeyboardInterrupt):
            print(server.url, flush=True)  # noqa: T201
            server.open_browser()
            while True:
                time.sleep(HOUR)
    finally:
        server.close()
