"""The page of a run: live, with its buttons and keys, or recorded."""

from __future__ import annotations

import time
from contextlib import suppress
from functools import partial
from threading import Event
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.control.cruise_control import LANE_TYPES, TYPES
from barc_sim.control.lane import LANE
from barc_sim.control.speed import PID
from barc_sim.figures.style import QUANTITIES, driven_road, motor_limit, term_colours
from barc_sim.figures.track_figure import Course
from barc_sim.page.feed import columns_in, rows_of
from barc_sim.page.protocol import (
    CONTROLLER,
    OF_SIMULATOR,
    OTHERS,
    SIMULATOR,
    Drive,
    Pause,
    Press,
    Status,
    Tune,
    encode,
    facts,
    lap_facts,
    road_facts,
    stretch_facts,
    track_facts,
    track_lap_facts,
)
from barc_sim.page.server import HOUR, Host, ViewServer, open_page
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import laps_of, track_laps_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from barc_sim.control.speed import Controller
    from barc_sim.page.feed import Feed
    from barc_sim.page.protocol import Request
    from barc_sim.page.server import Page
    from barc_sim.simulation.log import Log
    from barc_sim.simulation.metrics import Laps
    from barc_sim.vehicle.road import Road

    #: Called with whether the request succeeded, and if not, with the reason.
    OnDone = Callable[[bool, str], None]
    OnValues = Callable[[dict[str, Any]], None]  # called with parameters

_SLOW_PERIOD = 0.1  #: [s] between two polls while no page is open
_STATUS_PERIOD = 0.25  #: [s]
_MAX_WAIT = 2.0  #: [s] for the message of the end
_RETRY_AFTER = 1.0  #: [s] after which an unanswered request is repeated

STALE = 0.5  #: [s] without a message of the driving page after which its keys count as released
_PERIOD = 0.05  #: [s] between two commands while a key is held
_REST = Drive()
_BRAKE = Drive(brake=1.0)
_HELD = (_REST, _BRAKE)  #: sent once: they hold until the next command


class HeldKeys:
    """The keys that pages hold: those pressed last count, on whichever page.

    While a key is held, `due` returns a command every 50 ms; after its release zero once, then
    nothing, so that other publishers of `cmd_vel` are not overridden. If the page closes or falls
    silent with a key held, the brake takes the place of zero. Times are of a monotonic clock.
    """

    def __init__(self) -> None:
        self._page: object | None = None  # whose keys count
        self._command = self._sent = _REST
        self._received = self._published = float('-inf')  # [s]

    def hold(self, page: object, command: Drive, now: float) -> None:
        """Take the command of `page` at `now` [s]; without a key, it stops no other page."""
        if page == self._page or command != _REST:
            self._page, self._command, self._received = page, command, now

    def leave(self, page: object) -> None:
        """Brake if the closed `page` held a key."""
        if page == self._page:
            self._release()

    def due(self, now: float) -> Drive | None:
        """Return the command to publish at `now` [s], or None."""
        if now - self._received > STALE:
            self._release()
        is_new, waits = self._command != self._sent, now - self._published < _PERIOD
        if not is_new and (waits or self._command in _HELD):
            return None
        self._sent, self._published = self._command, now
        return self._command

    def _release(self) -> None:
        if self._command != _REST:
            self._command = _BRAKE


