"""Run `barc info --help` in a process that was interrupted before Python could handle it."""

from __future__ import annotations

import os
import signal
import sys

signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
os.kill(os.getpid(), signal.SIGINT)

from barc_sim.run import main

sys.exit(main(['info', '--help']))
