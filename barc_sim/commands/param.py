"""Command: look at and set the parameters of running nodes, as `ros2 param` does."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence

    from barc_sim.ros.introspection.observer import Look
    from barc_sim.ros.introspection.parameters import Verdict

PROG = 'barc param'


def parse(argv: Sequence[str] | None = None) -> Namespace:
    """Return the options on the command line."""
    parser = Parser(
        prog=PROG,
        description='Look at and set the parameters of running nodes, as `ros2 param` does.',
    )
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='VERB')

    verb = verbs.add_parser('list', help='the names of the parameters')
    verb.add_argument('node', nargs='?', metavar='NODE', help='of this node only (all)')
    verb.add_argument('--param-type', action='store_true', help='print their types, too')
    verb.add_argument(
        '--include-hidden-nodes', action='store_true', help='also nodes with a _ before the name'
    )
    verb.set_defaults(run=_list)

    verb = verbs.add_parser('get', help='the value of a parameter')
    _add_names(verb, 'name')
    verb.add_argument('--hide-type', action='store_true', help='print nothing but the value')
    verb.set_defaults(run=_get)

    verb = verbs.add_parser('set', help='give a parameter a value')
    _add_names(verb, 'name')
    verb.add_argument('value', metavar='VALUE', help='in YAML: 20.0 is a double, 20 an integer')
    verb.set_defaults(run=_set)

    verb = verbs.add_parser('describe', help='what a parameter is, and between which bounds')
    _add_names(verb)
    verb.add_argument('names', nargs='*', metavar='NAME', help='these only (all)')
    verb.set_defaults(run=_describe)

    verb = verbs.add_parser('dump', help='all parameters of a node, as a file')
    _add_names(verb)
    verb.set_defaults(run=_dump)

    verb = verbs.add_parser('load', help='set the parameters in a file')
    _add_names(verb)
    verb.add_argument('file', type=Path, metavar='FILE', help='as `dump` prints it')
    verb.add_argument(
        '--no-use-wildcard', action='store_true', help='leave out those for /** and the like'
    )
    verb.set_defaults(run=_load)
    return parser.parse_args(argv)


def _add_names(verb: Parser, *names: str) -> None:
    verb.add_argument('node', metavar='NODE', help='such as controller or /car2/controller')
    for name in names:
        verb.add_argument(name, metavar=name.upper(), help='of the parameter')


def param(options: Namespace) -> int:
    """Do what is asked for, and return the exit code.

    Raises
    ------
    UserError
        where a node, a parameter or a file is not there, or a value is refused.
    """
    from barc_sim.ros.introspection.observer import looking  # noqa: PLC0415 (--help need not wait for ROS)

    with looking('param') as look:
        code: int | None = options.run(look, options)
        return code or 0


def _list(look: Look, options: Namespace) -> None:
    from barc_sim.ros.introspection.parameter_text import type_name  # noqa: PLC0415
    from barc_sim.ros.introspection.parameters import Parameters  # noqa: PLC0415

    if options.node:
        nodes = [look.peer(options.node)]
    else:
        nodes = look.settled(lambda: look.nodes(hidden=options.include_hidden_nodes))
        if not nodes:
            raise UserError(f'no node is running in ROS domain {look.domain}: start a run first')
    for node in nodes:
        try:
            parameters = Parameters(look, node)
            names = parameters.names()
        except UserError as error:
            if options.node:
                raise
            print(f'{PROG}: {error}', file=sys.stderr)  # noqa: T201 (the others are as good)
            continue
        types = {}
        if options.param_type:
            types = {
                one.name: f' (type: {type_name(one)})' for one in parameters.descriptors(names)
            }
        if not options.node:
            print(f'{node}:')  # noqa: T201
        for name in names:
            print(f'  {name}{types.get(name, "")}')  # noqa: T201


def _get(look: Look, options: Namespace) -> None:
    from rclpy.parameter import parameter_value_to_python  # noqa: PLC0415

    from barc_sim.ros.introspection.parameter_text import labelled  # noqa: PLC0415
    from barc_sim.ros.introspection.parameters import Parameters  # noqa: PLC0415

    (value,) = Parameters(look, options.node).values([options.name])
    print(parameter_value_to_python(value) if options.hide_type else labelled(value))  # noqa: T201


def _set(look: Look, options: Namespace) -> None:
    from barc_sim.ros.introspection.parameter_text import parsed  # noqa: PLC0415
    from barc_sim.ros.introspection.parameters import Parameters  # noqa: PLC0415

    value = parsed(options.value)
    (verdict,) = Parameters(look, options.node).set({options.name: value})
    if not verdict.done:
        raise UserError(verdict.why)
    print(f'Set parameter successful{_remark(verdict)}')  # noqa: T201


def _describe(look: Look, options: Namespace) -> None:
    from barc_sim.ros.introspection.parameter_text import described  # noqa: PLC0415
    from barc_sim.ros.introspection.parameters import Parameters  # noqa: PLC0415

    for descriptor in Parameters(look, options.node).descriptors(options.names):
        print('\n'.join(described(descriptor)))  # noqa: T201


def _dump(look: Look, options: Namespace) -> None:
    from rclpy.parameter import parameter_value_to_python  # noqa: PLC0415

    from barc_sim.ros.introspection import parameter_file  # noqa: PLC0415
    from barc_sim.ros.introspection.parameters import Parameters  # noqa: PLC0415

    parameters = Parameters(look, options.node)
    names = parameters.names()
    values = map(parameter_value_to_python, parameters.values(names))
    known = {name: value for name, value in zip(names, values, strict=True) if value is not None}
    print(parameter_file.text(parameters.node, known), end='')  # noqa: T201


def _load(look: Look, options: Namespace) -> int:
    from barc_sim.ros.introspection import parameter_file  # noqa: PLC0415
    from barc_sim.ros.introspection.parameter_text import as_value  # noqa: PLC0415
    from barc_sim.ros.introspection.parameters import Parameters  # noqa: PLC0415

    parameters = Parameters(look, options.node)
    values = parameter_file.read(
        options.file, parameters.node, wildcards=not options.no_use_wildcard
    )
    verdicts = parameters.set({name: as_value(value, name) for name, value in values.items()})
    for verdict in verdicts:
        if verdict.done:
            print(f'Set parameter {verdict.name} successful{_remark(verdict)}')  # noqa: T201
    sys.stdout.flush()
    for verdict in verdicts:
        if not verdict.done:
            print(f'Set parameter {verdict.name} failed: {verdict.why}', file=sys.stderr)  # noqa: T201
    return 0 if all(verdict.done for verdict in verdicts) else 1


def _remark(verdict: Verdict) -> str:
    return f': {verdict.why}' if verdict.why else ''


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = parse(argv)
    return call(PROG, lambda: param(options))


if __name__ == '__main__':
    sys.exit(main())
