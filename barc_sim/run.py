"""`python -m barc_sim.run COMMAND`, the same as `barc COMMAND`; Ctrl-C ends its imports silently.

`scripts/run` starts runs with it; `runs/` composes them.
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
