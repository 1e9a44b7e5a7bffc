"""Finds mistakes in a model and a controller, and names their causes."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser
    from barc_sim.lab.check.worker import Report

FORMATS = ('png', 'pdf', 'svg')
DPI = 150
NOT_PASSED = 1


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Check a bike_model.py and a controller.py against the reference.'
    parser.epilog = 'Exit code 0: everything is right; 1: something is not.'
    parser.add_argument('folder', type=Path, metavar='LAB', help='the folder of both files')
    parser.add_argument(
        '--seed', type=int, default=0, metavar='N', help='of the random states and roads (0)'
    )
    for name in ('kp', 'ki', 'kd'):
        parser.add_argument(
            f'--{name}',
            type=float,
            metavar='GAIN',
            help='for the drives over the roads (default: that of a run)',
        )
    parser.add_argument(
        '--save', metavar='FILE', help='the figure: .png, .pdf or .svg (LAB/check.png)'
    )
    parser.add_argument('--no-plot', action='store_true', help='draw no figure')


def run(options: Namespace) -> int:
    """Print and draw the findings; return 1 if any of them is a mistake.

    Raises
    ------
    UserError
        where there is nothing to check, or the figure cannot be saved.
    """
    from barc_sim.lab.check import GAINS  # noqa: PLC0415 (slow: not for --help)
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
    """Save the figure, if any finding has data to draw."""
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
