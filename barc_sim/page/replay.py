"""Serves a recorded run in the live page, with a time slider."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.figures.style import QUANTITIES, motor_limit, term_colours
from barc_sim.figures.track_figure import Course
from barc_sim.page.feed import columns_in, rows_of
from barc_sim.page.protocol import (
    driven_road,
    encode,
    facts,
    lap_facts,
    road_facts,
    track_facts,
    track_lap_facts,
)
from barc_sim.page.server import Host, ViewServer, open_page
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import laps_of, track_laps_of

if TYPE_CHECKING:
    from barc_sim.simulation.log import Log

_LONG = 3600.0  #: [s]


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
            self._messages[1:1] = other_run(*other)

    def greet(self) -> list[str | bytes]:
        """Return the messages with the whole run."""
        return list(self._messages)


def other_run(log: Log, title: str) -> list[str | bytes]:
    """Return the messages that show a second run beside the first."""
    return [encode('other', title=title, columns=columns_in(log), laps=_laps(log)), rows_of(log)]


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
                time.sleep(_LONG)
    finally:
        server.close()
