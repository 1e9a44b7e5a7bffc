"""The parameters of a run's nodes without ROS: read from `--ros-args`, checked and published."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from barc_sim.cli.files import read_regular
from barc_sim.cli.process import needs_ros
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from barc_sim.vehicle.parameters import Parameter

#: The parameters of every node of rclpy.
EVERY_NODES = {'use_sim_time': False, 'start_type_description_service': True}
_ALL = '/**'
_UNUSABLE = (OSError, ValueError, LookupError, TypeError, AttributeError, yaml.YAMLError)


class RosArguments:
    """What a run without ROS takes of the arguments after `--ros-args`: parameters and log level.

    Attributes
    ----------
    log_level
        The name of the lowest level that is logged.

    Examples
    --------
    >>> arguments = RosArguments(['-p', 'speed:=8.0', '-p', 'relay:speed:=5.0'])
    >>> arguments.of('relay'), arguments.of('controller')
    ({'speed': 5.0}, {'speed': 8.0})
    """

    def __init__(self, words: Iterable[str]) -> None:
        """Read the arguments.

        Raises
        ------
        UserError
            An argument is not understood, or needs ROS.
        """
        self.log_level = 'info'
        self._values: list[tuple[str, str, Any]] = []  # node, name, value
        rest = iter(words)
        for word in rest:
            if word in ('--ros-args', '--'):
                continue
            if word not in ('-p', '--param', '--params-file', '--log-level'):
                raise needs_ros(f'the ROS argument {word!r}')
            value = next(rest, None)
            if value is None:
                raise UserError(f'the ROS argument {word!r} lacks its value')
            if word == '--log-level':
                self.log_level = value.rpartition(':=')[2].lower()
            elif word == '--params-file':
                self._read(Path(value))
            else:
                self._add(value)

    def _add(self, rule: str) -> None:
        target, assigned, text = rule.partition(':=')
        node, _, name = target.rpartition(':')
        if not (assigned and name):
            raise UserError(
                f'the ROS argument {rule!r} is no parameter: expected NAME:=VALUE or '
                'NODE:NAME:=VALUE'
            )
        self._values.append((node or _ALL, name, _value(text)))

    def _read(self, file: Path) -> None:
        try:
            nodes = yaml.safe_load(read_regular(file, 1 << 20).decode())
            for node, values in nodes.items():
                for name, value in values['ros__parameters'].items():
                    self._values.append((node.lstrip('/') if node != _ALL else _ALL, name, value))
        except _UNUSABLE as error:
            raise UserError(
                f'the file of parameters {str(file)!r} cannot be used ({error}): expected YAML as '
                'in NODE: {ros__parameters: {NAME: VALUE}}'
            ) from None

    def of(self, node: str) -> dict[str, Any]:
        """Return the values for a node, by name; the last one given for a name counts."""
        return {
            name: value for owner, name, value in self._values if owner in (_ALL, node, f'/{node}')
        }


def _value(text: str) -> Any:  # noqa: ANN401 (what YAML can hold)
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return yaml.safe_load(text)


def checked(node: str, table: Iterable[Parameter], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a node's parameters: those given, else the defaults.

    Raises
    ------
    UserError
        A value has the wrong type or is out of range.

    Examples
    --------
    >>> from barc_sim.vehicle.parameters import Parameter
    >>> mass = Parameter('mass', 2000.0, 'mass of the car [kg]', (1.0, 5000.0))
    >>> road = Parameter('road', 'lab', 'name or file of the road')
    >>> checked('car', [mass, road], {'mass': 2400.0})
    {'mass': 2400.0, 'road': 'lab'}
    """
    return {
        parameter.name: _checked(node, parameter, given.get(parameter.name, parameter.default))
        for parameter in table
    }


def _checked(node: str, parameter: Parameter, value: Any) -> Any:  # noqa: ANN401 (as given)
    owner = f'parameter {parameter.name} of {node}'
    kind = type(parameter.default)
    if type(value) is not kind:
        raise UserError(
            f'{owner} must be of type {kind.__name__}, such as {parameter.default!r}: {value!r} '
            f'is of type {type(value).__name__}'
        )
    if parameter.between is not None and isinstance(value, int | float):
        low, high = parameter.between
        if not low <= value <= high:
            raise UserError(f'{owner} must lie between {low} and {high}: {value!r} does not')
    return value