class RunPage(Host):
    """Serves the page at `url`; the server's thread does the work, between two steps."""

    def __init__(
        self,
        mode: str,
        host: str,
        port: int,
        status: Callable[[], Status],
        road: Road | None,
        finish: Callable[[], None] | None = None,
    ) -> None:
        """Take the port; `start` serves the page.

        `status` returns the facts that no topic carries, from the first state on. `road` replaces
        the one that the simulator's parameter names. `finish` ends the run; without it, the page
        cannot.
        """
        self._mode = mode
        self._status = status
        self._road = road
        self._finish = finish
        self._keys = HeldKeys()
        self._parameters: dict[str, dict[str, Any]] = {SIMULATOR: {}, CONTROLLER: {}}  # by node
        self._kind: type[Controller] | None = None  # of the controller, None until it is received
        self._lane: str | None = None  # on a track, the type of the lane controller; likewise
        self._retry_at: dict[str, float] = {}
        self._gains: dict[int, list[str]] = {}  # by lap, one after another
        self._paused = False
        self._has_ended = False
        self._next_status = 0.0
        self._server = ViewServer(self, host, port)
        self.url = self._server.url  #: with its token: anyone with this link can drive
        self.call = self._server.call  #: calls a function in the server's thread

    def start(
        self,
        feed: Feed,
        drive: Callable[[Drive], None],
        request: Callable[[Request, OnDone], None],
        parameters: Callable[[str, Sequence[str], OnValues], bool],
        changes: Callable[[], Iterable[tuple[str, str, float]]],
    ) -> None:
        """Serve the page.

        `feed` has the states; `drive` publishes a driver's input; `request` passes any other
        request to the simulator or the controller; `parameters` requests parameters of a node,
        and returns False if it is not there; `changes` returns those that have changed since the
        last call: node, name and value. None waits, and what is passed back is called in the
        server's thread.
        """
        self._feed, self._drive, self._request = feed, drive, request
        self._parameters_of, self._changes = parameters, changes
        self._server.start()

    @property
    def seen(self) -> int:
        """Number of states taken."""
        return self._feed.seen

    @property
    def laps(self) -> Laps:
        """The laps of the run so far."""
        return self._feed.laps

    def end(self, reason: str, bag: str = '') -> None:
        """Show the pages the end of the run, its reason and `bag`, the bag's path.

        Returns when the feed and the clients are not used any more. May be called from any thread
        but the server's.
        """
        done = Event()

        def end() -> None:
            self._end(reason, bag)
            done.set()

        self._server.call(end)
        done.wait(_MAX_WAIT)

    def close(self) -> None:
        """Close all pages and the port."""
        self._server.close()

    # The server's thread calls the methods below.

    def greet(self) -> Iterator[str | bytes]:
        """Yield the messages for a new page."""
        yield encode('hello', **self._facts())
        yield self._feed.history()

    def _facts(self) -> dict[str, Any]:
        kind, (simulator, controller) = self._kind or PID, self._parameters.values()
        fields = facts(self._mode, simulator, controller, kind, self._road, self._lane or '')
        return fields | {'can_finish': self._finish is not None}

    def receive(self, page: Page, request: Request) -> None:
        """Handle a page's request."""
        match request:
            case _ if self._has_ended:
                pass
            case Drive():
                now = time.monotonic()
                self._keys.hold(page, request, now)
                self._publish(now)
            case Press('finish'):
                if self._finish:
                    self._finish()
            case Pause(on):
                self._request(request, partial(self._on_paused, page, on))
            case Tune() | Press('reset' | 'reset_controller'):
                what = request[0].replace('reset_', 'reset the ')
                self._request(request, partial(self._on_done, page, what))

    def leave(self, page: Page) -> None:
        """Release the keys of a page that has closed."""
        if self._has_ended:
            return
        self._keys.leave(page)
        self._publish(time.monotonic())

    def pulse(self) -> float:
        """Send new rows and, in turn, the status; return the time to the next call [s]."""
        if self._has_ended:
            return _SLOW_PERIOD
        now = time.monotonic()
        self._publish(now)
        if rows := self._feed.poll():
            self._server.send(rows)
        if now >= self._next_status:
            self._next_status = now + _STATUS_PERIOD
            self._update_parameters()
            if self._server.pages:
                self._send_status()
        return self._feed.until_next() if self._server.pages else _SLOW_PERIOD

    def _lap_gains(self) -> dict[int, list[str]]:
        """Return the gains of each lap, with those of the present one now."""
        values = self._parameters[CONTROLLER]
        names = self._lane_gains() if self._lane else [*(self._kind or PID).gains]
        shown = {name.removeprefix(LANE): values[name] for name in names if name in values}
        now = ', '.join(f'{name} {value:g}' for name, value in shown.items())
        laps = self._feed.track_laps if self._feed.is_on_track else self.laps
        seen = self._gains.setdefault(laps.current.number, [])
        if now and seen[-1:] != [now]:
            seen.append(now)
        return self._gains

    def _lane_gains(self) -> list[str]:
        law = LANE_TYPES.get(self._lane or '')
        return [LANE + name for name in law.gains] if law else []

    def _lap_facts(self) -> dict[str, Any]:
        if self._feed.is_on_track:
            return track_lap_facts(self._feed.track_laps, self._lap_gains())
        return lap_facts(self.laps, self._lap_gains())

    def _publish(self, now: float) -> None:
        if command := self._keys.due(now):
            self._drive(command)

    def _send_status(self) -> None:
        missed, paused = self._status() if self.seen else Status()
        message = encode(
            'status',
            factor=self._feed.realtime_factor(),
            missed=missed,
            laps=self._lap_facts(),
            plan=self._feed.plan,
            paused=self._paused if paused is None else paused,
        )
        for page in self._server.pages:
            page.send(message)

    def _update_parameters(self) -> None:
        """Request the parameters that are unknown, and take those that have changed."""
        if not self._parameters[SIMULATOR]:
            on_values = partial(self._on_parameters, SIMULATOR)
            self._ask(SIMULATOR, OF_SIMULATOR, on_values)
        if self._kind is None:
            self._ask(CONTROLLER, ('controller_type',), self._on_controller_type)
        elif self._lane is None and self._parameters[SIMULATOR].get('track'):
            self._ask(CONTROLLER, ('lane_type',), self._on_lane_type)
        elif not self._parameters[CONTROLLER]:
            on_values = partial(self._on_parameters, CONTROLLER)
            wanted = (*self._kind.gains, *OTHERS, *self._lane_gains())
            self._ask(CONTROLLER, wanted, on_values)
        for node, name, value in self._changes():
            self._on_parameters(node, {name: value})

    def _ask(self, node: str, parameters: Sequence[str], on_values: OnValues) -> None:
        """Request parameters of a node, unless a recent request is still unanswered."""
        now = time.monotonic()
        if now >= self._retry_at.get(node, 0.0) and self._parameters_of(
            node, parameters, on_values
        ):
            self._retry_at[node] = now + _RETRY_AFTER

    def _on_controller_type(self, values: dict[str, Any]) -> None:
        """Take the declaration of the controller's type; the PID's if it names none."""
        self._kind = TYPES.get(values.get('controller_type', ''), PID)
        self._retry_at.pop(CONTROLLER, None)
        self._update_parameters()

    def _on_lane_type(self, values: dict[str, Any]) -> None:
        """Take the type of the lane controller; a user's own has none."""
        self._lane = values.get('lane_type', '')
        self._parameters[CONTROLLER].clear()
        self._retry_at.pop(CONTROLLER, None)
        self._update_parameters()

    def _on_parameters(self, node: str, values: dict[str, Any]) -> None:
        self._parameters[node].update(values)
        self._server.send(encode('facts', **self._facts()))

    def _on_done(self, page: Page, what: str, done: bool, why: str) -> None:
        if not done:
            page.send(encode('refused', what=what, why=why))

    def _on_paused(self, page: Page, on: bool, done: bool, why: str) -> None:
        if done:
            self._paused = on
            self._send_status()
        self._on_done(page, 'pause', done, why)

    def _end(self, reason: str, bag: str) -> None:
        if rows := self._feed.poll():
            self._server.send(rows)
        self._has_ended = True
        stretches = stretch_facts(self.laps.best or self.laps.current)
        laps = self._lap_facts()
        self._server.send(encode('end', reason=reason, bag=bag, laps=laps, stretches=stretches))


