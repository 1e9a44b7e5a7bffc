"""Ignore a hang-up, as `nohup` does, and wait for another signal."""

from __future__ import annotations

import os
import signal
import threading

from barc_sim.cli.process import StopSignals

signal.signal(signal.SIGHUP, signal.SIG_IGN)
with StopSignals() as stop:
    print('ready', flush=True)
    written = threading.Event()
    stop.then(lambda: (os.write(1, b'asked\n'), written.set()))
    written.wait()
