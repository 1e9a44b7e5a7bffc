"""Prints and draws the error of each integrator over the length of the step."""

from __future__ import annotations

import json
from itertools import groupby
from math import isnan
from typing import TYPE_CHECKING

from barc_sim.cli.files import saving, target

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator, Sequence

    from barc_sim.cli.parser import Parser
    from barc_sim.simulation.convergence import Study

FORMATS = ('png', 'pdf', 'svg')
DPI = 150
_HEADING = 'Error of the position at the end [m], by the length of the step'
_REMARK = """\
The order is the slope of the errors: 1 for forward Euler, 4 for Runge-Kutta. Errors below
{rounding:g} m are rounding and are left out. The fine solution is rk4's, in steps of {fine:g} ms.
The grade of the lab's road jumps. With any integrator, a step over a jump is wrong by a part of
the jump: there the errors fall unevenly, with order 1 on average."""


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Print and draw the error of forward Euler and Runge-Kutta, for the kinematic and the '
        'dynamic bicycle, against closed forms or a fine solution.'
    )
    parser.add_argument(
        '--save',
        metavar='FIGURE',
        help='save the figure as .png, .pdf or .svg; default: a window, or convergence.png '
        'without a display',
    )
    parser.add_argument('--json', action='store_true', help='print JSON, and draw only with --save')


def run(options: Namespace) -> None:
    """Print the errors, and draw them.

    Raises
    ------
    UserError
        where the figure cannot be saved.
    """
    from barc_sim.figures import output  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.simulation.convergence import studies  # noqa: PLC0415

    path = target(options.save, FORMATS) if options.save is not None else None
    found = [*studies()]
    if options.json:
        print(as_json(found))  # noqa: T201
    else:
        for line in table(found):
            print(line, flush=True)  # noqa: T201
    if options.json and not path:
        return
    from barc_sim.figures import convergence_figure as drawing  # noqa: PLC0415

    window = None if path else output.window(drawing.SIZE, 'Convergence')
    figure = drawing.convergence_figure(found, figure=window)
    if window:
        output.show()
        return
    path = path or target('convergence.png', FORMATS)
    with saving(path) as part:
        figure.savefig(part, dpi=DPI)
    if not options.json:
        print(path)  # noqa: T201


def table(studies: Sequence[Study]) -> Iterator[str]:
    """Yield the lines of the table of errors and orders.

    Examples
    --------
    >>> from barc_sim.simulation.convergence import REFERENCE_DRIVES, studies
    >>> lines = list(table([*studies(REFERENCE_DRIVES[:1])]))
    >>> lines[4].split()
    ['kinematic', 'euler', '2.5e-01', '1.3e-01', '6.3e-02', '3.1e-02', '1.6e-02', '1.00']
    """
    from barc_sim.simulation.convergence import FINE, ROUNDING, STEPS  # noqa: PLC0415

    yield _HEADING
    yield ''
    yield f'{"":22}' + ''.join(f'{1e3 * ts:7g} ms' for ts in STEPS) + '   order'
    for (name, text, reference), group in groupby(studies, lambda study: study[:3]):
        yield f'{name} ({text}), against {reference}'
        for study in group:
            errors = ''.join(f'{error:10.1e}' for error in study.errors)
            order = '\N{EN DASH}' if isnan(study.order) else f'{study.order:.2f}'
            yield f'  {study.model:11}{study.integrator:9}{errors}{order:>8}'
    yield ''
    yield _REMARK.format(rounding=ROUNDING, fine=1e3 * FINE)


def as_json(studies: Sequence[Study]) -> str:
    """Return the same as JSON; an order that cannot be measured is null.

    Examples
    --------
    >>> from barc_sim.simulation.convergence import REFERENCE_DRIVES, studies
    >>> found = json.loads(as_json([*studies(REFERENCE_DRIVES[:1])]))
    >>> [(study['integrator'], round(study['order'], 1)) for study in found['studies']]
    [('euler', 1.0), ('rk4', 4.0)]
    """
    from barc_sim.simulation.convergence import STEPS  # noqa: PLC0415

    rows = [
        study._asdict() | {'order': None if isnan(study.order) else study.order}
        for study in studies
    ]
    return json.dumps({'steps': STEPS, 'studies': rows}, indent=2)
