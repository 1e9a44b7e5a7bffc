"""SIGINT and SIGTERM at 100 random moments, from the start of the process to its end.

Half of them to `run acc`, half to `run teleop` in a terminal; half started as scripts/run does,
which holds signals back until they are handled, half as `python -m barc_sim.run`.
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
_MOST = 2.0  #: [s] from the signal to the end
_SECONDS = 1.5  #: a run by hand, which has no end of its own
_OPTIONS = {
    'acc': ('acc', '-q', '--realtime-factor', 'max', '--distance', '20'),
    'teleop': ('teleop', '--view', 'none'),
}
_PATIENCE = 30.0


def soak(options: argparse.Namespace) -> list[Figure]:
    """Return the figures."""
    count = 8 if options.short else 100
    chance = random.Random(7)  # noqa: S311 (no secret)
    whole = _whole_run()
    seconds: list[float] = []
    faults: list[str] = []
    early = 0
    for number in range(count):
        mode = 'teleop' if number % 2 else 'acc'
        blocked = number % 4 < 2  # noqa: PLR2004
        moment = chance.uniform(0.0, whole + (_SECONDS if mode == 'teleop' else 0.0))
        with tempfile.TemporaryDirectory() as name:
            session = Session(Path(name), *_OPTIONS[mode], terminal=number % 2 > 0, blocked=blocked)
            ended = session.look(moment)
            if not ended:
                number_ = chance.choice((signal.SIGINT, signal.SIGTERM))
                seconds.append(session.stop(number_))
            found = session.faults() + _bag_faults(Path(name) / 'bags')
            if 'Traceback' in found and not blocked and b'barc_sim' not in session.shown:
                found.remove('Traceback')  # Python's own start
                found = [fault for fault in found if fault != 'exit code 1']
                early += 1
            if found:
                print(f'{mode} at {moment:.3f} s of {whole:.3f}: {found}', file=sys.stderr)
                print(session.shown.decode(errors='replace')[-2000:], file=sys.stderr)
            faults += found
    return [
        Figure('signals', len(seconds), least=1),
        Figure('a whole run, s', whole),
        *spread('from the signal to the end, s', seconds, _PATIENCE if options.short else _MOST),
        Figure("tracebacks of Python's own, before it runs barc_sim", early),
        Figure('faults', len(faults), most=0),
    ]


def _whole_run() -> float:
    """Return how long `acc` takes without a signal [s]."""
    with tempfile.TemporaryDirectory() as name:
        began = time.monotonic()
        session = Session(Path(name), *_OPTIONS['acc'], terminal=False, blocked=False)
        session.look(_PATIENCE)
        session.faults()
        return time.monotonic() - began


def _bag_faults(root: Path) -> list[str]:
    """Return what is wrong with the bags in the folder: it has one that is whole, or none."""
    return [
        f'{bag_path} is not whole'
        for bag_path in (sorted(root.iterdir()) if root.exists() else [])
        if 'steps' not in bag.info(bag_path)
    ]
