"""Parameters: declared with descriptors, set after checks, served to other nodes."""

from __future__ import annotations

import array
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar

from barc_sim.ros.local.messages import message_type

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


def _interface(name: str, kind: str = 'msg') -> Any:
    return message_type(f'rcl_interfaces/{kind}/{name}')


class ParameterException(Exception):
    what = ''

    def __init__(self, parameters: Any, what: str = '') -> None:
        super().__init__(f'{what or self.what}: {parameters}')


class ParameterNotDeclaredException(ParameterException):
    what = 'Invalid access to undeclared parameter(s)'


class ParameterAlreadyDeclaredException(ParameterException):
    what = 'Parameter(s) already declared'


class InvalidParameterTypeException(ParameterException):
    pass


class InvalidParameterValueException(ParameterException):
    pass


class Type(Enum):
    """The types of parameters; the value of each is ParameterType's."""

    NOT_SET, BOOL, INTEGER, DOUBLE, STRING = range(5)
    BYTE_ARRAY, BOOL_ARRAY, INTEGER_ARRAY, DOUBLE_ARRAY, STRING_ARRAY = range(5, 10)

    @property
    def field(self) -> str:
        """The field of ParameterValue that holds such a value."""
        return f'{self.name.lower()}_value'

    @classmethod
    def from_parameter_value(cls, value: Any) -> Type:
        if value is None:
            return cls.NOT_SET
        many = isinstance(value, (list, tuple, array.array))
        for kind, single in _KINDS.items():
            is_array = kind.name.endswith('ARRAY')
            if many and is_array and all(isinstance(each, single) for each in value):
                return kind
            if not many and not is_array and isinstance(value, single):
                return kind
        raise TypeError(f"The given value is not one of the allowed types '{value}'.")


#: What a value, or each item of one, must be; a bool is an int, too.
_SINGLES = {'BYTE': bytes, 'BOOL': bool, 'INTEGER': int, 'DOUBLE': float, 'STRING': str}
_KINDS = {
    **{Type[name]: single for name, single in _SINGLES.items() if name != 'BYTE'},
    **{Type[f'{name}_ARRAY']: single for name, single in _SINGLES.items()},
}


class Parameter:
    Type: ClassVar[Any] = Type

    def __init__(self, name: str, type_: Any = None, value: Any = None) -> None:
        found = Type.from_parameter_value(value)
        if (
            type_ is not None
            and type_ is not found
            and not (found.name == 'BYTE_ARRAY' and not value)
        ):
            raise ValueError(f"Type '{type_}' and value '{value}' do not agree")
        self.name, self.type_, self.value = name, type_ or found, value

    @classmethod
    def from_parameter_msg(cls, param_msg: Any) -> Parameter:
        kind = Type(param_msg.value.type)
        value = None if kind is Type.NOT_SET else getattr(param_msg.value, kind.field)
        return cls(param_msg.name, kind, value)

    def get_parameter_value(self) -> Any:
        made = _interface('ParameterValue')(type=self.type_.value)
        if self.type_ is not Type.NOT_SET:
            setattr(made, self.type_.field, self.value)
        return made

    def to_parameter_msg(self) -> Any:
        return _interface('Parameter')(name=self.name, value=self.get_parameter_value())


def parameter_value_to_python(parameter_value: Any) -> Any:
    value = Parameter.from_parameter_msg(_interface('Parameter')(value=parameter_value)).value
    return list(value) if isinstance(value, array.array) else value


def _result(reason: str = '') -> Any:
    return _interface('SetParametersResult')(successful=not reason, reason=reason)


