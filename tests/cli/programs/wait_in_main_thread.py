"""Wait in the main thread for a lock, which a signal is to release."""

from __future__ import annotations

import threading

from barc_sim.cli.process import StopSignals

with StopSignals() as stop:
    asked = threading.Lock()
    asked.acquire()
    stop.then(asked.release)
    print('ready', flush=True)

    # This holds the main thread back from running a handler of its own.
    asked.acquire()
    print(stop.requested.is_set())
