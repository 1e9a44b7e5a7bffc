"""`topics`, `echo`, `param`, `graph`, `show` and `node`: like `ros2`'s commands, without `ros2`."""

from __future__ import annotations

from argparse import REMAINDER
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.files import saving, target
from barc_sim.cli.parser import ROS_ARGS, call, show, whole
from barc_sim.cli.process import require_ros
from barc_sim.errors import UserError, escaped
from barc_sim.interfaces.nodes import ALONE

if TYPE_CHECKING:
    from argparse import Namespace

    from rclpy.node import Node

    from barc_sim.bags.graph import NodeGraph
    from barc_sim.cli.parser import Parser

_FORMATS = ('svg', 'png', 'pdf')


def add_arguments_topics(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'List topics with their types, publishers and subscribers, as `ros2 topic list` and '
        '`ros2 topic info` do.'
    )
    parser.add_argument('topics', nargs='*', metavar='TOPIC', help='only these topics (all)')
    parser.add_argument(
        '-v', '--verbose', action='store_true', help='also nodes and their quality of service'
    )


def run_topics(options: Namespace) -> None:
    """Print the topics."""
    require_ros('barc topics')
    from barc_sim.ros.introspection import observe, print_topics  # noqa: PLC0415 (slow)

    with observe('topics') as observer:
        print_topics(observer, options.topics, full=options.verbose)


def add_arguments_echo(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Print the messages of a topic, until Ctrl-C, as `ros2 topic echo` does.'
    parser.add_argument('topic', metavar='TOPIC', help='a topic, such as z_vhcl or /car2/z_vhcl')
    count = parser.add_mutually_exclusive_group()
    count.add_argument(
        '--once', dest='count', action='store_const', const=1, help='print one message'
    )
    count.add_argument('-n', dest='count', type=whole(1), metavar='N', help='print N messages')


def run_echo(options: Namespace) -> None:
    """Print messages up to the requested number, or until a signal."""
    require_ros('barc echo')
    from barc_sim.ros.introspection import observe, print_messages  # noqa: PLC0415

    with observe('echo') as observer:
        print_messages(observer, options.topic, options.count)


def add_arguments_param(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'List, read and set parameters of running nodes, as `ros2 param` does.'
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='VERB')
    verb: Parser = verbs.add_parser('list', help='print the names of the parameters')
    verb.add_argument('node', nargs='?', metavar='NODE', help='only this node (all)')
    for name, about in (
        ('get', 'print the value of a parameter'),
        ('set', 'set a parameter, and print its value'),
    ):
        verb = verbs.add_parser(name, help=about)
        verb.add_argument('node', metavar='NODE', help='such as controller or /car2/controller')
        verb.add_argument('name', metavar='NAME', help='the parameter')
    verb.add_argument('value', metavar='VALUE', help='the new value in YAML, such as 20.0')


def run_param(options: Namespace) -> None:
    """Run the verb."""
    require_ros('barc param')
    from barc_sim.ros.introspection import RemoteParameters, observe, print_names  # noqa: PLC0415

    with observe('param') as observer:
        if options.verb == 'list':
            print_names(observer, options.node)
            return
        parameters = RemoteParameters(observer, options.node)
        if options.verb == 'set':
            parameters.set(options.name, options.value)
        show(parameters.get(options.name))


def add_arguments_graph(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Draw the nodes and topics of the running system, or of a recorded run.'
    parser.add_argument(
        'bag', nargs='?', type=Path, metavar='BAG', help='draw this recorded run instead'
    )
    parser.add_argument(
        '--save',
        metavar='FILE',
        help='save as .svg, .png or .pdf (a window; without a display, graph.svg)',
    )
    parser.add_argument('--bag', dest='named', type=Path, metavar='BAG', help='the same')


def run_graph(options: Namespace) -> None:
    """Print the table, and draw it to a file or a window."""
    from barc_sim.figures import windows  # noqa: PLC0415
    from barc_sim.figures.graph_figure import graph_figure, lines, save  # noqa: PLC0415

    path = target(options.save, _FORMATS) if options.save is not None else None
    bag = options.bag or options.named
    graph, title = _graph_of_bag(bag) if bag else _graph_of_system()
    show('\n'.join(lines(graph)))
    window = None if path else windows.window(title)
    figure = graph_figure(graph, title, window)
    if window:
        windows.show()
        return
    path = path or Path('graph.svg')
    with saving(path) as part:
        save(figure, part)
    show(path)


def _graph_of_bag(path: Path) -> tuple[NodeGraph, str]:
    from barc_sim.bags import reader  # noqa: PLC0415
    from barc_sim.bags.graph import NodeGraph  # noqa: PLC0415

    text = reader.info(path).get('graph')
    if text is None:
        raise UserError(f'{str(path)!r} holds no graph: name the bag of a run of barc_sim')
    try:
        return NodeGraph.from_json(text), escaped(path.resolve().name)
    except ValueError as error:
        raise UserError(
            f'the graph in {str(path)!r} cannot be drawn ({error}): name the bag of a run'
        ) from None


def _graph_of_system() -> tuple[NodeGraph, str]:
    """Return the running graph once it is stable, and its title."""
    require_ros('barc graph')
    from barc_sim.ros.introspection import observe  # noqa: PLC0415
    from barc_sim.ros.peers import node_graph  # noqa: PLC0415

    with observe('graph') as observer:
        graph: NodeGraph = observer.wait_until_stable(lambda: node_graph(observer.node))
        return graph, f'ROS domain {observer.node.context.get_domain_id()}'


def add_arguments_show(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Print the definition of a message, service or action, as `ros2 interface show` does; it '
        'needs neither ROS nor a run.'
    )
    parser.add_argument(
        'type', metavar='TYPE', help='such as ECU, std_msgs/Header or barc_interfaces/msg/ECU'
    )


def run_show(options: Namespace) -> None:
    """Print the definition."""
    from barc_sim.interfaces.definitions import definition_lines, find_type  # noqa: PLC0415

    for line in definition_lines(find_type(options.type)):
        print(line)  # noqa: T201


def add_arguments_node(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Run one node alone in this process, until Ctrl-C.'
    parser.add_argument('name', choices=ALONE, metavar='NAME', help=', '.join(ALONE))
    parser.add_argument(
        'arguments', nargs=REMAINDER, metavar='...', help='for ROS, such as --ros-args -p kp:=20.0'
    )


def run_node(options: Namespace) -> int:
    """Run the node, and return the exit code."""
    if options.arguments and options.arguments[0] != ROS_ARGS:
        raise UserError(
            f'a node takes no {options.arguments[0]!r}: give its parameters to ROS, as in '
            f'{ROS_ARGS} -p kp:=20.0'
        )
    require_ros('barc node')
    description = ALONE[options.name]
    node_class = getattr(import_module(description.module), description.class_name)
    from barc_sim.ros.process import spin  # noqa: PLC0415

    def create() -> Node:
        node: Node = node_class()
        if url := getattr(node, 'url', ''):  # not into /rosout: a page's has its token
            print(f'{options.name}  {url}', flush=True)  # noqa: T201
        return node

    return call(
        options.name, lambda: bool(getattr(spin(create, options.arguments), 'failure', None))
    )
