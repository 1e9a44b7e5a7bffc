"""What `barc param` does with the parameters of a running node, and prints as `ros2 param` does."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import yaml
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from barc_sim.bags.bounds import MAX_LONG_TEXT, from_yaml
from barc_sim.cli.files import read_regular
from barc_sim.cli.parser import did_you_mean
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from rcl_interfaces.msg import ParameterDescriptor, ParameterValue

    from barc_sim.ros.observer import GraphObserver

#: As `ros2 param describe` prints them.
TYPES = {
    ParameterType.PARAMETER_NOT_SET: 'not set',
    ParameterType.PARAMETER_BOOL: 'boolean',
    ParameterType.PARAMETER_INTEGER: 'integer',
    ParameterType.PARAMETER_DOUBLE: 'double',
    ParameterType.PARAMETER_STRING: 'string',
    ParameterType.PARAMETER_BYTE_ARRAY: 'byte array',
    ParameterType.PARAMETER_BOOL_ARRAY: 'boolean array',
    ParameterType.PARAMETER_INTEGER_ARRAY: 'integer array',
    ParameterType.PARAMETER_DOUBLE_ARRAY: 'double array',
    ParameterType.PARAMETER_STRING_ARRAY: 'string array',
}
_KEY = 'ros__parameters'
_EXPECTED = f'expected nodes with {_KEY}, as `barc param dump` writes them'


class Parameters:
    """The parameters of a node."""

    def __init__(self, observer: GraphObserver, node: str) -> None:
        """Find the node's services."""
        self.node = observer.find_node(node)  #: its full name
        self._observer = observer
        self._client = AsyncParameterClient(observer.node, self.node)
        if not observer.wait_for(self._client.services_are_ready):
            raise UserError(f'{self.node} has no parameter services')

    def names(self) -> list[str]:
        """Return the names of all parameters, in order."""
        response = self._observer.request(self._client.list_parameters, self.node)
        return sorted(response.result.names)

    def values(self, names: Sequence[str]) -> dict[str, ParameterValue]:
        """Return the values of the named parameters, which exist."""
        response = self._observer.request(lambda: self._client.get_parameters(names), self.node)
        return dict(zip(names, response.values, strict=True))

    def descriptors(self, names: Sequence[str]) -> dict[str, ParameterDescriptor]:
        """Return the descriptors of the named parameters, which exist."""
        response = self._observer.request(
            lambda: self._client.describe_parameters(names), self.node
        )
        return dict(zip(names, response.descriptors, strict=True))

    def set(self, values: Mapping[str, Any]) -> dict[str, str]:
        """Set each parameter on its own; return the reason of each that could not be set.

        A whole number will do for a double. A read-only parameter that has the value already is
        left alone.
        """
        declared = self.names()
        refused = {name: self._unknown(name, declared) for name in values if name not in declared}
        names = [name for name in values if name in declared]
        descriptors, present = self.descriptors(names), self.values(names)
        sent = []
        for name in names:
            value = _as_declared(values[name], descriptors[name].type)
            same = value == parameter_value_to_python(present[name])
            if descriptors[name].read_only and not same:
                setting = f'{self.node.rpartition("/")[2]}:{name}:={_in_yaml(value)}'
                refused[name] = f'it is read-only: set it at the start (--ros-args -p {setting})'
            elif not descriptors[name].read_only:
                try:
                    sent.append(Parameter(name, value=value))
                except (TypeError, AssertionError, OverflowError):
                    refused[name] = (
                        f'it cannot be {value!r}: expected a boolean, a number, a string, or a '
                        'list of one of these'
                    )
        response = self._observer.request(lambda: self._client.set_parameters(sent), self.node)
        for parameter, result in zip(sent, response.results, strict=True):
            if not result.successful:
                refused[parameter.name] = (
                    f'{self.node} refused it: {result.reason or "without a reason"}'
                )
        return {name: refused[name] for name in values if name in refused}

    def check(self, names: Sequence[str]) -> None:
        """Raise UserError unless the node has these parameters."""
        declared = self.names()
        for name in names:
            if name not in declared:
                raise UserError(self._unknown(name, declared))

    def _unknown(self, name: str, declared: list[str]) -> str:
        hint = did_you_mean(name, declared) or f': it has {", ".join(declared)}'
        return f'{self.node} has no parameter {name}{hint}'


def print_names(observer: GraphObserver, node: str | None) -> None:
    """Print the names of a node's parameters, or those of all nodes."""
    nodes = [observer.find_node(node)] if node else observer.wait_until_stable(observer.nodes)
    if not nodes:
        raise observer.no_node()
    for each in nodes:
        try:
            names = Parameters(observer, each).names()
        except UserError as error:
            if node:
                raise
            print(f'barc param: {error}', file=sys.stderr)  # noqa: T201 (continue with the others)
            continue
        heading = [] if node else [f'{each}:']
        print('\n'.join([*heading, *(f'  {name}' for name in names)]))  # noqa: T201


def print_value(parameters: Parameters, name: str) -> None:
    """Print the line of `ros2 param get`."""
    parameters.check([name])
    value = parameters.values([name])[name]
    if value.type == ParameterType.PARAMETER_NOT_SET:
        print('Parameter not set.')  # noqa: T201
        return
    label = TYPES[value.type].replace('array', 'values are').capitalize()
    label += '' if 'values' in label else ' value is'
    print(f'{label}: {parameter_value_to_python(value)}')  # noqa: T201


