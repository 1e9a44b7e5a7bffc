"""`identify` and `raceline`: the car that made some bags, and the racing line of a track."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.files import FIGURE_DPI, FIGURES, saving, target
from barc_sim.cli.parser import number
from barc_sim.control.cruise_control import PROFILE, SPEED
from barc_sim.errors import UserError
from barc_sim.vehicle.parameters import ROWS

if TYPE_CHECKING:
    from argparse import Namespace

    from matplotlib.figure import Figure

    from barc_sim.cli.parser import Parser


def add_arguments_identify(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Find drag, rolling friction and motor delay of the car that made the bags, and, where it '
        'steered, its tyres and yaw inertia: each with an interval of 95 %.'
    )
    parser.epilog = (
        'A drive that shows much: `barc acc --controller-type prbs`, also steps and coast-down. '
        "Another robot's bag: --field v_x=/odom.twist.twist.linear.x --field motor=/cmd.accel"
    )
    parser.add_argument(
        'bags', nargs='*', type=Path, metavar='BAG', help='of one car (the newest in ./bags)'
    )
    parser.add_argument('--namespace', metavar='NS', help='the car, in a bag of several')
    parser.add_argument(
        '--field',
        action='append',
        type=_field,
        default=[],
        metavar='COLUMN=/TOPIC.FIELD',
        help='where a bag of another robot has v_x, motor, servo, psi_dot, v_y or theta_deg',
    )
    mass = ROWS['mass']
    parser.add_argument(
        '--mass',
        type=number(*mass.between),
        default=mass.default,
        help=f'[kg] of the car ({mass.default:g})',
    )
    parser.add_argument(
        '--integrator',
        choices=('euler', 'rk4'),
        default='euler',
        help='euler: as the simulator by default; rk4: for a real car (euler)',
    )
    parser.add_argument('--save', metavar='FILE', help='save a figure as .png, .pdf or .svg')


def _field(text: str) -> tuple[str, str]:
    column, _, field = text.partition('=')
    if not (column and field.startswith('/') and '.' in field):
        raise argparse.ArgumentTypeError(
            f'{text!r} must be a column and a field, as in v_x=/odom.twist.twist.linear.x'
        )
    return column, field


def run_identify(options: Namespace) -> None:
    """Read the bags, and print the parameters."""
    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.bags.convert import log_of_fields  # noqa: PLC0415
    from barc_sim.tuning.identification import identify  # noqa: PLC0415
    from barc_sim.vehicle.bike_model import Vehicle  # noqa: PLC0415

    path = _figure(options)
    fields = dict(options.field)
    if fields and not {'v_x', 'motor'} <= fields.keys():
        raise UserError(f'--field names {", ".join(fields)}: expected v_x and motor at least')
    bags = options.bags or [reader.newest()]
    logs = [
        log_of_fields(bag, fields) if fields else reader.read(bag, options.namespace)
        for bag in bags
    ]
    found = identify(*logs, vehicle=Vehicle(mass=options.mass), integrator=options.integrator)
    width = max(map(len, found.estimates))
    for name, each in found.estimates.items():
        print(f'{name:{width}}  {each!s:32} {each.meaning}')  # noqa: T201
    for remark in found.remarks:
        print(f'- {remark}')  # noqa: T201
    if path:
        from barc_sim.figures.tuning_figures import identification_figure  # noqa: PLC0415

        title = ', '.join(bag.resolve().name for bag in bags)
        _save(path, identification_figure(found, title=title))


def add_arguments_raceline(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Find the line of least curvature on a track, and the speed that it allows.'
    )
    parser.epilog = 'Drive it: `barc acc --track line.csv --speed-profile 3.5 2 --speed 12`'
    parser.add_argument(
        'track', metavar='TRACK', help='as --track of `barc acc`: L, oval, a CSV file, …'
    )
    accelerations = PROFILE[0].between
    for name, most, default, unit, meaning in (
        ('speed', SPEED.between[1], 12.0, 'm/s', 'maximum speed'),
        ('lateral', accelerations[1], 3.5, 'm/s²', 'maximum acceleration across'),
        ('longitudinal', accelerations[1], 2.0, 'm/s²', 'maximum acceleration along, either way'),
    ):
        parser.add_argument(
            f'--{name}',
            type=number(1e-3, most),
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


def run_raceline(options: Namespace) -> None:
    """Print the lap's time, and write the line."""
    from barc_sim.control.lane import speed_profile  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.control.planning import lap_time, racing_line, write_line  # noqa: PLC0415
    from barc_sim.vehicle.track import Track  # noqa: PLC0415

    output = target(options.output, ('csv',)) if options.output else None
    path = _figure(options)
    track = Track.named(options.track)
    line = racing_line(track, margin=options.margin)
    limits = options.speed, options.lateral, options.longitudinal
    speeds = []
    for name, each in (('centre line', track), ('racing line', line)):
        speeds.append(speed_profile(each, *limits))
        radius = 1.0 / max(map(abs, each.curvatures))
        time = lap_time(each, speeds[-1])
        print(  # noqa: T201
            f'{name}  {time:6.2f} s  {each.length:7.1f} m  smallest radius {radius:5.1f} m'
        )
    if output:
        with saving(output, '--output') as part:
            write_line(part, track, line, speeds[1])
        print(output)  # noqa: T201
    if path:
        from barc_sim.figures.track_figure import line_figure  # noqa: PLC0415

        _save(path, line_figure(track, line, *speeds))


def _figure(options: Namespace) -> Path | None:
    """Return where a figure is to be saved."""
    return None if options.save is None else target(options.save, FIGURES)


def _save(path: Path, figure: Figure) -> None:
    with saving(path) as part:
        figure.savefig(part, dpi=FIGURE_DPI)
    print(path)  # noqa: T201
