"""Command: the errors of forward Euler and Runge-Kutta, by the length of the step."""

from __future__ import annotations

import json
import sys
from itertools import groupby
from math import isnan
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator, Sequence

    from barc_sim.simulation.convergence import Study

PROG = 'barc validate'
FORMATS = ('png', 'pdf', 'svg')
DPI = 150
_HEADING = 'Error of the position at the end [m], by the length of the step'
_REMARK = """\
The order is the slope of the errors: 1 is forward Euler's, 4 Runge-Kutta's. Errors below
{rounding:g} m are rounding's and do not count. The fine solution is rk4's, in steps of
{fine:g} ms. The grade of the lab's road jumps: a step that passes a jump is wrong by a part of it
whatever the integrator, so that the errors fall irregularly there, on the whole with order 1."""


def parse(argv: Sequence[str] | None = None) -> Namespace:
    """Return the options on the command line."""
    parser = Parser(
        prog=PROG,
        description='Print and draw the error of forward Euler and Runge-Kutta, for the kinematic '
        'and the dynamic bicycle, against closed forms or a fine solution.',
    )
    parser.add_argument(
        '--save',
        metavar='FIGURE',
        help='save the figure as .png, .pdf or .svg; default: a window, or convergence.png '
        'without a display',
    )
    parser.add_argument('--json', action='store_true', help='print JSON, and draw only with --save')
    return parser.parse_args(argv)


def validate(options: Namespace) -> None:
    """Do what the options ask for.

    Raises
    ------
    UserError
        where the figure cannot be saved as asked.
    """
    from barc_sim.figures import output  # noqa: PLC0415 (--help need not wait for NumPy)
    from barc_sim.simulation.convergence import studies  # noqa: PLC0415 (--help need not wait for NumPy)

    path = output.target(options.save, FORMATS) if options.save is not None else None
    found = [*studies()]
    if options.json:
        print(as_json(found))  # noqa: T201
    else:
        for line in table(found):
            print(line, flush=True)  # noqa: T201
    if options.json and not path:
        return
    from barc_sim.figures import convergence_figure as drawing  # noqa: PLC0415 (see above)

    window = None if path else output.window(drawing.SIZE, 'Convergence')
    figure = drawing.convergence_figure(found, figure=window)
    if window:
        output.show()
        return
    path = path or output.target('convergence.png', FORMATS)
    with output.replacing(path) as part:
        figure.savefig(part, dpi=DPI)
    if not options.json:
        print(path)  # noqa: T201


def table(studies: Sequence[Study]) -> Iterator[str]:
    """Yield the lines of the table of errors and orders."""
    from barc_sim.simulation.convergence import FINE, ROUNDING, STEPS  # noqa: PLC0415 (see `validate`)

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
    """Return the same as JSON; an unknown order is null."""
    from barc_sim.simulation.convergence import STEPS  # noqa: PLC0415 (see `validate`)

    rows = [
        study._asdict() | {'order': None if isnan(study.order) else study.order}
        for study in studies
    ]
    return json.dumps({'steps': STEPS, 'studies': rows}, indent=2)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = parse(argv)
    return call(PROG, lambda: validate(options))


if __name__ == '__main__':
    sys.exit(main())
