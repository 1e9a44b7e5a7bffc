"""Command: draw the nodes and topics of the running system, or of a bag's."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence

    from barc_sim.bags.node_graph import NodeGraph

PROG = 'barc graph'
FORMATS = ('svg', 'png', 'pdf')
#: [s] What a graph is looked at for until it has stayed the same for so long, and at most.
_STEADY, _LONGEST = 0.6, 5.0


def parse(argv: Sequence[str] | None = None) -> Namespace:
    """Return the options on the command line."""
    parser = Parser(prog=PROG, description='Draw the nodes and topics of the running system.')
    parser.add_argument(
        '--save',
        metavar='FILE',
        help='save as .svg, .png or .pdf; without it a window opens, or graph.svg is saved where '
        'there is no display',
    )
    parser.add_argument(
        '--bag', type=Path, metavar='BAG', help='those of this recorded run in place of the running'
    )
    return parser.parse_args(argv)


def draw(options: Namespace) -> None:
    """Print the table, and draw: to a file, or to a window where there is a display.

    Raises
    ------
    UserError
        where there is no graph, or the figure can't be saved as asked.
    """
    from barc_sim.figures import output  # noqa: PLC0415 (--help need not wait for matplotlib)
    from barc_sim.figures.graph_figure import GraphDrawing, lines  # noqa: PLC0415

    path = output.target(options.save, FORMATS) if options.save is not None else None
    graph, title = _of_bag(options.bag) if options.bag else _of_system()
    print('\n'.join(lines(graph)))  # noqa: T201
    drawing = GraphDrawing(graph, title)
    window = None if path else output.window(drawing.size, title)
    if window:
        drawing.draw(window)
        output.show()
        return
    path = path or Path('graph.svg')
    with output.replacing(path) as part:
        drawing.save(part)
    print(path)  # noqa: T201


def _of_bag(path: Path) -> tuple[NodeGraph, str]:
    from barc_sim.bags import reader  # noqa: PLC0415
    from barc_sim.bags.node_graph import NodeGraph  # noqa: PLC0415

    text = reader.info(path).get('graph')
    if text is None:
        raise UserError(f'{str(path)!r} has no graph in it: name the bag of a run of this package')
    return NodeGraph.from_json(text), path.resolve().name


def _of_system() -> tuple[NodeGraph, str]:
    """Look around until nothing new turns up."""
    from rclpy.node import Node  # noqa: PLC0415

    from barc_sim.ros.graph_observer import observe  # noqa: PLC0415
    from barc_sim.ros.process import ros  # noqa: PLC0415

    with ros(None):
        node = Node('_graph', enable_rosout=False, start_parameter_services=False)
        domain = node.context.get_domain_id()
        graph = observe(node)
        begin = changed = time.monotonic()
        while (now := time.monotonic()) - changed < _STEADY or not graph.nodes:
            if now - begin > _LONGEST:
                break
            time.sleep(0.05)
            seen = observe(node)
            if seen != graph:
                graph, changed = seen, time.monotonic()
        node.destroy_node()
    if not graph.nodes:
        raise UserError(
            f'no node is running in ROS domain {domain}: start a run first, or name a bag (--bag)'
        )
    return graph, f'ROS domain {domain}'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = parse(argv)
    return call(PROG, lambda: draw(options))


if __name__ == '__main__':
    sys.exit(main())
