"""Block signals, and send one to this process before it can be handled.

start_with_blocked_signals.py NUMBER BLOCKED...
"""

from __future__ import annotations

import os
import signal
import sys

from barc_sim.cli.process import StopSignals

number, *blocked = map(int, sys.argv[1:])
signal.pthread_sigmask(signal.SIG_BLOCK, blocked)
os.kill(os.getpid(), number)

with StopSignals() as stop:
    stop.requested.wait()
    print('ready', flush=True)
    sys.stdin.read()
    print('asked')
