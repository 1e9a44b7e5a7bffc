"""Command: tell whether a bag could have come from barc_sim, and from the code attached to it."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence

    from barc_sim.lab.regrade.judging import Judgement

PROG = 'barc regrade'


def parse(argv: Sequence[str] | None = None) -> Namespace:
    """Return the options on the command line."""
    parser = Parser(
        prog=PROG,
        description='Do a recorded run again: its commands through the model, its speeds through '
        'the controller, of barc_sim and of user code that is attached to the bag.',
        epilog='Exit code 0: the bag could have come from the code that it claims to come from.',
    )
    parser.add_argument(
        'bag', nargs='?', type=Path, metavar='BAG', help='default: the newest in ./bags'
    )
    parser.add_argument(
        '--namespace', metavar='NS', help='the car, where the bag has several, as in /car1'
    )
    parser.add_argument('--json', action='store_true', help='print all that was found as JSON')
    parser.add_argument(
        '--no-sandbox',
        dest='sandbox',
        action='store_false',
        help='run the attached code with only its time and memory limited: it may read and write '
        'your files',
    )
    return parser.parse_args(argv)


def in_words(judgement: Judgement) -> str:
    """Return what was found as lines of text."""
    lines = [f'{judgement.states} states, {judgement.duration:.2f} s']
    first = judgement.verdicts[0]
    lines += [
        f'{count} {what}'
        for count, what in (
            (first.resets, 'times the car began anew'),
            (first.placements, 'times it was put elsewhere'),
            (first.gaps, 'states after a gap: taken as they are'),
            (
                judgement.missed,
                'states that no command answered in time: what held is one of those around',
            ),
        )
        if count
    ]
    lines += [f'{name}: is not the file that the run had' for name in judgement.changed]
    width = max(len(f'{v.part} of {v.code}') for v in judgement.verdicts)
    lines += [
        f'{f"{verdict.part} of {verdict.code}":{width}}  {verdict.in_words()}'
        for verdict in judgement.verdicts
    ]
    claimed = ' and '.join(dict.fromkeys(judgement.claimed.values()))
    could = 'could' if judgement.possible else 'could not'
    return '\n'.join([*lines, f'The bag {could} have come from {claimed}.'])


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = parse(argv)

    def run() -> int:
        from barc_sim.bags import reader  # noqa: PLC0415 (--help need not wait for it)
        from barc_sim.lab.regrade.judging import judge  # noqa: PLC0415

        source = options.bag or reader.newest()
        judgement = judge(source, options.namespace, sandbox=options.sandbox)
        if options.json:
            whole = asdict(judgement) | {'possible': judgement.possible}
            print(json.dumps(whole, indent=2))  # noqa: T201
        else:
            print(in_words(judgement))  # noqa: T201
        return 0 if judgement.possible else 1

    return call(PROG, run)


if __name__ == '__main__':
    sys.exit(main())
