"""Finds the parameters of the car that made some bags."""

from __future__ import annotations

import argparse
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.files import FIGURE_DPI, FIGURES, saving, target
from barc_sim.cli.parser import number
from barc_sim.errors import UserError
from barc_sim.vehicle.parameters import ROWS

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Mapping

    from barc_sim.cli.parser import Parser


def add_arguments(parser: Parser) -> None:
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
    parser.add_argument('--json', action='store_true', help='print JSON')


def _field(text: str) -> tuple[str, str]:
    column, _, field = text.partition('=')
    if not (column and field.startswith('/') and '.' in field):
        raise argparse.ArgumentTypeError(
            f'{text!r} must be a column and a field, as in v_x=/odom.twist.twist.linear.x'
        )
    return column, field


def run(options: Namespace) -> None:
    """Read the bags, and print the parameters."""
    import json  # noqa: PLC0415 (not for --help)

    from barc_sim.bags import reader  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.bags.convert import log_of_fields  # noqa: PLC0415
    from barc_sim.tuning.identification import identify  # noqa: PLC0415
    from barc_sim.vehicle.bike_model import Vehicle  # noqa: PLC0415

    path = target(options.save, FIGURES) if options.save is not None else None
    fields = dict(options.field)
    if fields and not {'v_x', 'motor'} <= fields.keys():
        raise UserError(f'--field names {", ".join(fields)}: expected v_x and motor at least')
    bags = options.bags or [reader.newest()]
    logs = [
        log_of_fields(bag, fields) if fields else reader.read(bag, options.namespace)
        for bag in bags
    ]
    found = identify(*logs, vehicle=Vehicle(mass=options.mass), integrator=options.integrator)
    if options.json:
        result = {
            'parameters': {
                name: _in_json(each._asdict()) for name, each in found.estimates.items()
            },
            'whiteness': _in_json(found.whiteness),
            'remarks': found.remarks,
        }
        print(json.dumps(result, indent=2))  # noqa: T201
    else:
        width = max(map(len, found.estimates))
        for name, each in found.estimates.items():
            print(f'{name:{width}}  {each!s:32} {each.meaning}')  # noqa: T201
        for remark in found.remarks:
            print(f'- {remark}')  # noqa: T201
    if path:
        from barc_sim.figures.tuning_figures import identification_figure  # noqa: PLC0415

        with saving(path) as part:
            title = ', '.join(bag.resolve().name for bag in bags)
            identification_figure(found, title=title).savefig(part, dpi=FIGURE_DPI)
        print(path)  # noqa: T201


def _in_json(values: Mapping[str, object]) -> dict[str, object]:
    """Return values with null for what is no finite number."""
    return {
        name: None if isinstance(value, float) and not isfinite(value) else value
        for name, value in values.items()
    }
