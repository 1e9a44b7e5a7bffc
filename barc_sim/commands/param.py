"""Lists, reads and sets the parameters of running nodes, as `ros2 param` does."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.parser import Parser
    from barc_sim.ros.introspection.observer import GraphObserver
    from barc_sim.ros.introspection.parameters import Parameters, Verdict


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'List, read and set parameters of running nodes, as `ros2 param` does.'
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='VERB')

    verb = verbs.add_parser('list', help='print the names of the parameters')
    verb.add_argument('node', nargs='?', metavar='NODE', help='of this node only (all)')
    verb.add_argument('--param-type', action='store_true', help='print their types, too')
    verb.add_argument(
        '--include-hidden-nodes', action='store_true', help='also nodes with a _ before the name'
    )

    verb = verbs.add_parser('get', help='print the value of a parameter')
    _add_names(verb, 'name')
    verb.add_argument('--hide-type', action='store_true', help='print the value only')
    verb.set_defaults(verb_run=_get)

    verb = verbs.add_parser('set', help='set a parameter')
    _add_names(verb, 'name')
    verb.add_argument('value', metavar='VALUE', help='in YAML: 20.0 is a double, 20 an integer')
    verb.set_defaults(verb_run=_set)

    verb = verbs.add_parser('describe', help='print type, meaning and bounds of parameters')
    _add_names(verb)
    verb.add_argument('names', nargs='*', metavar='NAME', help='these only (all)')
    verb.set_defaults(verb_run=_describe)

    verb = verbs.add_parser('dump', help='print all parameters of a node as a parameter file')
    _add_names(verb)
    verb.set_defaults(verb_run=_dump)

    verb = verbs.add_parser('load', help='set the parameters in a file')
    _add_names(verb)
    verb.add_argument('file', type=Path, metavar='FILE', help='as `dump` prints it')
    verb.add_argument(
        '--no-use-wildcard', action='store_true', help='ignore entries with a wildcard, such as /**'
    )
    verb.set_defaults(verb_run=_load)


def _add_names(verb: Parser, *names: str) -> None:
    verb.add_argument('node', metavar='NODE', help='such as controller or /car2/controller')
    for name in names:
        verb.add_argument(name, metavar=name.upper(), help='of the parameter')


def run(options: Namespace) -> int:
    """Run the verb, and return the exit code.

    Raises
    ------
    UserError
        where a node, a parameter or a file does not exist, or a value is refused.
    """
    from barc_sim.ros.introspection.observer import observe  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.ros.introspection.parameters import Parameters  # noqa: PLC0415

    with observe('param') as observer:
        if options.verb == 'list':
            _list(observer, options)
            return 0
        code: int | None = options.verb_run(Parameters(observer, options.node), options)
        return code or 0


def _list(observer: GraphObserver, options: Namespace) -> None:
    from barc_sim.ros.introspection.parameters import TYPES, Parameters  # noqa: PLC0415

    if options.node:
        nodes = [observer.find_node(options.node)]
    else:
        nodes = observer.wait_until_stable(
            lambda: observer.nodes(hidden=options.include_hidden_nodes)
        )
        if not nodes:
            raise UserError(
                f'no node is running in ROS domain {observer.domain}: start a run first'
            )
    for node in nodes:
        try:
            parameters = Parameters(observer, node)
            names = parameters.names()
        except UserError as error:
            if options.node:
                raise
            print(f'barc param: {error}', file=sys.stderr)  # noqa: T201 (go on with the others)
            continue
        types = {}
        if options.param_type:
            types = {
                one.name: f' (type: {TYPES[one.type]})' for one in parameters.descriptors(names)
            }
        if not options.node:
            print(f'{node}:')  # noqa: T201
        for name in names:
            print(f'  {name}{types.get(name, "")}')  # noqa: T201


def _get(parameters: Parameters, options: Namespace) -> None:
    from rclpy.parameter import parameter_value_to_python  # noqa: PLC0415

    from barc_sim.ros.introspection.parameters import labelled  # noqa: PLC0415

    (value,) = parameters.values([options.name])
    print(parameter_value_to_python(value) if options.hide_type else labelled(value))  # noqa: T201


def _set(parameters: Parameters, options: Namespace) -> None:
    from barc_sim.ros.introspection.parameters import parse_value  # noqa: PLC0415

    value = parse_value(options.value)
    (verdict,) = parameters.set({options.name: value})
    if not verdict.done:
        raise UserError(verdict.reason)
    print(f'Set parameter successful{_remark(verdict)}')  # noqa: T201


def _describe(parameters: Parameters, options: Namespace) -> None:
    from barc_sim.ros.introspection.parameters import description  # noqa: PLC0415

    for descriptor in parameters.descriptors(options.names):
        print('\n'.join(description(descriptor)))  # noqa: T201


def _dump(parameters: Parameters, _: Namespace) -> None:
    from rclpy.parameter import parameter_value_to_python  # noqa: PLC0415

    from barc_sim.ros.introspection.parameters import file_text  # noqa: PLC0415

    names = parameters.names()
    values = map(parameter_value_to_python, parameters.values(names))
    known = {name: value for name, value in zip(names, values, strict=True) if value is not None}
    print(file_text(parameters.node, known), end='')  # noqa: T201


def _load(parameters: Parameters, options: Namespace) -> int:
    from barc_sim.ros.introspection.parameters import (  # noqa: PLC0415
        read_file,
        to_parameter_value,
    )

    values = read_file(options.file, parameters.node, wildcards=not options.no_use_wildcard)
    verdicts = parameters.set(
        {name: to_parameter_value(value, name) for name, value in values.items()}
    )
    for verdict in verdicts:
        if verdict.done:
            print(f'Set parameter {verdict.name} successful{_remark(verdict)}')  # noqa: T201
    sys.stdout.flush()
    for verdict in verdicts:
        if not verdict.done:
            print(f'Set parameter {verdict.name} failed: {verdict.reason}', file=sys.stderr)  # noqa: T201
    return 0 if all(verdict.done for verdict in verdicts) else 1


def _remark(verdict: Verdict) -> str:
    return f': {verdict.reason}' if verdict.reason else ''
