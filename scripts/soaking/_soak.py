"""Put barc_sim through faults, and hold it to what it promises; the exit code is 1 where it fails.

Without options each takes as long as its promise needs, with --short a few seconds.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path
from typing import Any

from _figures import table

from barc_sim.cli.parser import Parser, call

#: Modules of this folder: `SHORT` is the help of --short, `soak` does the work, and
#: `add_arguments`, where there is one, declares more options.
_NAMES = sorted(
    file.stem for file in Path(__file__).parent.glob('*.py') if not file.stem.startswith('_')
)


def main(args: list[str] | None = None) -> int:
    """Put it through one kind of fault, and print the figures."""
    parser = Parser(prog='soak', description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(metavar='NAME', required=True)

    for name in _NAMES:
        module: Any = importlib.import_module(name)
        about = module.__doc__
        command = commands.add_parser(name, help=about.splitlines()[0], description=about)
        command.add_argument('--short', action='store_true', help=module.SHORT)
        if hasattr(module, 'add_arguments'):
            module.add_arguments(command)
        command.set_defaults(module=module)

    options = parser.parse_args(args)
    figures = options.module.soak(options)
    print(table(figures))
    return 0 if all(figure.is_within_bounds for figure in figures) else 1


if __name__ == '__main__':
    sys.exit(call('soak', main))
