"""Draws the nodes and topics of the running system, or of a recorded run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.files import saving, target
from barc_sim.errors import UserError, escaped

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.bags.node_graph import NodeGraph
    from barc_sim.cli.parser import Parser

FORMATS = ('svg', 'png', 'pdf')


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Draw the nodes and topics of the running system.'
    parser.add_argument(
        '--save',
        metavar='FILE',
        help='save as .svg, .png or .pdf; default: a window, or graph.svg without a display',
    )
    parser.add_argument('--bag', type=Path, metavar='BAG', help='draw this recorded run instead')


def run(options: Namespace) -> None:
    """Print the table, and draw it to a file or a window.

    Raises
    ------
    UserError
        where there is no graph, or the figure cannot be saved.
    """
    from barc_sim.figures import output  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.figures.graph_figure import GraphDrawing, lines  # noqa: PLC0415

    path = target(options.save, FORMATS) if options.save is not None else None
    graph, title = _of_bag(options.bag) if options.bag else _of_system()
    print(escaped('\n'.join(lines(graph))))  # noqa: T201
    drawing = GraphDrawing(graph, title)
    window = None if path else output.window(drawing.size, title)
    if window:
        drawing.draw(window)
        output.show()
        return
    path = path or Path('graph.svg')
    with saving(path) as part:
        drawing.save(part)
    print(path)  # noqa: T201


def _of_bag(path: Path) -> tuple[NodeGraph, str]:
    from barc_sim.bags import reader  # noqa: PLC0415
    from barc_sim.bags.node_graph import NodeGraph  # noqa: PLC0415

    text = reader.info(path).get('graph')
    if text is None:
        raise UserError(f'{str(path)!r} holds no graph: name the bag of a run of barc_sim')
    try:
        return NodeGraph.from_json(text), path.resolve().name
    except ValueError as error:
        raise UserError(
            f'the graph in {str(path)!r} cannot be drawn ({error}): name the bag of a run'
        ) from None


def _of_system() -> tuple[NodeGraph, str]:
    """Return the running graph once it is stable, and its title."""
    from barc_sim.ros import graph_observer  # noqa: PLC0415
    from barc_sim.ros.introspection.observer import observe  # noqa: PLC0415

    with observe('graph') as observer:

        def read() -> NodeGraph | None:
            graph = graph_observer.observe(observer.node)
            return graph if graph.nodes else None

        graph = observer.wait_until_stable(read)
    if not graph:
        raise UserError(
            f'no node is running in ROS domain {observer.domain}: start a run first, or name a '
            'bag (--bag)'
        )
    return graph, f'ROS domain {observer.domain}'