class Parameters:
    """The parameters of a node."""

    def __init__(self, node: Any, events: Any, overrides: dict[str, Parameter]) -> None:
        self._node, self._events, self._overrides = node, events, overrides
        self._parameters: dict[str, Parameter] = {}
        self._descriptors: dict[str, Any] = {}
        self._on_set: list[Callable[[list[Parameter]], Any]] = []
        self._after: list[Callable[[list[Parameter]], object]] = []

    def declare_parameter(
        self, name: str, value: Any = None, descriptor: Any = None, ignore_override: bool = False
    ) -> Parameter:
        if name in self._parameters:
            raise ParameterAlreadyDeclaredException([name])
        descriptor = descriptor or _interface('ParameterDescriptor')()
        if isinstance(value, Type):
            descriptor.type, value = value.value, None
        elif not descriptor.dynamic_typing:
            descriptor.type = Type.from_parameter_value(value).value
            if not descriptor.type:
                raise ValueError(f'the parameter {name!r} is declared without a value: give one')
        if not ignore_override and name in self._overrides:
            value = self._overrides[name].value
        parameter = Parameter(name, value=value)
        result = self._set([parameter], {name: descriptor})
        if result.reason.startswith('Wrong parameter type'):
            given = f"Trying to set parameter '{name}' to '{value}' of type "
            kinds = f"'{parameter.type_.name}', expecting type '{Type(descriptor.type).name}'"
            raise InvalidParameterTypeException(name, given + kinds)
        if not result.successful:
            why = f'Invalid parameter value ({value}) for parameter. Reason: {result.reason}'
            raise InvalidParameterValueException(name, why)
        return parameter

    def declare_parameters(self, namespace: str, parameters: Iterable[Any]) -> list[Parameter]:
        prefix = namespace and f'{namespace}.'
        return [self.declare_parameter(prefix + name, *rest) for name, *rest in parameters]

    def has_parameter(self, name: str) -> bool:
        return name in self._parameters

    def get_parameter(self, name: str) -> Parameter:
        if name not in self._parameters:
            raise ParameterNotDeclaredException(name)
        return self._parameters[name]

    def get_parameters(self, names: list[str]) -> list[Parameter]:
        return [self.get_parameter(name) for name in names]

    def get_parameter_or(self, name: str, alternative_value: Any = None) -> Parameter:
        return self._parameters.get(name) or alternative_value or Parameter(name)

    def describe_parameter(self, name: str) -> Any:
        self.get_parameter(name)
        return self._descriptors[name]

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        names = [
            name
            for name in self._parameters
            if (not depth or name.count('.') < depth)
            and (not prefixes or any(f'{name}.'.startswith(f'{each}.') for each in prefixes))
        ]
        parents = dict.fromkeys(name.rpartition('.')[0] for name in names if '.' in name)
        return _interface('ListParametersResult')(names=names, prefixes=[*parents])

    def set_parameters(self, parameter_list: list[Parameter]) -> list[Any]:
        return [self.set_parameters_atomically([each]) for each in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        self.get_parameters([each.name for each in parameter_list])
        return self._set(parameter_list, {})

    def _set(self, parameters: list[Parameter], declared: dict[str, Any]) -> Any:
        """Check and set parameters, with the descriptors of those that are being declared."""
        descriptors = self._descriptors | declared
        for each in parameters:
            if reason := self._fault(each, descriptors[each.name], declaring=bool(declared)):
                return _result(reason)
        for callback in self._on_set:
            result = callback(parameters)
            if not getattr(result, 'successful', False):
                return result or _result('Callback returned an invalid type')
        self._descriptors = descriptors
        event = _interface('ParameterEvent')(node=self._node.get_fully_qualified_name())
        event.stamp = self._node.get_clock().now().to_msg()
        kind = event.new_parameters if declared else event.changed_parameters
        for each in parameters:
            kind.append(each.to_parameter_msg())
            self._parameters[each.name] = each
        self._events.publish(event)
        for after in self._after:
            after(parameters)
        return _result()

    def _fault(self, parameter: Parameter, descriptor: Any, *, declaring: bool) -> str:
        """Return why a parameter cannot be set, or ''."""
        name, value, kind = parameter.name, parameter.value, parameter.type_
        descriptor.name = name
        if descriptor.read_only and not declaring:
            return f'Trying to set a read-only parameter: {name}.'
        if descriptor.dynamic_typing:
            descriptor.type = kind.value
        elif kind.value != descriptor.type and not (declaring and kind is Type.NOT_SET):
            return f"Wrong parameter type, expected '{Type(descriptor.type)}' got '{kind}'"
        ranges = {
            Type.INTEGER: descriptor.integer_range,
            Type.DOUBLE: descriptor.floating_point_range,
        }
        for allowed in ranges.get(kind, ()):
            low, high = sorted((allowed.from_value, allowed.to_value))
            if not low <= value <= high:
                mark = '.' if kind is Type.INTEGER else ''
                return (
                    f'Parameter {name} out of range{mark} Min: {low}, Max: {high}, value: {value}'
                )
            if allowed.step and (value - low) % allowed.step and value != high:
                return (
                    f'The parameter value for {name} is not a valid step. Min: {low}, max: {high}, '
                    f'value: {value}, step: {allowed.step}'
                )
        return ''

    def add_on_set_parameters_callback(self, callback: Any) -> None:
        self._on_set.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: Any) -> None:
        self._after.insert(0, callback)

    def serve(self) -> None:
        """Serve the parameters under rclpy's names."""
        for kind, short, callback in (
            ('DescribeParameters', 'describe_parameters', self._on_describe),
            ('GetParameters', 'get_parameters', self._on_get),
            ('ListParameters', 'list_parameters', self._on_list),
            ('SetParameters', 'set_parameters', self._on_set_request),
        ):
            self._node.create_service(_interface(kind, 'srv'), f'~/{short}', callback)

    def _on_describe(self, request: Any, response: Any) -> Any:
        if all(map(self.has_parameter, request.names)):
            response.descriptors = [*map(self.describe_parameter, request.names)]
        return response

    def _on_get(self, request: Any, response: Any) -> Any:
        if all(map(self.has_parameter, request.names)):
            found = self.get_parameters(request.names)
            response.values = [each.get_parameter_value() for each in found]
        return response

    def _on_list(self, request: Any, response: Any) -> Any:
        response.result = self.list_parameters(request.prefixes, request.depth)
        return response

    def _on_set_request(self, request: Any, response: Any) -> Any:
        for each in request.parameters:
            try:
                (result,) = self.set_parameters([Parameter.from_parameter_msg(each)])
            except ParameterNotDeclaredException as error:
                result = _result(str(error))
            response.results.append(result)
        return response
