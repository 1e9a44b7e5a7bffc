"""Read damaged files as the commands do, and count what becomes of them.

Each ends in a result or in a sentence, within 10 s and 300 MiB; the exit code is 1 where one does
not. The same seed makes the same damage.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

from _trial import ESCAPE, HANG, MEMORY, RESULT, SENTENCE, TRACEBACK, Trial, content, trials

from barc_sim.cli.parser import Parser, call, whole

_KINDS = ('bags', 'zips', 'links', 'limits', 'folders', 'replies', 'texts', 'tables', 'drives')
_OUTCOMES = (RESULT, SENTENCE, TRACEBACK, HANG, MEMORY, ESCAPE)


def main(args: list[str] | None = None) -> int:
    """Try the files, and print the table."""
    parser = Parser(prog='fuzz', description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument('kind', choices=_KINDS)
    parser.add_argument(
        '-n', type=whole(1), default=1000, metavar='N', help='how many (%(default)s)'
    )
    parser.add_argument('--seed', type=whole(0), default=1, help='of the damage (%(default)s)')
    parser.add_argument(
        '--first', type=whole(0), default=0, help='number of the first (%(default)s)'
    )
    parser.add_argument('--save', type=Path, metavar='DIR', help='keep the files that fail here')
    options = parser.parse_args(args)
    os.environ.setdefault('ROS_DOMAIN_ID', str(100 + os.getpid() % 100))  # beside other work
    kind: Any = importlib.import_module(options.kind)
    kind.original()  # before the processes begin, which share it
    found: dict[str, list[Trial]] = defaultdict(list)
    failed = 0
    numbers = range(options.first, options.first + options.n)
    tried = kind.trials(options.seed, numbers) if hasattr(kind, 'trials') else None
    for trial in tried or trials(kind, options.seed, numbers):
        found[trial.damaged].append(trial)
        if trial.outcome not in (RESULT, SENTENCE):
            failed += 1
            print(f'{trial.number}: {trial.outcome}: {trial.why}', file=sys.stderr, flush=True)
            if options.save and not tried:
                _save(kind, options.seed, trial.number, options.save)
    print(table(found))
    return 1 if failed else 0


def table(found: dict[str, list[Trial]]) -> str:
    """Return a row for each kind of damage, and their sum."""
    rows = [*sorted(found.items()), ('all', [each for some in found.values() for each in some])]
    lines = [f'{"damaged":22}{"files":>8}' + ''.join(f'{name + "s":>11}' for name in _OUTCOMES)]
    lines[0] += f'{"most s":>8}{"most MiB":>10}'
    for name, some in rows:
        counts = [sum(each.outcome == outcome for each in some) for outcome in _OUTCOMES]
        seconds = max(e.seconds for e in some)
        most = max(e.mebibytes for e in some)
        line = f'{name:22}{len(some):8}' + ''.join(f'{count:11}' for count in counts)
        lines.append(f'{line}{seconds:8.2f}{most:10.0f}')
    return '\n'.join(lines)


def _save(kind: Any, seed: int, number: int, folder: Path) -> None:  # noqa: ANN401 (a module)
    suffix, _, data, _ = content(kind, seed, number)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f'{number}{suffix}').write_bytes(data)


if __name__ == '__main__':
    sys.exit(call('fuzz', main))
