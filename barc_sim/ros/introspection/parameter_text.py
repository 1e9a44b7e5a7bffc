"""Parameters as text: as `ros2 param` prints them, and as YAML."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import yaml
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter, get_parameter_value, parameter_value_to_python

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from rcl_interfaces.msg import ParameterDescriptor, ParameterValue

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
    """Return the lines of `ros2 param describe`.

    Examples
    --------
    >>> from rcl_interfaces.msg import IntegerRange, ParameterDescriptor
    >>> span = [IntegerRange(from_value=0, to_value=65535)]
    >>> for line in description(ParameterDescriptor(name='port', type=2, integer_range=span)):
    ...     print(line)
    Parameter name: port
      Type: integer
      Constraints:
        Min value: 0
        Max value: 65535
    """
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
    """Return the line of `ros2 param get`.

    Examples
    --------
    >>> labelled(parse_value('8.0')), labelled(parse_value('[1, 2]'))
    ('Double value is: 8.0', 'Integer values are: [1, 2]')
    """
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

    Examples
    --------
    >>> parse_value('8.0').double_value, parse_value('lab').string_value
    (8.0, 'lab')
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

    Examples
    --------
    >>> list(to_parameter_value([40.0, 10.0], 'gains').double_array_value)
    [40.0, 10.0]
    """
    try:
        return Parameter(name, value=given).get_parameter_value()
    except (TypeError, AssertionError, OverflowError):
        raise UserError(
            f'parameter {name} cannot be {given!r}: expected a boolean, a number, a string, or a '
            'list of one of these'
        ) from None


def in_yaml(value: Any) -> str:  # noqa: ANN401
    """Return a value as YAML writes it, such as 1.0e-07.

    Examples
    --------
    >>> in_yaml(1e-7), in_yaml([True, 'lab'])
    ('1.0e-07', '[true, lab]')
    """
    return yaml.safe_dump(value, default_flow_style=True, width=2**30).partition('\n')[0]


def suggestion(wanted: int, given: Any) -> str:  # noqa: ANN401
    """Return how to write `given` for a parameter of the type `wanted`, or ''.

    Examples
    --------
    >>> suggestion(ParameterType.PARAMETER_DOUBLE, 8)
    ': write 8.0'
    """
    if wanted == ParameterType.PARAMETER_STRING:
        return f': write "\'{given}\'"'
    if wanted == ParameterType.PARAMETER_DOUBLE and not isinstance(given, (bool, list)):
        try:
            return f': write {in_yaml(float(given))}'
        except ValueError:
            return ''
    return ''
