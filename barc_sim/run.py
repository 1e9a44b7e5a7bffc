"""`python -m barc_sim.run acc|teleop`, the same as `barc acc` and `barc teleop`.

What a run is made of is in `runs/cruise_control.py` and `runs/teleop.py`.
"""

from __future__ import annotations

import signal

if __name__ == '__main__':
    # Until StopSignals takes over: there is nothing to end in order yet, and no traceback needed.
    signal.signal(signal.SIGINT, signal.SIG_DFL)

import sys
from functools import partial

from barc_sim.__main__ import main as barc
from barc_sim.__main__ import run
from barc_sim.cli.process import USAGE_ERROR, call, report

_RUNS = ('acc', 'teleop')


def main(argv: list[str] | None = None) -> int:
    """Run the command line `argv` and return its exit code."""
    argv = sys.argv[1:] if argv is None else argv
    if argv and argv[0] in _RUNS:
        return call(f'barc {argv[0]}', partial(run, argv[0], argv[1:]))
    if argv and argv[0] in ('-h', '--help'):
        return barc(['--help'])
    reason = f'not {argv[0]!r}' if argv else 'and there is no argument'
    report('barc_sim.run', f'acc or teleop was expected, {reason}: choose one')
    return USAGE_ERROR


if __name__ == '__main__':
    sys.exit(main())
