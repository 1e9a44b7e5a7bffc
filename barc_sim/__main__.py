"""`python -m barc_sim COMMAND`, and `barc COMMAND`."""

from __future__ import annotations

import sys
from importlib import import_module

COMMANDS = (
    'check',
    'echo',
    'grade',
    'graph',
    'new',
    'param',
    'plot',
    'record',
    'recover',
    'regrade',
    'replay',
    'report',
    'topics',
    'tune',
    'validate',
)
#: Modules of the nodes, each to be run alone: `barc node NAME`.
NODES = {
    'bag_recorder': 'recorder.node',
    'controller': 'controller',
    'foxglove_server': 'foxglove',
    'keyboard': 'keyboard.node',
    'mirror': 'mirrors.node',
    'relay': 'relay',
    'vehicle_simulator': 'simulator.node',
    'view': 'view.node',
}


def main(argv: list[str] | None = None) -> int:
    """Run the command line `argv`; return the exit code."""
    argv = sys.argv[1:] if argv is None else argv
    if argv[:1] == ['node'] and argv[1:] and argv[1] in NODES:
        return int(import_module(f'barc_sim.nodes.{NODES[argv[1]]}').main(argv[2:]))
    if not argv or argv[0] not in COMMANDS:
        print(f'usage: barc {{{",".join(COMMANDS)}}} ...', file=sys.stderr)  # noqa: T201
        return 2
    return int(import_module(f'barc_sim.commands.{argv[0]}').main(argv[1:]))


if __name__ == '__main__':
    sys.exit(main())
