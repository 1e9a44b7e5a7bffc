"""Hang after a signal has asked for the end; each further signal is a second one."""

from __future__ import annotations

import os
import threading

from barc_sim.cli import process
from barc_sim.cli.process import StopSignals

process._ECHO = 0.0
with StopSignals() as stop:
    stop.then(lambda: os.write(1, b'asked\n'))
    print('ready', flush=True)
    threading.Event().wait()
