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
    """The log levels, remappings and parameters of `--ros-args`."""

    def __init__(self, words: list[str]) -> None:
        self.log_levels: dict[str, int] = {}
        self._remappings: list[_Rule] = []
        self.parameters: list[_Rule] = []
        rest = iter(words)
        for word in rest:
            if word == '--ros-args':
                for option in iter(lambda: next(rest, '--'), '--'):
                    if option != '--ros-args':
                        self._parse(option, next(rest, ''))

    def _parse(self, option: str, text: str) -> None:
        try:
            self._add(option, text)
        except (OSError, ValueError) as error:
            raise RuntimeError(f"Couldn't parse {option} {text!r}: {error}") from None

    def _add(self, option: str, text: str) -> None:
        target, _, value = text.rpartition(':=')
        node, _, name = target.rpartition(':')
        if option == '--log-level':
            if value.upper() not in LoggingSeverity.__members__:
                raise ValueError(f'expected one of {", ".join(LoggingSeverity.__members__)}')
            self.log_levels[target] = LoggingSeverity[value.upper()]
        elif option == '--params-file':
            self.parameters += _of_file(Path(text))
        elif option not in ('-p', '--param', '-r', '--remap'):
            raise ValueError('expected -p, -r, --params-file or --log-level')
        elif not target:
            raise ValueError('expected NAME:=VALUE')
        elif option in ('-p', '--param'):
            self.parameters.append(_Rule(node, name, _value(value)))
        else:
            self._remappings.append(_Rule(node, name, value))

    def remap(self, node: str, *names: str) -> str | None:
        """Return the new name in the node's first rule for one of `names`; None without a rule."""
        rules = (rule for rule in self._remappings if rule.node in ('', node))
        return next((rule.value for rule in rules if rule.name in names), None)

    def of(self, node: str) -> dict[str, Any]:
        """Return the parameters for the node with this full name; the last value counts."""
        return {
            rule.name: rule.value
            for rule in self.parameters
            if re.fullmatch(_pattern(rule.node or '**'), node)
        }


def _pattern(nodes: str) -> str:
    """Return the regular expression for full names: `*` is one word, `**` any number of words."""
    escaped = re.escape(f'/{nodes.lstrip("/")}')
    return escaped.replace(r'/\*\*', r'(/\w+)*').replace(r'/\*', r'/\w+')


# Imported late: a submission's process has no PyYAML, and no arguments.
def _value(text: str) -> Any:
    from barc_sim.cli.yaml_files import from_yaml

    return _allowed(from_yaml(text))


def _allowed(value: Any) -> Any:
    try:
        Type.from_parameter_value(value)
    except TypeError as error:
        raise ValueError(error) from None
    return value


def _of_file(file: Path) -> Iterator[_Rule]:
    """Yield the parameters in a file; ValueError, OSError: it cannot be read."""
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
    if not isinstance(tree, dict):
        raise ValueError('no names with values')  # noqa: TRY004 (an error of the file)
    for name, value in tree.items():
        path = f'{prefix}/{name}' if prefix else f'{name}'
        if isinstance(value, dict):
            yield from _flat(value, path)
        else:
            yield path, value


def _interface(name: str, kind: str = 'msg') -> Any:
    return message_type(f'rcl_interfaces/{kind}/{name}')


class ParameterException(Exception):
    """A parameter cannot be declared, read, or set to its first value."""


class ParameterNotDeclaredException(ParameterException): ...


class ParameterAlreadyDeclaredException(ParameterException): ...


class InvalidParameterTypeException(ParameterException): ...


class InvalidParameterValueException(ParameterException): ...


class Type(Enum):
    """The types of parameters, with the numbers of rcl_interfaces/msg/ParameterType."""

    NOT_SET, BOOL, INTEGER, DOUBLE, STRING = range(5)
    BYTE_ARRAY, BOOL_ARRAY, INTEGER_ARRAY, DOUBLE_ARRAY, STRING_ARRAY = range(5, 10)

    @classmethod
    def from_parameter_value(cls, value: Any) -> Type:
        if value is None:
            return cls.NOT_SET
        is_many = isinstance(value, (list, tuple, array.array))
        for name, kind in _KINDS.items():
            if all(isinstance(each, kind) for each in (value if is_many else [value])):
                return cls[f'{name}_ARRAY' if is_many else name]
        raise TypeError(f"The given value is not one of the allowed types '{value}'.")


