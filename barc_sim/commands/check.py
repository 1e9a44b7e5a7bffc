"""Command: tell a user what is right and what is wrong in a folder, and where to look."""

from __future__ import annotations

import sys
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence

    from barc_sim.lab.check.worker import Report

PROG = 'barc check'
FORMATS = ('png', 'pdf', 'svg')
DPI = 150
NOT_PASSED = 1


def parse(argv: Sequence[str] | None = None) -> Namespace:
    """Return the options on the command line."""
    parser = Parser(
        prog=PROG,
        description='Check a bike_model.py and a controller.py against the reference.',
    )
    parser.add_argument('folder', type=Path, metavar='LAB', help='the folder that holds them')
    parser.add_argument(
        '--seed', type=int, default=0, metavar='N', help='of states and roads (default: 0)'
    )
    for name in ('kp', 'ki', 'kd'):
        parser.add_argument(
            f'--{name}',
            type=float,
            metavar='GAIN',
            help='to drive the roads with (default: that of a run)',
        )
    parser.add_argument(
        '--save', metavar='FILE', help='the figure: .png, .pdf or .svg (default: LAB/check.png)'
    )
    parser.add_argument('--no-plot', action='store_true', help='draw no figure')
    return parser.parse_args(argv)


def check(options: Namespace) -> int:
    """Judge, print and draw; return the exit code: 1 if a criterion is not met in full.

    Raises
    ------
    UserError
        where there is nothing to check, or the figure can't be saved as asked.
    """
    from barc_sim.lab.check import GAINS  # noqa: PLC0415 (--help need not wait for NumPy)
    from barc_sim.lab.check.report import print_report  # noqa: PLC0415
    from barc_sim.lab.check.worker import judge_folder  # noqa: PLC0415

    if options.save is not None and options.no_plot:
        raise UserError('--save and --no-plot contradict each other: give one of them')
    given = (options.kp, options.ki, options.kd)
    kp, ki, kd = (
        default if gain is None else gain for gain, default in zip(given, GAINS, strict=True)
    )
    gains = (kp, ki, kd)
    if not all(map(isfinite, gains)):
        raise UserError(f'the gains kp, ki, kd are {gains}: expected finite numbers')
    path = None if options.no_plot else _path(options)
    report = judge_folder(options.folder, options.seed, gains)
    print_report(report)
    if path:
        settings = f'kp {kp:g} · ki {ki:g} · kd {kd:g} · seed {options.seed}'
        _draw(report, path, f'{options.folder.resolve().name}, beside the reference', settings)
    judged = [finding for finding in report.findings if not finding.skipped]
    return 0 if all(finding.passed for finding in judged) else NOT_PASSED


def _path(options: Namespace) -> Path:
    from barc_sim.figures import output  # noqa: PLC0415

    return output.target(options.save or str(options.folder / 'check.png'), FORMATS)


def _draw(report: Report, path: Path, title: str, settings: str) -> None:
    """Save the figure, where there is anything to draw."""
    from barc_sim.figures import output  # noqa: PLC0415
    from barc_sim.lab.check import figure as check_figure  # noqa: PLC0415
    from barc_sim.lab.check.findings import Comparison, Trajectory  # noqa: PLC0415

    evidence = [finding.evidence for finding in report.findings]
    comparison = next((item for item in evidence if isinstance(item, Comparison)), None)
    trajectory = next((item for item in evidence if isinstance(item, Trajectory)), None)
    if comparison is None and trajectory is None:
        return
    figure = check_figure.check_figure(comparison, trajectory, title=title, settings=settings)
    with output.replacing(path) as part:
        figure.savefig(part, dpi=DPI)
    print(path)  # noqa: T201


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = parse(argv)
    return call(PROG, lambda: check(options))


if __name__ == '__main__':
    sys.exit(main())