def print_descriptions(parameters: Parameters, names: Sequence[str]) -> None:
    """Print the lines of `ros2 param describe` for these parameters, or for all."""
    parameters.check(names)
    for descriptor in parameters.descriptors(names or parameters.names()).values():
        lines = [f'Parameter name: {descriptor.name}', f'  Type: {TYPES[descriptor.type]}']
        if descriptor.description:
            lines.append(f'  Description: {descriptor.description}')
        lines.append('  Constraints:')
        if descriptor.read_only:
            lines.append('    Read only: true')
        for span in [*descriptor.floating_point_range, *descriptor.integer_range][:1]:
            lines += [f'    Min value: {span.from_value}', f'    Max value: {span.to_value}']
            lines += [f'    Step: {span.step}'] if span.step else []
        if descriptor.additional_constraints:
            lines.append(f'    Additional constraints: {descriptor.additional_constraints}')
        print('\n'.join(lines))  # noqa: T201


def set_value(parameters: Parameters, name: str, text: str) -> None:
    """Set a parameter to the value of `text`: in YAML, unless it is declared as a string."""
    parameters.check([name])
    declared = parameters.descriptors([name])[name].type
    is_string = declared == ParameterType.PARAMETER_STRING
    try:
        value = yaml.load(text, yaml.BaseLoader if is_string else yaml.SafeLoader)  # noqa: S506
    except yaml.YAMLError:
        raise UserError(f'{text!r} is not a value in YAML: a string may need quotes') from None
    for reason in parameters.set({name: text if value is None else value}).values():
        raise UserError(f'parameter {name} cannot be set: {reason}')
    print('Set parameter successful')  # noqa: T201


def load(parameters: Parameters, path: Path) -> int:
    """Set the parameters in a file, print what was done, and return the exit code."""
    values = read_file(path, parameters.node)
    refused = parameters.set(values)
    for name in values:
        if name not in refused:
            print(f'Set parameter {name} successful', flush=True)  # noqa: T201
    for name, reason in refused.items():
        print(f'Set parameter {name} failed: {reason}', file=sys.stderr)  # noqa: T201
    return 1 if refused else 0


def print_file(parameters: Parameters) -> None:
    """Print all parameters of a node as a file."""
    values = parameters.values(parameters.names())
    print(  # noqa: T201
        file_text(
            parameters.node,
            {
                name: parameter_value_to_python(value)
                for name, value in values.items()
                if value.type != ParameterType.PARAMETER_NOT_SET
            },
        ),
        end='',
    )


def file_text(node: str, values: Mapping[str, Any]) -> str:
    """Return the text of a node's file; a dot in a name opens a level."""
    nested: dict[str, Any] = {}
    for name, value in values.items():
        *groups, last = name.split('.')
        level = nested
        for group in groups:
            level = level.setdefault(group, {})
        level[last] = value
    return yaml.safe_dump({node: {_KEY: nested}}, default_flow_style=False, allow_unicode=True)


def read_file(path: Path, node: str) -> dict[str, Any]:
    """Return the parameters in the file for the node of this full name, and those for `/**`.

    They have their YAML types, as in rcl; `rclpy.parameter_client` reads 1.0e-7 as a string and
    '7' as a number.
    """
    try:
        content = from_yaml(read_regular(path, MAX_LONG_TEXT).decode())
    except OSError as error:
        raise UserError(f'{str(path)!r} cannot be read: {error.strerror}') from None
    except ValueError as error:
        reason = ' '.join(str(error).split())
        raise UserError(f'{str(path)!r} is not a text of YAML: {reason}') from None
    levels = [
        value[_KEY]
        for key, value in (content.items() if isinstance(content, dict) else ())
        if f'/{str(key).lstrip("/")}' in ('/**', node) and isinstance(value, dict)
        if isinstance(value.get(_KEY), dict)
    ]
    if not levels:
        raise UserError(f'{str(path)!r} has no parameters for {node}: {_EXPECTED}')
    return {name: value for level in levels for name, value in _flat(level, path)}


def _flat(level: Mapping[Any, Any], path: Path, prefix: str = '') -> Iterator[tuple[str, Any]]:
    for key, value in level.items():
        name = f'{prefix}{key}'
        if isinstance(value, dict):
            yield from _flat(value, path, f'{name}.')
        elif value is None:
            raise UserError(f'parameter {name} in {str(path)!r} has no value: give it one')
        else:
            yield name, value


def _as_declared(value: Any, declared: int) -> Any:  # noqa: ANN401 (anything in YAML)
    """Return a whole number, or one that YAML takes for text such as 1e-7, as a double."""
    if declared == ParameterType.PARAMETER_DOUBLE and type(value) in (int, str):
        with suppress(ValueError):
            return float(value)
    return value


def _in_yaml(value: Any) -> str:  # noqa: ANN401
    """Return a value as YAML writes it, such as 1.0e-07."""
    return yaml.safe_dump(value, default_flow_style=True, width=2**30).partition('\n')[0]
