"""Parameters of nodes: read after --ros-args, declared, checked, set, and served to other nodes."""

from __future__ import annotations

import array
import re
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from barc_sim.ros.local.logger import LoggingSeverity
from barc_sim.ros.local.messages import LACKS, message_type

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

_OPEN_FILES = Path('/dev/fd')  #: of this process


class _Rule(NamedTuple):
    """A remapping or a parameter, for the nodes that `node` matches; '': for all nodes."""

    node: str
    name: str
    value: Any


class Arguments:
    """The log levels, remappings and parameters of `--ros-args`.

    Parameters
    ----------
    words
        The words of the command line; those between `--ros-args` and `--` count.

    Attributes
    ----------
    log_levels
        By the name of the logger; that of the empty name is for all others.
    parameters
        The rules of the parameters, in the order of the command line.

    Raises
    ------
    RuntimeError
        A word cannot be parsed.
    """

    def __init__(self, words: list[str]) -> None:
        self.log_levels: dict[str, int] = {}
        self._remappings: list[_Rule] = []
        self.parameters: list[_Rule] = []

        is_for_ros = False
        rest = iter(words)
        for word in rest:
            if word == '--ros-args':
                is_for_ros = True
            elif word == '--':
                is_for_ros = False
            elif is_for_ros:
                self._parse(word, next(rest, ''))

    def _parse(self, option: str, text: str) -> None:
        try:
            self._add(option, text)
        except (OSError, ValueError) as error:
            raise RuntimeError(f"Couldn't parse {option} {text!r}: {error}") from None

    def _add(self, option: str, text: str) -> None:
        """Add an option with its text; ValueError, OSError: it is not as expected."""
        if option == '--log-level':
            self._add_log_level(text)
        elif option == '--params-file':
            self.parameters += _of_file(Path(text))
        elif option in ('-p', '--param'):
            rule = _rule(text)
            self.parameters.append(rule._replace(value=_value(rule.value)))
        elif option in ('-r', '--remap'):
            self._remappings.append(_rule(text))
        else:
            raise ValueError('expected -p, -r, --params-file or --log-level')

    def _add_log_level(self, text: str) -> None:
        logger, _, level = text.rpartition(':=')
        if level.upper() not in LoggingSeverity.__members__:
            raise ValueError(f'expected one of {", ".join(LoggingSeverity.__members__)}')
        self.log_levels[logger] = LoggingSeverity[level.upper()]

    def remap(self, node: str, *names: str) -> str | None:
        """Return the new name in the first rule of a node for one of its names.

        Parameters
        ----------
        node
            The name of the node.
        *names
            The name that is remapped, as the rule can have it: relative, or in full.

        Returns
        -------
        str or None
            The new name; None without a rule.
        """
        for rule in self._remappings:
            if rule.node in ('', node) and rule.name in names:
                return str(rule.value)
        return None

    def of(self, node: str) -> dict[str, Any]:
        """Return the parameters for the node with this full name; the last value counts."""
        return {
            rule.name: rule.value
            for rule in self.parameters
            if re.fullmatch(_pattern(rule.node or '**'), node)
        }


def _rule(text: str) -> _Rule:
    """Return the rule of a text such as `node:name:=value`; ValueError: it is none."""
    target, _, value = text.rpartition(':=')
    node, _, name = target.rpartition(':')
    if not target:
        raise ValueError('expected NAME:=VALUE')
    return _Rule(node, name, value)


def _pattern(nodes: str) -> str:
    """Return the regular expression for full names: `*` is one word, `**` any number of words."""
    escaped = re.escape(f'/{nodes.lstrip("/")}')
    return escaped.replace(r'/\*\*', r'(/\w+)*').replace(r'/\*', r'/\w+')


def _value(text: str) -> Any:
    """Return the value in a text of YAML; ValueError: no parameter can have it."""
    # Imported late: a submission's process has no PyYAML, and no arguments.
    from barc_sim.cli.yaml_files import from_yaml

    return _allowed(from_yaml(text))


def _allowed(value: Any) -> Any:
    """Return the value; ValueError: no parameter can have it."""
    try:
        Type.from_parameter_value(value)
    except TypeError as error:
        raise ValueError(error) from None
    return value


def _of_file(file: Path) -> Iterator[_Rule]:
    """Yield the parameters in a file; ValueError, OSError: it cannot be read."""
    # Imported late, as in `_value`.
    from barc_sim.cli.yaml_files import MAX_YAML, from_yaml, read_yaml

    if file.parent == _OPEN_FILES:  # for example a pipe of the shell, `<(…)`
        with file.open(encoding='utf-8') as text:
            values = from_yaml(text.read(MAX_YAML + 1))
    else:
        values = read_yaml(file)

    for path, value in _flat(values or {}, ''):
        node, below, name = path.partition('/ros__parameters/')
        if not below:
            raise ValueError(f'{path!r} is not below ros__parameters')
        yield _Rule(node, name.replace('/', '.'), _allowed(value))


