"""Read damaged files as the commands do, and count what becomes of them.

Each ends in a result or in a sentence, within 10 s and 300 MiB; the exit code is 1 where one does
not. The same seed makes the same damage.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

from _trial import ESCAPE, HANG, MEMORY, RESULT, SENTENCE, TRACEBACK, Trial, make_file, trials

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

    trials_by_damage: dict[str, list[Trial]] = defaultdict(list)
    failures = 0
    numbers = range(options.first, options.first + options.n)
    runs_by_itself = hasattr(kind, 'trials')
    if runs_by_itself:
        attempts = kind.trials(options.seed, numbers)
    else:
        attempts = trials(kind, options.seed, numbers)

    for trial in attempts:
        trials_by_damage[trial.damage].append(trial)
        if not trial.is_failure:
            continue

        failures += 1
        print(f'{trial.number}: {trial.outcome}: {trial.reason}', file=sys.stderr, flush=True)
        if options.save and not runs_by_itself:
            _save(kind, options.seed, trial.number, options.save)

    print(table(trials_by_damage))
    return 1 if failures else 0


def table(trials_by_damage: dict[str, list[Trial]]) -> str:
    """Return a row for each kind of damage, and their sum."""
    heading = f'{"damaged":22}{"files":>8}' + ''.join(f'{name + "s":>11}' for name in _OUTCOMES)
    lines = [f'{heading}{"max s":>8}{"max MiB":>10}']
    everything: list[Trial] = []
    for name, of_damage in sorted(trials_by_damage.items()):
        lines.append(_row(name, of_damage))
        everything += of_damage
    lines.append(_row('all', everything))
    return '\n'.join(lines)


def _row(name: str, of_damage: list[Trial]) -> str:
    outcomes = Counter(trial.outcome for trial in of_damage)
    counts = ''.join(f'{outcomes[outcome]:11}' for outcome in _OUTCOMES)
    max_seconds = max(trial.seconds for trial in of_damage)
    max_mebibytes = max(trial.mebibytes for trial in of_damage)
    return f'{name:22}{len(of_damage):8}{counts}{max_seconds:8.2f}{max_mebibytes:10.0f}'


def _save(kind: Any, seed: int, number: int, folder: Path) -> None:  # noqa: ANN401 (a module)
    file = make_file(kind, seed, number)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f'{number}{file.suffix}').write_bytes(file.content)


if __name__ == '__main__':
    sys.exit(call('fuzz', main))
