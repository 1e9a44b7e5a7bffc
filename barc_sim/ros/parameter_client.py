"""What `barc param` does with the parameters of a running node, and prints as `ros2 param` does."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import yaml
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from barc_sim.cli.parser import did_you_mean
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rcl_interfaces.msg import ParameterDescriptor, ParameterValue

    from barc_sim.ros.observer import GraphObserver


class Parameters:
    """The parameters of a node."""

    def __init__(self, observer: GraphObserver, node: str) -> None:
        """Find the node's services."""
        self.node = observer.find_node(node)  #: its full name
        self._observer = observer
        self._client = AsyncParameterClient(observer.node, self.node)
        if not observer.wait_for(self._client.services_are_ready):
            raise UserError(f'{self.node} has no parameter services')

    def _request(self, send: Any, *arguments: Any) -> Any:  # noqa: ANN401 (a service's own)
        return self._observer.request(lambda: send(*arguments), self.node)

    def names(self) -> list[str]:
        """Return the names of all parameters, in order."""
        return sorted(self._request(self._client.list_parameters).result.names)

    def checked(self, names: Sequence[str]) -> Sequence[str]:
        """Return the names, or all without any; UserError: the node lacks one of them."""
        declared = self.names()
        for name in names:
            if name not in declared:
                hint = did_you_mean(name, declared) or f': it has {", ".join(declared)}'
                raise UserError(f'{self.node} has no parameter {name}{hint}')
        return names or declared

    def values(self, names: Sequence[str] = ()) -> dict[str, ParameterValue]:
        """Return the values of the named parameters, or of all."""
        names = self.checked(names)
        return dict(zip(names, self._request(self._client.get_parameters, names).values))  # noqa: B905

    def descriptors(self, names: Sequence[str] = ()) -> list[ParameterDescriptor]:
        """Return the descriptors of the named parameters, or of all."""
        return [*self._request(self._client.describe_parameters, self.checked(names)).descriptors]

    def set(self, name: str, value: object) -> str:
        """Set a parameter; return why that is impossible, or ''."""
        try:
            parameter = Parameter(name, value=value)
        except (TypeError, AssertionError, OverflowError):
            return (
                f'it cannot be {value!r}: expected a boolean, a number, a string, or a list of one '
                'of these'
            )
        (result,) = self._request(self._client.set_parameters, [parameter]).results
        why = result.reason or 'without a reason'
        return '' if result.successful else f'{self.node} refused it: {why}'


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
    value = parameters.values([name])[name]
    if value.type == ParameterType.PARAMETER_NOT_SET:
        print('Parameter not set.')  # noqa: T201
        return
    kind = _type_name(value.type).capitalize()
    label = kind.replace('array', 'values are') if 'array' in kind else f'{kind} value is'
    print(f'{label}: {parameter_value_to_python(value)}')  # noqa: T201


def _type_name(number: int) -> str:
    """Return the name of a type, as `ros2 param` has it."""
    name: str = Parameter.Type(number).name
    return name.lower().replace('_', ' ').replace('bool', 'boolean')


def print_descriptions(parameters: Parameters, names: Sequence[str]) -> None:
    """Print the lines of `ros2 param describe` for these parameters, or for all."""
    for descriptor in parameters.descriptors(names):
        lines = [f'Parameter name: {descriptor.name}', f'  Type: {_type_name(descriptor.type)}']
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
    (descriptor,) = parameters.descriptors([name])
    is_string = descriptor.type == ParameterType.PARAMETER_STRING
    try:
        value = yaml.load(text, yaml.BaseLoader if is_string else yaml.SafeLoader)  # noqa: S506
    except yaml.YAMLError:
        raise UserError(f'{text!r} is not a value in YAML: a string may need quotes') from None
    if value is None:
        value = text
    if descriptor.type == ParameterType.PARAMETER_DOUBLE and type(value) in (int, str):
        with suppress(ValueError):  # YAML takes 1e-7 for text
            value = float(value)
    if descriptor.read_only:
        setting = f'{parameters.node.rpartition("/")[2]}:{name}:={value}'
        why = f'it is read-only: set it at the start (--ros-args -p {setting})'
    else:
        why = parameters.set(name, value)
    if why:
        raise UserError(f'parameter {name} cannot be set: {why}')
    print('Set parameter successful')  # noqa: T201


def print_file(parameters: Parameters) -> None:
    """Print all parameters of a node as a file; a dot in a name opens a level."""
    nested: dict[str, Any] = {}
    for name, value in parameters.values().items():
        *groups, last = name.split('.')
        level = nested
        for group in groups:
            level = level.setdefault(group, {})
        if value.type != ParameterType.PARAMETER_NOT_SET:
            level[last] = parameter_value_to_python(value)
    content = {parameters.node: {'ros__parameters': nested}}
    text = yaml.safe_dump(content, default_flow_style=False, allow_unicode=True)
    print(text, end='')  # noqa: T201
