"""The parameters of a running node: looked at and set, with errors that say what to do."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter, get_parameter_value, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rcl_interfaces.msg import ParameterDescriptor, ParameterValue

    from barc_sim.tools.looking import Look

#: As `ros2 param describe` has them.
_TYPES = {
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


class Verdict(NamedTuple):
    """What became of a parameter that was to be set."""

    name: str
    done: bool
    why: str  #: in a sentence, where it was not done; or a remark


class Parameters:
    """Those of a node.

    Attributes
    ----------
    node
        The node's full name.
    """

    def __init__(self, look: Look, node: str) -> None:
        """Find the node's services.

        Raises
        ------
        UserError
            where there is no such node, or it has none of them.
        """
        self.node = look.peer(node)
        self._look = look
        self._client = AsyncParameterClient(look.node, self.node)
        if not look.until(self._client.services_are_ready):
            raise UserError(f'{self.node} has no parameter services: it keeps its own')

    def names(self) -> list[str]:
        """Return the names of all, in order."""
        response = self._look.answer(self._client.list_parameters, self.node)
        return sorted(response.result.names)

    def values(self, names: Sequence[str]) -> list[ParameterValue]:
        """Return the values of these.

        Raises
        ------
        UserError
            where one of them isn't declared.
        """
        self._check(names)
        if not names:
            return []
        response = self._look.answer(lambda: self._client.get_parameters(names), self.node)
        return list(response.values)

    def descriptors(self, names: Sequence[str]) -> list[ParameterDescriptor]:
        """Return what is to be known of these; of all without names.

        Raises
        ------
        UserError
            where one of them isn't declared.
        """
        names = names or self.names()
        self._check(names)
        response = self._look.answer(lambda: self._client.describe_parameters(names), self.node)
        return list(response.descriptors)

    def set(self, wanted: dict[str, ParameterValue]) -> list[Verdict]:
        """Set parameters, each for itself, and return what became of them."""
        declared = self.names()
        known = [name for name in wanted if name in declared]
        descriptors = dict(zip(known, self.descriptors(known) if known else [], strict=True))
        current = dict(zip(known, self.values(known), strict=True))
        verdicts = {name: Verdict(name, False, self._unknown(name, declared)) for name in wanted}
        sent = {}
        for name in known:
            descriptor, value = descriptors[name], wanted[name]
            if descriptor.read_only and current[name] == value:
                verdicts[name] = Verdict(name, True, 'read-only, and as it was')
            elif why := self._refusal(descriptor, value):
                verdicts[name] = Verdict(name, False, why)
            else:
                sent[name] = Parameter(name, value=parameter_value_to_python(value))
        if sent:
            parameters = list(sent.values())
            response = self._look.answer(lambda: self._client.set_parameters(parameters), self.node)
            for name, result in zip(sent, response.results, strict=True):
                why = result.reason
                if not result.successful:
                    why = f'{self.node} refused the value of {name}: {why or "it gives no reason"}'
                verdicts[name] = Verdict(name, result.successful, why)
        return list(verdicts.values())

    def _refusal(self, descriptor: ParameterDescriptor, value: ParameterValue) -> str:
        """Return why the node will not take `value`, as far as it can be told before."""
        owner = f'parameter {descriptor.name} of {self.node}'
        given = parameter_value_to_python(value)
        if value.type != descriptor.type and not descriptor.dynamic_typing:
            return (
                f'{owner} is of type {_TYPES[descriptor.type]}, and {in_yaml(given)} is of type '
                f'{_TYPES[value.type]}{_instead(descriptor.type, given)}'
            )
        if descriptor.read_only:
            setting = f'{self.node.rpartition("/")[2]}:{descriptor.name}:={in_yaml(given)}'
            return f'{owner} is read-only: give it at the start (--ros-args -p {setting})'
        return ''

    def _check(self, names: Sequence[str]) -> None:
        declared = self.names()
        for name in names:
            if name not in declared:
                raise UserError(self._unknown(name, declared))

    def _unknown(self, name: str, declared: list[str]) -> str:
        close = get_close_matches(name, declared)
        hint = f'did you mean {" or ".join(close)}?' if close else f'it has {", ".join(declared)}'
        return f'{self.node} has no parameter {name}: {hint}'


def described(descriptor: ParameterDescriptor) -> list[str]:
    """Return the lines of `ros2 param describe`."""
    lines = [f'Parameter name: {descriptor.name}', f'  Type: {_TYPES[descriptor.type]}']
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
    label = _TYPES[value.type].replace('array', 'values are').capitalize()
    if 'values' not in label:
        label += ' value is'
    return f'{label}: {parameter_value_to_python(value)}'


def type_name(descriptor: ParameterDescriptor) -> str:
    """Return the name of the parameter's type."""
    return _TYPES[descriptor.type]


def parsed(text: str) -> ParameterValue:
    """Return the value that `text` is in YAML, as `ros2 param set` takes it.

    Raises
    ------
    UserError
        where it is not YAML.
    """
    try:
        return get_parameter_value(text)
    except yaml.YAMLError:
        raise UserError(f'{text!r} is not a value in YAML: a string may need quotes') from None


def as_value(given: Any, name: str) -> ParameterValue:  # noqa: ANN401 (whatever YAML has)
    """Return the value of a parameter for what stands in a file.

    Raises
    ------
    UserError
        where no type of parameter fits.
    """
    try:
        return Parameter(name, value=given).get_parameter_value()
    except (TypeError, AssertionError, OverflowError):
        raise UserError(
            f'parameter {name} cannot be {given!r}: a boolean, a number, a string, or a list of '
            'one of these is needed'
        ) from None


def in_yaml(value: Any) -> str:  # noqa: ANN401
    """Return a value as it is to be written, such as 1.0e-07."""
    return yaml.safe_dump(value, default_flow_style=True, width=2**30).partition('\n')[0]


def _instead(wanted: int, given: Any) -> str:  # noqa: ANN401
    """Return what to write for `given` where a parameter of another type is wanted."""
    if wanted == ParameterType.PARAMETER_STRING:
        return f': write "\'{given}\'"'
    if wanted == ParameterType.PARAMETER_DOUBLE and not isinstance(given, (bool, list)):
        try:
            return f': write {in_yaml(float(given))}'
        except ValueError:
            return ''
    return ''
