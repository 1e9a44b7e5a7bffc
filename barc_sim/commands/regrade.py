"""Checks that a bag can come from barc_sim, and from the code attached to it."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING

from barc_sim.cli.parser import add_bag_arguments, number
from barc_sim.errors import escaped

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser
    from barc_sim.lab.regrade.judging import Judgement


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Repeat a recorded run: its commands through the model and its speeds through the '
        "controller, of barc_sim and of the user's code attached to the bag."
    )
    parser.epilog = 'Exit code 0: the bag could have come from the code that it names; 1: not.'
    add_bag_arguments(parser)
    parser.add_argument('--json', action='store_true', help='print all results as JSON')
    parser.add_argument(
        '--time-limit',
        type=number(1.0, 86_400.0),
        default=120.0,
        metavar='S',
        help='for all calls of each attached file, sleeps included (%(default)g s)',
    )
    parser.add_argument(
        '--unconfined',
        action='store_true',
        help='run the attached code unconfined, where the system cannot confine it: it can do all '
        'that you can',
    )


def in_words(judgement: Judgement) -> str:
    """Return the results as lines of text.

    Examples
    --------
    >>> from barc_sim.bags.reader import newest
    >>> from barc_sim.lab.regrade.judging import judge
    >>> print(in_words(judge(newest('bags'))))
    1152 states, 23.02 s
    model of barc_sim       yes, bit for bit (1152 of 1152)
    controller of barc_sim  yes, bit for bit (1152 of 1152)
    The bag could have come from barc_sim.
    """
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
    if judgement.relay:
        lines.append(
            f'{judgement.relay}: not repeated, because its commands depend on when keys arrive; '
            'barc check judges it'
        )
    lines += [f'{name}: is not the file that the run had' for name in judgement.changed]
    width = max(len(f'{v.part} of {v.code}') for v in judgement.verdicts)
    lines += [
        f'{f"{verdict.part} of {verdict.code}":{width}}  {verdict.in_words()}'
        for verdict in judgement.verdicts
    ]
    claimed = ' and '.join(dict.fromkeys(judgement.claimed.values()))
    could = 'could' if judgement.possible else 'could not'
    return '\n'.join([*lines, f'The bag {could} have come from {claimed}.'])


def run(options: Namespace) -> int:
    """Print the results; return 0 if the bag could have come from the code that it names.

    Raises
    ------
    UserError
        where the bag cannot be read, or the code cannot be confined.
    """
    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.lab.grade.start import Limits  # noqa: PLC0415
    from barc_sim.lab.regrade.judging import judge  # noqa: PLC0415

    source = options.bag or reader.newest()
    limits = Limits(total=options.time_limit)
    judgement = judge(source, options.namespace, limits, sandbox=not options.unconfined)
    if options.json:
        whole = asdict(judgement) | {'possible': judgement.possible}
        print(json.dumps(whole, indent=2))  # noqa: T201
    else:
        print(escaped(in_words(judgement)))  # noqa: T201
    return 0 if judgement.possible else 1