class Replay(Host):
    """A recorded run, sent whole to every page that opens; the page plays it."""

    def __init__(self, log: Log, title: str, other: tuple[Log, str] | None = None) -> None:
        """Show a run of at least one state; `other`, a run and its title, as a ghost beside it."""
        road = driven_road(log)
        mode = 'teleop' if np.all(np.isnan(log.reference)) else 'acc'
        hello = encode(
            'hello',
            **{
                **facts(mode, {'motor_limit': motor_limit(log)}, {}),
                'road': road and road_facts(road),
                'columns': columns_in(log),
                'terms': list(log.terms),
                'colours': QUANTITIES | term_colours((*log.terms,)),
                **(track_facts(Course.driven(log)) if isinstance(log, TrackLog) else {}),
            },
            replay={'title': title, 'missed': int(np.count_nonzero(log.missed))},
            laps=_laps(log),
        )
        self._messages: list[str | bytes] = [hello, rows_of(log)]
        if other:
            second, name = other
            more = encode('other', title=name, columns=columns_in(second), laps=_laps(second))
            self._messages[1:1] = [more, rows_of(second)]

    def greet(self) -> list[str | bytes]:
        """Return the messages with the whole run."""
        return list(self._messages)


def _laps(log: Log) -> dict[str, Any]:
    if isinstance(log, TrackLog):
        return track_lap_facts(track_laps_of(log)[0])
    return lap_facts(laps_of(log)[0])


def serve(log: Log, title: str, host: str, port: int, other: tuple[Log, str] | None = None) -> None:
    """Serve the page until Ctrl-C; print its address, and open it where there is a desktop."""
    server = ViewServer(Replay(log, title, other), host, port)
    server.start()
    try:
        with suppress(KeyboardInterrupt):
            print(server.url, flush=True)  # noqa: T201
            open_page(server.url)
            while True:
                time.sleep(HOUR)
    finally:
        server.close()
