"""The parameters of a running node; as text; in files that rcl and `ros2 param` read."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter, get_parameter_value, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from barc_sim.cli.files import read_regular
from barc_sim.cli.parser import did_you_mean
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from rcl_interfaces.msg import ParameterDescriptor, ParameterValue

    from barc_sim.ros.introspection.observer import GraphObserver


class Verdict(NamedTuple):
    """Whether a parameter was set."""

    name: str
    done: bool
    reason: str  #: why it was not set; or a remark


class Parameters:
    """The parameters of a node.

    Attributes
    ----------
    node
        The node's full name.
    """

    def __init__(self, observer: GraphObserver, node: str) -> None:
        """Find the node's services.

        Raises
        ------
        UserError
            where the node does not exist, or has no parameter services.
        """
        self.node = observer.find_node(node)
        self._observer = observer
        self._client = AsyncParameterClient(observer.node, self.node)
        if not observer.wait_for(self._client.services_are_ready):
            raise UserError(f'{self.node} has no parameter services')

    def names(self) -> list[str]:
        """Return the names of all parameters, in order."""
        response = self._observer.request(self._client.list_parameters, self.node)
        return sorted(response.result.names)

    def values(self, names: Sequence[str]) -> list[ParameterValue]:
        """Return the values of the named parameters.

        Raises
        ------
        UserError
            where one of them is not declared.
        """
        self._check(names)
        if not names:
            return []
        response = self._observer.request(lambda: self._client.get_parameters(names), self.node)
        return list(response.values)

    def descriptors(self, names: Sequence[str]) -> list[ParameterDescriptor]:
        """Return the descriptors of the named parameters; of all without names.

        Raises
        ------
        UserError
            where one of them is not declared.
        """
        names = names or self.names()
        self._check(names)
        response = self._observer.request(
            lambda: self._client.describe_parameters(names), self.node
        )
        return list(response.descriptors)

    def set(self, wanted: dict[str, ParameterValue]) -> list[Verdict]:
        """Set parameters, each on its own, and return the verdicts."""
        declared = self.names()
        known = [name for name in wanted if name in declared]
        descriptors = dict(zip(known, self.descriptors(known) if known else [], strict=True))
        current = dict(zip(known, self.values(known), strict=True))
        verdicts = {name: Verdict(name, False, self._unknown(name, declared)) for name in wanted}
        sent = {}
        for name in known:
            descriptor, value = descriptors[name], wanted[name]
            if descriptor.read_only and current[name] == value:
                verdicts[name] = Verdict(name, True, 'read-only, and unchanged')
            elif reason := self._refusal(descriptor, value):
                verdicts[name] = Verdict(name, False, reason)
            else:
                sent[name] = Parameter(name, value=parameter_value_to_python(value))
        if sent:
            parameters = list(sent.values())
            response = self._observer.request(
                lambda: self._client.set_parameters(parameters), self.node
            )
            for name, result in zip(sent, response.results, strict=True):
                reason = result.reason
                if not result.successful:
                    reason = (
                        f'{self.node} refused the value of {name}: {reason or "without a reason"}'
                    )
                verdicts[name] = Verdict(name, result.successful, reason)
        return list(verdicts.values())

    def _refusal(self, descriptor: ParameterDescriptor, value: ParameterValue) -> str:
        """Return why the node would refuse `value`, as far as its descriptor shows; or ''."""
        owner = f'parameter {descriptor.name} of {self.node}'
        given = parameter_value_to_python(value)
        if value.type != descriptor.type and not descriptor.dynamic_typing:
            return (
                f'{owner} is of type {TYPES[descriptor.type]}, and {in_yaml(given)} is of type '
                f'{TYPES[value.type]}{suggestion(descriptor.type, given)}'
            )
        if descriptor.read_only:
            setting = f'{self.node.rpartition("/")[2]}:{descriptor.name}:={in_yaml(given)}'
            return f'{owner} is read-only: set it at the start (--ros-args -p {setting})'
        return ''

    def _check(self, names: Sequence[str]) -> None:
        declared = self.names()
        for name in names:
            if name not in declared:
                raise UserError(self._unknown(name, declared))

    def _unknown(self, name: str, declared: list[str]) -> str:
        hint = did_you_mean(name, declared) or f': it has {", ".join(declared)}'
        return f'{self.node} has no parameter {name}{hint}'


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


def description(descriptor: ParameterDescriptor) -> list[str]:
    """Return the lines of `ros2 param describe`."""
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
    return lines


def labelled(value: ParameterValue) -> str:
    """Return the line of `ros2 param get`."""
    if value.type == ParameterType.PARAMETER_NOT_SET:
        return 'Parameter not set.'
    label = TYPES[value.type].replace('array', 'values are').capitalize()
    if 'values' not in label:
        label += ' value is'
    return f'{label}: {parameter_value_to_python(value)}'


def parse_value(text: str) -> ParameterValue:
    """Return the value of `text` in YAML, as `ros2 param set` reads it.

    Raises
    ------
    UserError
        where it is not YAML.
    """
    try:
        return get_parameter_value(text)
    except yaml.YAMLError:
        raise UserError(f'{text!r} is not a value in YAML: a string may need quotes') from None


def to_parameter_value(given: Any, name: str) -> ParameterValue:  # noqa: ANN401 (anything in YAML)
    """Return a value read from a file as that of a parameter.

    Raises
    ------
    UserError
        where no parameter type fits.
    """
    try:
        return Parameter(name, value=given).get_parameter_value()
    except (TypeError, AssertionError, OverflowError):
        raise UserError(
            f'parameter {name} cannot be {given!r}: expected a boolean, a number, a string, or a '
            'list of one of these'
        ) from None


def in_yaml(value: Any) -> str:  # noqa: ANN401
    """Return a value as YAML writes it, such as 1.0e-07."""
    return yaml.safe_dump(value, default_flow_style=True, width=2**30).partition('\n')[0]


def suggestion(wanted: int, given: Any) -> str:  # noqa: ANN401
    """Return how to write `given` for a parameter of the type `wanted`, or ''."""
    if wanted == ParameterType.PARAMETER_STRING:
        return f': write "\'{given}\'"'
    if wanted == ParameterType.PARAMETER_DOUBLE and not isinstance(given, (bool, list)):
        try:
            return f': write {in_yaml(float(given))}'
        except ValueError:
            return ''
    return ''


_KEY = 'ros__parameters'
_EXPECTED = f'expected nodes with {_KEY}, as `barc param dump` writes them'


def file_text(node: str, values: Mapping[str, Any]) -> str:
    """Return the text of a node's file; a dot in a name opens a level."""
    nested: dict[str, Any] = {}
    for name, value in sorted(values.items()):
        *groups, last = name.split('.')
        level = nested
        for group in groups:
            level = level.setdefault(group, {})
        level[last] = value
    return yaml.safe_dump({node: {_KEY: nested}}, default_flow_style=False, allow_unicode=True)


