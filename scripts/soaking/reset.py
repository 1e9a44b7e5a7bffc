"""1,000 resets in a row: the same trajectory each time, no slower at the end than at the start.

In lock-step, with noise, lags and delays, through the simulator's service.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from _figures import Figure, spread

from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse

SHORT = '30 of them'
_PROGRAM = Path(__file__).with_name('_resets.py')
#: A machine that others use, too, is slower now than then.
_SLOWER = 1.5
_GROWTH = 5.0  #: [MiB]
_PATIENCE = 600.0  #: [s]


def soak(options: argparse.Namespace) -> list[Figure]:
    """Return the figures."""
    count, tenth = (30, 10) if options.short else (1000, 100)
    done = subprocess.run(  # noqa: S603 (our own)
        [sys.executable, str(_PROGRAM), str(count)],
        capture_output=True,
        text=True,
        check=False,
        timeout=_PATIENCE,
    )
    if done.returncode:
        raise UserError(f'the resets ended with code {done.returncode}: {done.stderr}')
    found = json.loads(done.stdout)
    seconds = found['seconds'][1:]
    memory = found['memory']  # the first has the start in it
    first = median(seconds[:tenth])
    last = median(seconds[-tenth:])
    return [
        Figure('resets', len(seconds), least=count),
        Figure('different trajectories', len(set(found['digests'])), most=1),
        *spread('a reset and 100 states, s', seconds),
        Figure(f'median of the last {tenth} by that of the first', last / first, most=_SLOWER),
        Figure(
            'memory gained after the first tenth, MiB',
            (memory[-1] - memory[tenth]) / 2**20,
            _GROWTH,
        ),
        Figure('exceptions', done.stderr.count('Traceback'), most=0),
    ]