def _flat(tree: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield the values of a tree with their paths, such as `node/ros__parameters/name`."""
    if not isinstance(tree, dict):
        raise ValueError('no names with values')  # noqa: TRY004 (an error of the file)
    for name, value in tree.items():
        path = f'{prefix}/{name}' if prefix else f'{name}'
        if isinstance(value, dict):
            yield from _flat(value, path)
        else:
            yield path, value


def _interface(name: str, kind: str = 'msg') -> Any:
    """Return a class of the package rcl_interfaces."""
    return message_type(f'rcl_interfaces/{kind}/{name}')


class ParameterException(Exception):
    """A parameter cannot be declared, read, or set to its first value."""


class ParameterNotDeclaredException(ParameterException):
    """A node has no parameter of this name."""


class ParameterAlreadyDeclaredException(ParameterException):
    """A parameter is declared again."""


class InvalidParameterTypeException(ParameterException):
    """A parameter has another type than its default."""


class InvalidParameterValueException(ParameterException):
    """A parameter is out of its range, or a callback refused it."""


class Type(Enum):
    """The types of parameters, with the numbers of rcl_interfaces/msg/ParameterType."""

    NOT_SET, BOOL, INTEGER, DOUBLE, STRING = range(5)
    BYTE_ARRAY, BOOL_ARRAY, INTEGER_ARRAY, DOUBLE_ARRAY, STRING_ARRAY = range(5, 10)

    @classmethod
    def from_parameter_value(cls, value: Any) -> Type:
        """Return the type of a value; TypeError: no parameter can have it."""
        if value is None:
            return cls.NOT_SET

        is_many = isinstance(value, (list, tuple, array.array))
        elements = value if is_many else [value]
        for name, kind in _KINDS.items():
            if all(isinstance(each, kind) for each in elements):
                return cls[f'{name}_ARRAY' if is_many else name]
        raise TypeError(f"The given value is not one of the allowed types '{value}'.")


#: What a value, or each element of an array, must be; BOOL is first, as a bool is an int, too.
_KINDS = {'BOOL': bool, 'INTEGER': int, 'DOUBLE': float, 'STRING': str}


class Parameter:
    """A parameter of a node.

    Parameters
    ----------
    name
        Its name.
    type_
        Its type; by default that of the value.
    value
        Its value.
    """

    Type: ClassVar[Any] = Type

    def __init__(self, name: str, type_: Any = None, value: Any = None) -> None:
        self.name = name
        self.value = value
        self.type_ = type_ or Type.from_parameter_value(value)

    @classmethod
    def from_parameter_msg(cls, param_msg: Any) -> Parameter:
        """Return the parameter in a message."""
        return cls(param_msg.name, value=parameter_value_to_python(param_msg.value))

    def get_parameter_value(self) -> Any:
        """Return the value as a message."""
        message = _interface('ParameterValue')(type=self.type_.value)
        if self.value is not None:
            setattr(message, f'{self.type_.name.lower()}_value', self.value)
        return message

    def to_parameter_msg(self) -> Any:
        """Return the parameter as a message."""
        return _interface('Parameter')(name=self.name, value=self.get_parameter_value())


def parameter_value_to_python(parameter_value: Any) -> Any:
    """Return the value in a message: a number, a text, a list, or None."""
    field = f'{Type(parameter_value.type).name.lower()}_value'
    value = getattr(parameter_value, field, None)
    if isinstance(value, (list, array.array)):
        return list(value)
    return value


def _result(reason: str = '') -> Any:
    """Return the result of setting a parameter; with a reason, it was not set."""
    return _interface('SetParametersResult')(successful=not reason, reason=reason)


class NodeParameters:
    """The parameters of a node: a base class of `Node`.

    Parameters
    ----------
    events
        The publisher of `/parameter_events`.
    overrides
        The values that replace defaults, by name.
    """

    get_fully_qualified_name: Any
    get_clock: Any
    create_service: Any

    def __init__(self, events: Any, overrides: dict[str, Any]) -> None:
        self._events = events
        self._overrides = overrides
        self._parameters: dict[str, Parameter] = {}
        self._descriptors: dict[str, Any] = {}
        self._on_set: list[Callable[[list[Parameter]], Any]] = []
        self._after: list[Callable[[list[Parameter]], object]] = []

    def declare_parameter(self, name: str, value: Any = None, descriptor: Any = None) -> Parameter:
        """Declare a parameter.

        Parameters
        ----------
        name
            Its name.
        value
            Its default, which has its type, too.
        descriptor
            A message with its description, its range, and whether it is read only.

        Returns
        -------
        Parameter
            The parameter with its first value.

        Raises
        ------
        ParameterAlreadyDeclaredException
            It is declared already.
        InvalidParameterTypeException
            The value that replaces the default has another type.
        InvalidParameterValueException
            The value is out of its range, or a callback refused it.
        """
        if name in self._parameters:
            raise ParameterAlreadyDeclaredException(f'Parameter(s) already declared: {[name]}')
        descriptor = descriptor or _interface('ParameterDescriptor')()
        if value is None or isinstance(value, Type) or descriptor.dynamic_typing:
            raise ValueError(f'parameter {name!r} without a value or of any type {LACKS}')
        descriptor.name = name
        descriptor.type = Type.from_parameter_value(value).value

        value = self._overrides.get(name, value)
        parameter = Parameter(name, value=value)
        result = self._set(parameter, descriptor)
        if result.successful:
            return parameter

        # The sentences are rclpy's.
        if result.reason.startswith('Wrong parameter type'):
            raise InvalidParameterTypeException(
                f"Trying to set parameter '{name}' to '{value}' of type "
                f"'{parameter.type_.name}', expecting type '{Type(descriptor.type).name}': {name}"
            )
        raise InvalidParameterValueException(
            f'Invalid parameter value ({value}) for parameter. Reason: {result.reason}: {name}'
        )

    def declare_parameters(self, namespace: str, parameters: Iterable[Any]) -> list[Parameter]:
        """Declare several parameters.

        Parameters
        ----------
        namespace
            What stands before their names, without the dot; empty: nothing.
        parameters
            The arguments of `declare_parameter` for each.

        Returns
        -------
        list of Parameter
            The parameters with their first values.
        """
        prefix = f'{namespace}.' if namespace else ''
        return [
            self.declare_parameter(prefix + name, *arguments) for name, *arguments in parameters
        ]

    def has_parameter(self, name: str) -> bool:
        """Return whether a parameter is declared."""
        return name in self._parameters

    def get_parameter(self, name: str) -> Parameter:
        """Return a parameter; ParameterNotDeclaredException: it is not declared."""
        if name not in self._parameters:
            raise ParameterNotDeclaredException(
                f'Invalid access to undeclared parameter(s): {name}'
            )
        return self._parameters[name]

    def get_parameters(self, names: list[str]) -> list[Parameter]:
        """Return several parameters, as `get_parameter` does."""
        return [self.get_parameter(name) for name in names]

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        """Return a message with the names of all parameters; ValueError: some are asked for."""
        if prefixes or depth:
            raise ValueError(f'a list of some parameters {LACKS}')
        return _interface('ListParametersResult')(names=[*self._parameters])

    def set_parameters(self, parameter_list: list[Parameter]) -> list[Any]:
        """Set parameters, one after the other.

        Parameters
        ----------
        parameter_list
            The parameters with their new values.

        Returns
        -------
        list
            A message for each: whether it was set, and why not.

        Raises
        ------
        ParameterNotDeclaredException
            One of them is not declared; then none is set.
        """
        self.get_parameters([each.name for each in parameter_list])
        return [self._set(each) for each in parameter_list]

    def _set(self, parameter: Parameter, declared: Any = None) -> Any:
        """Check and set a parameter; `declared` is its descriptor if it is declared now."""
        name = parameter.name
        descriptor = declared or self._descriptors[name]
        if descriptor.read_only and not declared:
            return _result(f'Trying to set a read-only parameter: {name}.')
        reason = _fault(parameter, descriptor)
        if reason:
            return _result(reason)
        for callback in self._on_set:
            result = callback([parameter])
            if not result.successful:
                return result

        self._parameters[name] = parameter
        self._descriptors[name] = descriptor
        self._publish_event(parameter, is_new=declared is not None)
        for after in self._after:
            after([parameter])
        return _result()

    def _publish_event(self, parameter: Parameter, *, is_new: bool) -> None:
        event = _interface('ParameterEvent')(node=self.get_fully_qualified_name())
        event.stamp = self.get_clock().now().to_msg()
        parameters = event.new_parameters if is_new else event.changed_parameters
        parameters.append(parameter.to_parameter_msg())
        self._events.publish(event)

    def add_on_set_parameters_callback(self, callback: Any) -> None:
        """Ask a callback from now on whether parameters can be set, before all others."""
        self._on_set.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: Any) -> None:
        """Call a callback from now on after parameters were set, before all others."""
        self._after.insert(0, callback)

    def serve(self) -> None:
        """Create the service `~/set_parameters`, as in rclpy."""
        kind = _interface('SetParameters', 'srv')
        self.create_service(kind, '~/set_parameters', self._on_set_request)

    def _on_set_request(self, request: Any, response: Any) -> Any:
        for requested in request.parameters:
            try:
                (result,) = self.set_parameters([Parameter.from_parameter_msg(requested)])
            except ParameterNotDeclaredException as error:
                result = _result(str(error))
            response.results.append(result)
        return response


def _fault(parameter: Parameter, descriptor: Any) -> str:
    """Return why a parameter cannot have its value, or ''."""
    name = parameter.name
    value = parameter.value
    kind = parameter.type_
    if kind.value != descriptor.type:
        return f"Wrong parameter type, expected '{Type(descriptor.type)}' got '{kind}'"

    ranges = descriptor.floating_point_range
    mark = ''  # as rclpy's sentences have it
    if kind is Type.INTEGER:
        ranges = descriptor.integer_range
        mark = '.'
    for allowed in ranges:
        low = allowed.from_value
        high = allowed.to_value
        if not low <= value <= high:
            return f'Parameter {name} out of range{mark} Min: {low}, Max: {high}, value: {value}'
    return ''
