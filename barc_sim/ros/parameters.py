"""Declares the parameters of a table on a node."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException

from barc_sim.cli.limits import not_between
from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import UNBOUNDED
from barc_sim.vehicle.parameters import TRACK
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rclpy.node import Node

    from barc_sim.interfaces.parameters import ParameterDeclaration


def descriptor(parameter: ParameterDeclaration) -> ParameterDescriptor:
    """Return the ROS descriptor of a parameter."""
    message = ParameterDescriptor(description=parameter.description, read_only=parameter.read_only)
    if parameter.between == UNBOUNDED:
        return message
    low, high = parameter.between
    if isinstance(parameter.default, float):
        message.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    else:
        message.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    return message


def declare(node: Node, parameters: Iterable[ParameterDeclaration]) -> dict[str, Any]:
    """Declare `parameters` on `node` and return their values by name."""
    return {parameter.name: _declare(node, parameter) for parameter in parameters}


def _declare(node: Node, parameter: ParameterDeclaration) -> Any:  # noqa: ANN401 (as rclpy has it)
    owner = f'parameter {parameter.name} of {node.get_name()}'
    low, high = parameter.between
    kind = type(parameter.default)
    try:
        return node.declare_parameter(
            parameter.name, parameter.default, descriptor(parameter)
        ).value
    except InvalidParameterTypeException as error:
        reason = str(error).split(', expecting')[0]
        value = re.search("to '(.*)' of type 'DOUBLE'", reason)
        if kind is int and value:
            raise UserError(f'{owner}: {not_between(float(value[1]), low, high)}') from None
        raise UserError(
            f'{owner} must be of type {kind.__name__}, such as {parameter.default!r}: {reason}'
        ) from None
    except InvalidParameterValueException as error:
        value = re.search(r'value \((.*)\) for parameter', str(error))
        problem = not_between(kind(value[1]), low, high) if value else error
        raise UserError(f'{owner}: {problem}') from None


def declare_track(node: Node, track: Track | None = None) -> Track | None:
    """Declare the parameter `track`; return `track`, or else the track that the parameter names."""
    default = TRACK._replace(default=track.name if track else '')
    name = declare(node, [default])[TRACK.name]
    if track is None and name:
        return Track.named(name)
    return track
