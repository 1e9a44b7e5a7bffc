"""Declares a node's parameters from a table: name, default, range and description."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rclpy.node import Node

    from barc_sim.vehicle.parameters import Parameter


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Return the ROS descriptor of a parameter."""
    made = ParameterDescriptor(description=parameter.description, read_only=parameter.read_only)
    if parameter.between is None:
        return made
    low, high = parameter.between
    if isinstance(parameter.default, float):
        made.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    else:
        made.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    return made


def declare(node: Node, parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Declare `parameters` on `node` and return their values by name.

    Raises
    ------
    UserError
        An override has the wrong type or is out of range.
    """
    return {parameter.name: _declare(node, parameter) for parameter in parameters}


def _declare(node: Node, parameter: Parameter) -> Any:  # noqa: ANN401 (as rclpy has it)
    owner = f'parameter {parameter.name} of {node.get_name()}'
    try:
        return node.declare_parameter(
            parameter.name, parameter.default, descriptor(parameter)
        ).value
    except InvalidParameterTypeException as error:
        given = str(error).split(', expecting')[0]
        kind = type(parameter.default).__name__
        raise UserError(
            f'{owner} must be of type {kind}, such as {parameter.default!r}: {given}'
        ) from None
    except InvalidParameterValueException as error:
        span = ' and '.join(str(bound) for bound in parameter.between or ())
        given = str(error).split('. Reason')[0]
        raise UserError(f'{owner} must lie between {span}: {given}') from None
