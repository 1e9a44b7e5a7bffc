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
#: The last resets by the first ones. A machine that others use is not always equally fast.
_MAX_SLOWDOWN = 1.5
_MAX_GROWTH = 5.0  #: [MiB]
_TIMEOUT = 600.0  #: [s]


def soak(options: argparse.Namespace) -> list[Figure]:
    """Return the figures."""
    count = 30 if options.short else 1000
    tenth = 10 if options.short else 100
    process = subprocess.run(  # noqa: S603 (our own)
        [sys.executable, str(_PROGRAM), str(count)],
        capture_output=True,
        text=True,
        check=False,
        timeout=_TIMEOUT,
    )
    if process.returncode:
        raise UserError(f'the resets ended with code {process.returncode}: {process.stderr}')

    drives = json.loads(process.stdout)
    seconds = drives['seconds'][1:]  # without the start
    slowdown = median(seconds[-tenth:]) / median(seconds[:tenth])
    growth = (drives['memory'][-1] - drives['memory'][tenth]) / 2**20
    return [
        Figure('resets', len(seconds), minimum=count),
        Figure('different trajectories', len(set(drives['digests'])), maximum=1),
        *spread('a reset and 100 states, s', seconds),
        Figure(f'median of the last {tenth} by that of the first', slowdown, _MAX_SLOWDOWN),
        Figure('memory gained after the first tenth, MiB', growth, _MAX_GROWTH),
        Figure('exceptions', process.stderr.count('Traceback'), maximum=0),
    ]