#: What a value, or each item of one, must be; a bool is an int, too.
_KINDS = {'BOOL': bool, 'INTEGER': int, 'DOUBLE': float, 'STRING': str}


class Parameter:
    Type: ClassVar[Any] = Type

    def __init__(self, name: str, type_: Any = None, value: Any = None) -> None:
        self.name = name
        self.value = value
        self.type_ = type_ or Type.from_parameter_value(value)

    @classmethod
    def from_parameter_msg(cls, param_msg: Any) -> Parameter:
        return cls(param_msg.name, value=parameter_value_to_python(param_msg.value))

    def get_parameter_value(self) -> Any:
        message = _interface('ParameterValue')(type=self.type_.value)
        if self.value is not None:
            setattr(message, f'{self.type_.name.lower()}_value', self.value)
        return message

    def to_parameter_msg(self) -> Any:
        return _interface('Parameter')(name=self.name, value=self.get_parameter_value())


def parameter_value_to_python(parameter_value: Any) -> Any:
    value = getattr(parameter_value, f'{Type(parameter_value.type).name.lower()}_value', None)
    return list(value) if isinstance(value, (list, array.array)) else value


def _result(reason: str = '') -> Any:
    return _interface('SetParametersResult')(successful=not reason, reason=reason)


class NodeParameters:
    """The parameters of a node: a base class of `Node`."""

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
        if result.reason.startswith('Wrong parameter type'):
            what = f"Trying to set parameter '{name}' to '{value}' of type "
            kinds = f"'{parameter.type_.name}', expecting type '{Type(descriptor.type).name}'"
            raise InvalidParameterTypeException(f'{what}{kinds}: {name}')
        if not result.successful:
            why = f'Invalid parameter value ({value}) for parameter. Reason: {result.reason}'
            raise InvalidParameterValueException(f'{why}: {name}')
        return parameter

    def declare_parameters(self, namespace: str, parameters: Iterable[Any]) -> list[Parameter]:
        prefix = namespace and f'{namespace}.'
        return [self.declare_parameter(prefix + name, *rest) for name, *rest in parameters]

    def has_parameter(self, name: str) -> bool:
        return name in self._parameters

    def get_parameter(self, name: str) -> Parameter:
        if name not in self._parameters:
            what = 'Invalid access to undeclared parameter(s)'
            raise ParameterNotDeclaredException(f'{what}: {name}')
        return self._parameters[name]

    def get_parameters(self, names: list[str]) -> list[Parameter]:
        return [self.get_parameter(name) for name in names]

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        if prefixes or depth:
            raise ValueError(f'a list of some parameters {LACKS}')
        return _interface('ListParametersResult')(names=[*self._parameters])

    def set_parameters(self, parameter_list: list[Parameter]) -> list[Any]:
        self.get_parameters([each.name for each in parameter_list])
        return [self._set(each) for each in parameter_list]

    def _set(self, parameter: Parameter, declared: Any = None) -> Any:
        """Check and set a parameter; `declared` is its descriptor if it is declared now."""
        name = parameter.name
        descriptor = declared or self._descriptors[name]
        if descriptor.read_only and not declared:
            return _result(f'Trying to set a read-only parameter: {name}.')
        if reason := _fault(parameter, descriptor):
            return _result(reason)
        for callback in self._on_set:
            result = callback([parameter])
            if not result.successful:
                return result
        self._parameters[name] = parameter
        self._descriptors[name] = descriptor

        event = _interface('ParameterEvent')(node=self.get_fully_qualified_name())
        event.stamp = self.get_clock().now().to_msg()
        kind = event.new_parameters if declared else event.changed_parameters
        kind.append(parameter.to_parameter_msg())
        self._events.publish(event)
        for after in self._after:
            after([parameter])
        return _result()

    def add_on_set_parameters_callback(self, callback: Any) -> None:
        self._on_set.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: Any) -> None:
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
    is_whole = kind is Type.INTEGER
    ranges = descriptor.integer_range if is_whole else descriptor.floating_point_range
    mark = '.' if is_whole else ''  # as rclpy's sentences have it
    for allowed in ranges:
        low = allowed.from_value
        high = allowed.to_value
        if not low <= value <= high:
            return f'Parameter {name} out of range{mark} Min: {low}, Max: {high}, value: {value}'
    return ''
