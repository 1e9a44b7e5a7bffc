"""Measure the speed of barc_sim's parts on this machine, beside what they replace.

Every measurement runs in a process of its own, and those to compare run in turns. Shown are
medians, with ranges in brackets.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import sys
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from barc_sim.cli.parser import Parser, call
from barc_sim.errors import UserError

#: Modules of this folder with `add_arguments`, `measure`, `report`, and options that are `QUICK`.
_NAMES = sorted(
    file.stem for file in Path(__file__).parent.glob('*.py') if not file.stem.startswith('_')
)
#: Wheels, by their names on PyPI; and what a sourced ROS calls them.
_PACKAGES = {'ros-rclpy': 'rclpy', 'ros-rmw-fastrtps-cpp': 'rmw_fastrtps_cpp', 'numpy': 'numpy'}


def main(args: list[str] | None = None) -> None:
    """Measure, and show and keep the figures."""
    modules: dict[str, Any] = {name: importlib.import_module(name) for name in _NAMES}
    parser = _parser(modules)
    options = parser.parse_args(args)
    if options.module:
        _measure(options)
    else:
        _measure_quickly(parser, modules)


def _parser(modules: dict[str, Any]) -> Parser:
    parser = Parser(
        prog='bench', description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    commands = parser.add_subparsers(metavar='NAME', required=True)
    about = 'whether each of the others works: once, as short as it can be'
    commands.add_parser('quick', help=about).set_defaults(module=None)

    for name, module in modules.items():
        about = module.__doc__
        command = commands.add_parser(name, help=about.splitlines()[0], description=about)
        module.add_arguments(command)
        command.add_argument('--json', type=Path, metavar='FILE', help='write the figures there')
        command.set_defaults(module=module, benchmark=name)
    return parser


def _measure_quickly(parser: Parser, modules: dict[str, Any]) -> None:
    for name, module in modules.items():
        print(f'\n{name}', flush=True)
        options = parser.parse_args([name, *module.QUICK])
        print(module.report(module.measure(options)))


def _measure(options: argparse.Namespace) -> None:
    machine = _machine()
    results = options.module.measure(options)
    print(', '.join(f'{key} {value}' for key, value in machine.items()), end='\n\n')
    print(options.module.report(results))

    if options.json:
        figures = {'benchmark': options.benchmark, 'machine': machine, 'found': results}
        _write(options.json, json.dumps(figures, indent=1) + '\n')


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise UserError(
            f'the figures cannot be written to {str(path)!r}: {error.strerror}'
        ) from None


def _machine() -> dict[str, str]:
    """Return what the figures depend on."""
    machine = {
        'processor': f'{len(os.sched_getaffinity(0))} x {_processor()}',
        'kernel': platform.release(),
        'Python': platform.python_version(),
    }
    for wheel, name in _PACKAGES.items():
        machine[name] = _version(wheel, name)
    return machine


def _processor() -> str:
    for line in Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines():
        if line.startswith('model name'):
            return line.partition(':')[2].strip()
    return platform.machine()


def _version(*names: str) -> str:
    """Return the version of the first of these packages that is installed."""
    for name in names:
        with suppress(PackageNotFoundError):
            return version(name)
    return 'unknown'


if __name__ == '__main__':
    sys.exit(call('bench', main))
