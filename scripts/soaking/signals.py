"""SIGINT and SIGTERM at 100 random moments, from the start of the process to its end.

Half of them go to `run acc`, half to `run teleop` in a terminal. Half of the runs are started as
by scripts/run, which blocks signals until they are handled, half as `python -m barc_sim.run`.
"""

from __future__ import annotations

import random
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from _figures import Figure, spread
from _session import Session

from barc_sim.bags import reader as bag

if TYPE_CHECKING:
    import argparse

SHORT = '8 of them, and any time will do'
_MAX_SECONDS = 2.0  #: [s] from the signal to the end
_TELEOP_DURATION = 1.5  #: [s] of a run by hand, which has no end of its own
_OPTIONS = {
    'acc': ('acc', '-q', '--realtime-factor', 'max', '--distance', '20'),
    'teleop': ('teleop', '--view', 'none'),
}
_TIMEOUT = 30.0  #: [s]


def soak(options: argparse.Namespace) -> list[Figure]:
    """Return the figures."""
    count = 8 if options.short else 100
    runs = _InterruptedRuns()
    for number in range(count):
        mode = 'teleop' if number % 2 else 'acc'
        runs.endure(mode, blocked=number % 4 < 2)  # noqa: PLR2004 (half of each mode)

    max_seconds = _TIMEOUT if options.short else _MAX_SECONDS
    return [
        Figure('signals', len(runs.seconds), minimum=1),
        Figure('a whole run, s', runs.acc_duration),
        *spread('from the signal to the end, s', runs.seconds, max_seconds),
        Figure("tracebacks of Python's own, before it runs barc_sim", runs.early_tracebacks),
        Figure('faults', runs.faults, maximum=0),
    ]


class _InterruptedRuns:
    """Runs that get a signal at a random moment."""

    def __init__(self) -> None:
        self.acc_duration = _acc_duration()
        self.seconds: list[float] = []  #: from the signal to the end
        self.early_tracebacks = 0
        self.faults = 0
        self._chance = random.Random(7)  # noqa: S311 (no secret)

    def endure(self, mode: str, *, blocked: bool) -> None:
        """Start a run, send the signal, and count the faults of its end."""
        is_teleop = mode == 'teleop'
        duration = self.acc_duration
        if is_teleop:
            duration += _TELEOP_DURATION
        moment = self._chance.uniform(0.0, duration)

        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            session = Session(folder, *_OPTIONS[mode], terminal=is_teleop, blocked=blocked)
            if not session.watch(moment):
                number = self._chance.choice((signal.SIGINT, signal.SIGTERM))
                self.seconds.append(session.stop(number))
            faults = session.faults() + _bag_faults(folder / 'bags')

        if 'Traceback' in faults and not blocked and b'barc_sim' not in session.output:
            self.early_tracebacks += 1  # Python's own start
            faults = [fault for fault in faults if fault not in {'Traceback', 'exit code 1'}]
        if faults:
            self.faults += len(faults)
            print(f'{mode} at {moment:.3f} s of {duration:.3f}: {faults}', file=sys.stderr)
            print(session.output.decode(errors='replace')[-2000:], file=sys.stderr)


def _acc_duration() -> float:
    """Return how long `acc` takes without a signal [s]."""
    with tempfile.TemporaryDirectory() as name:
        start = time.monotonic()
        session = Session(Path(name), *_OPTIONS['acc'], terminal=False, blocked=False)
        session.watch(_TIMEOUT)
        session.faults()
        return time.monotonic() - start


def _bag_faults(root: Path) -> list[str]:
    """Return what is wrong with the bags in the folder: it has one that is whole, or none."""
    if not root.exists():
        return []
    return [
        f'{path} is not whole' for path in sorted(root.iterdir()) if 'steps' not in bag.info(path)
    ]
