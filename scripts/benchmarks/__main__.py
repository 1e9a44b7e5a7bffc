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
from importlib.metadata import version
from pathlib import Path
from typing import Any

from barc_sim.cli import Parser, call
from barc_sim.errors import UserError

#: Modules of this folder with `add_arguments`, `measure`, `report` and perhaps `plot`.
_NAMES = sorted(
    file.stem for file in Path(__file__).parent.glob('*.py') if not file.stem.startswith('_')
)
_PACKAGES = ('rclpy', 'numpy')


def main(args: list[str] | None = None) -> None:
    """Measure, and show and keep the figures."""
    parser = Parser('bench', description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(metavar='NAME', required=True)
    for name in _NAMES:
        module: Any = importlib.import_module(name)
        about = module.__doc__
        command = commands.add_parser(name, help=about.splitlines()[0], description=about)
        module.add_arguments(command)
        command.add_argument('--json', type=Path, metavar='FILE', help='write the figures there')
        if hasattr(module, 'plot'):
            command.add_argument('--plot', type=Path, metavar='FILE', help='draw them there')
        command.set_defaults(module=module, benchmark=name)
    options = parser.parse_args(args)
    machine = _machine()
    found = options.module.measure(options)
    print(', '.join(f'{key} {value}' for key, value in machine.items()), end='\n\n')
    print(options.module.report(found))
    if options.json:
        figures = {'benchmark': options.benchmark, 'machine': machine, 'found': found}
        _write(options.json, json.dumps(figures, indent=1) + '\n')
    if getattr(options, 'plot', None):
        options.module.plot(found).savefig(options.plot)


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text)
    except OSError as error:
        raise UserError(
            f'the figures cannot be written to {str(path)!r}: {error.strerror}'
        ) from None


def _machine() -> dict[str, str]:
    cpu = next(
        (
            line.partition(':')[2].strip()
            for line in Path('/proc/cpuinfo').read_text().splitlines()
            if line.startswith('model name')
        ),
        platform.machine(),
    )
    return {
        'processor': f'{len(os.sched_getaffinity(0))} x {cpu}',
        'kernel': platform.release(),
        'Python': platform.python_version(),
        **{name: version(name) for name in _PACKAGES},
    }


if __name__ == '__main__':
    sys.exit(call('bench', main))