def read_file(path: Path, node: str, *, wildcards: bool = True) -> dict[str, Any]:
    """Return the parameters in the file for the node of this full name.

    They have their YAML types, as in rcl; `rclpy.parameter_client` reads 1.0e-7 as a string and
    '7' as a number. Later entries override earlier ones, as in rcl.

    Parameters
    ----------
    path
        The file.
    node
        Such as `/car2/controller`.
    wildcards
        Whether entries with wildcards, such as `/**`, count, too.

    Raises
    ------
    UserError
        where the file cannot be read, or has no parameters for the node.
    """
    try:
        content = yaml.safe_load(read_regular(path, 1 << 24).decode())
    except OSError as error:
        raise UserError(f'{str(path)!r} cannot be read: {error.strerror}') from None
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise UserError(f'{str(path)!r} is not YAML in line {line}: {error.problem}') from None
    except (UnicodeDecodeError, yaml.YAMLError):
        raise UserError(f'{str(path)!r} is not a text of YAML: {_EXPECTED}') from None
    if not isinstance(content, dict):
        raise UserError(f'{str(path)!r} is not a file of parameters: {_EXPECTED}')
    entries = list(_entries(content, ''))
    if not entries:
        raise UserError(f'{str(path)!r} has no parameters: {_EXPECTED}')
    values: dict[str, Any] = {}
    found = False
    for key, level in entries:
        if ('*' not in key or wildcards) and _matches(key, node):
            values |= dict(_flat(level, path))
            found = True
    if not found:
        known = ', '.join(key for key, _ in entries)
        raise UserError(f'{str(path)!r} has no parameters for {node}: it has some for {known}')
    return values


def _entries(level: Mapping[Any, Any], node: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield each node in a file with its parameters."""
    for key, value in level.items():
        if isinstance(value, dict):
            if key == _KEY:
                yield node, value
            else:
                yield from _entries(value, f'{node}/{str(key).strip("/")}')


def _matches(key: str, node: str) -> bool:
    """Return whether `key` matches the node: `*` stands for one part of a name, `**` for any."""
    parts = re.split(r'(/\*\*|\*)', key)
    pattern = {'/**': '(/[^/]+)*', '*': '[^/]+'}
    return bool(re.fullmatch(''.join(pattern.get(part, re.escape(part)) for part in parts), node))


def _flat(level: Mapping[Any, Any], path: Path, prefix: str = '') -> Iterator[tuple[str, Any]]:
    for key, value in level.items():
        name = f'{prefix}{key}'
        if isinstance(value, dict):
            yield from _flat(value, path, f'{name}.')
        elif value is None:
            raise UserError(f'parameter {name} in {str(path)!r} has no value: give it one')
        else:
            yield name, value
