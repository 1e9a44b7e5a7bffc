"""End once the standard input has; each further signal is an echo of the first one."""

from __future__ import annotations

import os
import sys

from barc_sim.cli import process
from barc_sim.cli.process import StopSignals

process._ECHO = 3600.0
with StopSignals() as stop:
    stop.then(lambda: os.write(1, b'asked\n'))
    print('ready', flush=True)
    stop.requested.wait()
    sys.stdin.read()
    print('closed')
