"""Finds the racing line of a track, and a lap's time on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.cli.files import FIGURE_DPI, saving, target
from barc_sim.cli.parser import number
from barc_sim.control.cruise_control import PROFILE, SPEED

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser

_SPEEDS = 1e-3, SPEED.between[1]
_LIMITS = 1e-3, PROFILE[0].between[1]


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Find the line of least curvature on a track, and the speed that it allows.'
    )
    parser.epilog = 'Drive it: `barc acc --track line.csv --speed-profile 3.5 2 --speed 12`'
    parser.add_argument(
        'track', metavar='TRACK', help='as --track of `barc acc`: L, oval, a CSV file, …'
    )
    for name, limits, default, unit, meaning in (
        ('speed', _SPEEDS, 12.0, 'm/s', 'maximum speed'),
        ('lateral', _LIMITS, 3.5, 'm/s²', 'maximum acceleration across'),
        ('longitudinal', _LIMITS, 2.0, 'm/s²', 'maximum acceleration along, either way'),
    ):
        parser.add_argument(
            f'--{name}',
            type=number(*limits),
            default=default,
            metavar=unit.upper(),
            help=f'{meaning} ({default:g} {unit})',
        )
    parser.add_argument(
        '--margin',
        type=number(0.0, 1e3),
        metavar='M',
        help='distance to keep from both edges (a fifth of the width)',
    )
    parser.add_argument('-o', '--output', metavar='FILE', help='write the line as a track, a .csv')
    parser.add_argument('--save', metavar='FILE', help='save a figure as .png, .pdf or .svg')


def run(options: Namespace) -> None:
    """Print the lap's time, and write the line."""
    from barc_sim.control.lane import speed_profile  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.vehicle.racing_line import lap_time, racing_line, write_line  # noqa: PLC0415
    from barc_sim.vehicle.track import Track  # noqa: PLC0415

    output = target(options.output, ('csv',)) if options.output else None
    figure = target(options.save, ('png', 'pdf', 'svg')) if options.save else None
    track = Track.named(options.track)
    line = racing_line(track, margin=options.margin)
    limits = options.speed, options.lateral, options.longitudinal
    speeds = [speed_profile(each, *limits) for each in (track, line)]
    for name, each, speed in zip(
        ('centre line', 'racing line'), (track, line), speeds, strict=True
    ):
        radius = 1.0 / max(map(abs, each.curvatures))
        time = lap_time(each, speed)
        print(  # noqa: T201
            f'{name}  {time:6.2f} s  {each.length:7.1f} m  smallest radius {radius:5.1f} m'
        )
    if output:
        with saving(output, '--output') as part:
            write_line(part, track, line, speeds[1])
        print(output)  # noqa: T201
    if figure:
        from barc_sim.figures.track_figure import line_figure  # noqa: PLC0415

        with saving(figure) as part:
            line_figure(track, line, *speeds).savefig(
                part, dpi=FIGURE_DPI, format=figure.suffix[1:].lower()
            )
        print(figure)  # noqa: T201
