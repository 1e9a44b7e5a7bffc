"""`python -m barc_sim.run acc|teleop`, the same as `barc acc` and `barc teleop`.

What a run is made of is in `runs/cruise_control.py` and `runs/teleop.py`.
"""

from __future__ import annotations

import signal

if __name__ == '__main__':
    # Until StopSignals takes over: there is nothing to end in order yet, and no traceback needed.
    signal.signal(signal.SIGINT, signal.SIG_DFL)

import sys

from barc_sim.__main__ import main

__all__ = ['main']

if __name__ == '__main__':
    sys.exit(main())
