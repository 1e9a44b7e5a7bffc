"""Parameters: declared with descriptors, set after checks, served to other nodes."""

from __future__ import annotations

import array
import math
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar

from barc_sim.ros.local.messages import message_type

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


def _interface(name: str, kind: str = 'msg') -> Any:
    return message_type(f'rcl_interfaces/{kind}/{name}')


class ParameterException(Exception):
    def __init__(self, error_msg: str, parameters: Any) -> None:
        super().__init__(f'{error_msg}: {parameters}')


class ParameterNotDeclaredException(ParameterException):
    def __init__(self, parameters: Any) -> None:
        super().__init__('Invalid access to undeclared parameter(s)', parameters)


class ParameterAlreadyDeclaredException(ParameterException):
    def __init__(self, parameters: Any) -> None:
        super().__init__('Parameter(s) already declared', parameters)


class InvalidParameterException(ParameterException):
    def __init__(self, parameter_name: str) -> None:
        super().__init__('Invalid parameter name', parameter_name)


class InvalidParameterTypeException(ParameterException):
    def __init__(self, desired_parameter: Parameter, expected_type: str) -> None:
        super().__init__(
            f"Trying to set parameter '{desired_parameter.name}' to '{desired_parameter.value}' of "
            f"type '{desired_parameter.type_.name}', expecting type '{expected_type}'",
            desired_parameter.name,
        )


class InvalidParameterValueException(ParameterException):
    def __init__(self, parameter: str, value: Any, reason: str) -> None:
        super().__init__(
            f'Invalid parameter value ({value}) for parameter. Reason: {reason}', parameter
        )


class ParameterImmutableException(ParameterException):
    def __init__(self, parameter_name: str) -> None:
        super().__init__('Attempted to modify read-only parameter', parameter_name)


class ParameterUninitializedException(ParameterException):
    def __init__(self, parameter_name: str) -> None:
        Exception.__init__(
            self, f"The parameter '{parameter_name}' is not initialized: {parameter_name}"
        )


class Type(Enum):
    """The types of parameters; the value of each is ParameterType's."""

    NOT_SET = 0
    BOOL = 1
    INTEGER = 2
    DOUBLE = 3
    STRING = 4
    BYTE_ARRAY = 5
    BOOL_ARRAY = 6
    INTEGER_ARRAY = 7
    DOUBLE_ARRAY = 8
    STRING_ARRAY = 9

    @property
    def field(self) -> str:
        """The field of ParameterValue that holds such a value."""
        return f'{self.name.lower()}_value'

    @classmethod
    def from_parameter_value(cls, parameter_value: Any) -> Type:
        if parameter_value is None:
            return cls.NOT_SET
        for kind, single in _SINGLE.items():
            if isinstance(parameter_value, single):
                return kind
        if isinstance(parameter_value, (list, tuple, array.array)):
            for kind, single in {cls.BYTE_ARRAY: bytes, **_ARRAYS}.items():
                if all(isinstance(each, single) for each in parameter_value):
                    return kind
            what = 'a list of one of the allowed types'
        else:
            what = 'one of the allowed types'
        raise TypeError(f"The given value is not {what} '{parameter_value}'.")

    def check(self, parameter_value: Any) -> bool:
        if self is Type.NOT_SET:
            return parameter_value is None
        if self in _SINGLE:
            return isinstance(parameter_value, _SINGLE[self])
        one = {Type.BYTE_ARRAY: bytes, **_ARRAYS}[self]
        return isinstance(parameter_value, (list, tuple, array.array)) and all(
            isinstance(each, one) for each in parameter_value
        )


_SINGLE = {Type.BOOL: bool, Type.INTEGER: int, Type.DOUBLE: float, Type.STRING: str}
_ARRAYS = {Type[f'{kind.name}_ARRAY']: single for kind, single in _SINGLE.items()}


class Parameter:
    Type: ClassVar[Any] = Type

    def __init__(self, name: str, type_: Any = None, value: Any = None) -> None:
        if type_ is None:
            type_ = Type.from_parameter_value(value)
        if not isinstance(type_, Type):
            raise TypeError(f"type must be an instance of '{Type!r}'")
        if not type_.check(value):
            raise ValueError(f"Type '{type_}' and value '{value}' do not agree")
        self.name, self.type_, self.value = name, type_, value

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

    def __init__(self, events: Any, overrides: dict[str, Parameter], undeclared: bool) -> None:
        self._events = events
        self._parameter_overrides, self._allow_undeclared_parameters = overrides, undeclared
        self._parameters: dict[str, Parameter] = {}
        self._descriptors: dict[str, Any] = {}
        self._before: list[Callable[[list[Parameter]], list[Parameter]]] = []
        self._on_set: list[Callable[[list[Parameter]], Any]] = []
        self._after: list[Callable[[list[Parameter]], object]] = []

    def declare_parameter(
        self, name: str, value: Any = None, descriptor: Any = None, ignore_override: bool = False
    ) -> Parameter:
        return self.declare_parameters('', [(name, value, descriptor)], ignore_override)[0]

    def declare_parameters(
        self, namespace: str, parameters: Iterable[Any], ignore_override: bool = False
    ) -> list[Parameter]:
        declared = []
        for each in parameters:
            short, value, descriptor = (*each, None, None)[:3]
            name = f'{namespace}.{short}' if namespace else short
            if not (isinstance(name, str) and name):
                raise InvalidParameterException(name)
            descriptor = descriptor or _interface('ParameterDescriptor')()
            if len(each) == 1 or (value is None and each[2:] == (None,)):
                descriptor.dynamic_typing = True
            if isinstance(value, Type):
                descriptor.type, value = value.value, None
            elif not descriptor.dynamic_typing:
                descriptor.type = Type.from_parameter_value(value).value
                if not descriptor.type:
                    raise ValueError(
                        'Cannot declare a statically typed parameter with default value of type '
                        'PARAMETER_NOT_SET'
                    )
            if not ignore_override and name in self._parameter_overrides:
                value = self._parameter_overrides[name].value
            declared.append((Parameter(name, value=value), descriptor))
        if again := [each.name for each, _ in declared if each.name in self._parameters]:
            raise ParameterAlreadyDeclaredException(again)
        for parameter, descriptor in declared:
            self._declare(parameter, descriptor)
        return [self._parameters[each.name] for each, _ in declared]

    def _declare(self, parameter: Parameter, descriptor: Any) -> None:
        result = self._set([parameter], {parameter.name: descriptor})
        if result.reason.startswith('Wrong parameter type'):
            raise InvalidParameterTypeException(parameter, Type(descriptor.type).name)
        if not result.successful:
            raise InvalidParameterValueException(parameter.name, parameter.value, result.reason)

    def undeclare_parameter(self, name: str) -> None:
        if name not in self._parameters:
            raise ParameterNotDeclaredException(name)
        if self._descriptors[name].read_only:
            raise ParameterImmutableException(name)
        del self._parameters[name], self._descriptors[name]

    def has_parameter(self, name: str) -> bool:
        return name in self._parameters

    def get_parameter(self, name: str) -> Parameter:
        if name not in self._parameters:
            if self._allow_undeclared_parameters:
                return Parameter(name)
            raise ParameterNotDeclaredException(name)
        parameter = self._parameters[name]
        if parameter.type_ is Type.NOT_SET and not self._descriptors[name].dynamic_typing:
            raise ParameterUninitializedException(name)
        return parameter

    def get_parameters(self, names: list[str]) -> list[Parameter]:
        return [self.get_parameter(name) for name in names]

    def get_parameter_or(self, name: str, alternative_value: Parameter | None = None) -> Parameter:
        found = self._parameters.get(name)
        if found is None or found.type_ is Type.NOT_SET:
            return alternative_value or Parameter(name)
        return found

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        prefix = prefix and f'{prefix}.'
        return {
            name.removeprefix(prefix): parameter
            for name, parameter in self._parameters.items()
            if name.startswith(prefix)
        }

    def get_parameter_type(self, name: str) -> Any:
        if name not in self._parameters and not self._allow_undeclared_parameters:
            raise ParameterNotDeclaredException(name)
        return self.get_parameter_or(name).type_.value

    def get_parameter_types(self, names: list[str]) -> list[Any]:
        return [self.get_parameter_type(name) for name in names]

    def describe_parameter(self, name: str) -> Any:
        if name not in self._descriptors:
            if self._allow_undeclared_parameters:
                return _interface('ParameterDescriptor')()
            raise ParameterNotDeclaredException(name)
        return self._descriptors[name]

    def describe_parameters(self, names: list[str]) -> list[Any]:
        return [self.describe_parameter(name) for name in names]

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        def is_listed(name: str) -> bool:
            if not prefixes:
                return not depth or name.count('.') < depth
            return any(
                name == prefix
                or (
                    name.startswith(f'{prefix}.')
                    and (not depth or name[len(prefix) + 1 :].count('.') < depth)
                )
                for prefix in prefixes
            )

        names = [name for name in self._parameters if is_listed(name)]
        parents = dict.fromkeys(name.rpartition('.')[0] for name in names if '.' in name)
        return _interface('ListParametersResult')(names=names, prefixes=[*parents])

    def set_parameters(self, parameter_list: list[Parameter]) -> list[Any]:
        return [self.set_parameters_atomically([each]) for each in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        if self._before:
            parameter_list = [each for call in self._before for each in call(parameter_list)]
            if not parameter_list:
                return _result(
                    'parameter list cannot be empty, this might be due to '
                    'pre_set_parameters_callback modifying the original parameters list.'
                )
        if not all(isinstance(each, Parameter) for each in parameter_list):
            raise TypeError(f"parameter must be instance of type '{Parameter!r}'")
        unknown = [each.name for each in parameter_list if each.name not in self._parameters]
        if unknown and not self._allow_undeclared_parameters:
            raise ParameterNotDeclaredException(unknown)
        return self._set(parameter_list, None)

    def _set(self, parameters: list[Parameter], declared: dict[str, Any] | None) -> Any:
        """Check and set parameters, with the descriptors of those that are being declared."""
        descriptors = self._descriptors if declared is None else declared
        for each in parameters:
            if each.name in descriptors:
                reason = self._fault(each, descriptors[each.name], declaring=declared is not None)
                if reason:
                    return _result(reason)
        for callback in self._on_set:
            result = callback(parameters)
            if not getattr(result, 'successful', False):
                return result or _result('Callback returned an invalid type')
        event = _interface('ParameterEvent')(node=self.get_fully_qualified_name())  # type: ignore[attr-defined]
        for each in parameters:
            if declared is None and each.type_ is Type.NOT_SET:
                event.deleted_parameters.append(each.to_parameter_msg())
                self._parameters.pop(each.name, None)
                self._descriptors.pop(each.name, None)
                continue
            dynamic = _interface('ParameterDescriptor')(dynamic_typing=True)
            self._descriptors[each.name] = descriptors.get(each.name, dynamic)
            is_new = self.get_parameter_or(each.name).type_ is Type.NOT_SET
            kind = event.new_parameters if is_new else event.changed_parameters
            kind.append(each.to_parameter_msg())
            self._parameters[each.name] = each
        event.stamp = self.get_clock().now().to_msg()  # type: ignore[attr-defined]
        self._events.publish(event)
        if any(each.name == 'use_sim_time' for each in parameters):
            self._follow_clock()  # type: ignore[attr-defined]
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
        elif name in self._parameters and kind is Type.NOT_SET:
            return 'Static parameter cannot be undeclared'
        elif kind is not Type.NOT_SET and kind.value != descriptor.type:
            return f"Wrong parameter type, expected '{Type(descriptor.type)}' got '{kind}'"
        if kind is Type.INTEGER and descriptor.integer_range:
            return _outside(name, value, descriptor.integer_range[0], 0.0, '. ')
        if kind is Type.DOUBLE and descriptor.floating_point_range:
            return _outside(name, value, descriptor.floating_point_range[0], 1e-6, ' ')
        return ''

    def add_pre_set_parameters_callback(self, callback: Any) -> None:
        self._before.insert(0, callback)

    def add_on_set_parameters_callback(self, callback: Any) -> None:
        self._on_set.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: Any) -> None:
        self._after.insert(0, callback)

    def remove_pre_set_parameters_callback(self, callback: Any) -> None:
        self._before.remove(callback)

    def remove_on_set_parameters_callback(self, callback: Any) -> None:
        self._on_set.remove(callback)

    def remove_post_set_parameters_callback(self, callback: Any) -> None:
        self._after.remove(callback)

    # Services

    def serve_parameters(self) -> None:
        """Serve the parameters under rclpy's names."""
        for kind, short, callback in (
            ('DescribeParameters', 'describe_parameters', self._on_describe),
            ('GetParameters', 'get_parameters', self._on_get),
            ('GetParameterTypes', 'get_parameter_types', self._on_types),
            ('ListParameters', 'list_parameters', self._on_list),
            ('SetParameters', 'set_parameters', self._on_set_request),
            ('SetParametersAtomically', 'set_parameters_atomically', self._on_set_atomically),
        ):
            self.create_service(_interface(kind, 'srv'), f'~/{short}', callback)  # type: ignore[attr-defined]

    def _on_describe(self, request: Any, response: Any) -> Any:
        if all(map(self.has_parameter, request.names)):
            response.descriptors = self.describe_parameters(request.names)
        return response

    def _on_get(self, request: Any, response: Any) -> Any:
        if all(map(self.has_parameter, request.names)):
            response.values = [
                self._parameters[name].get_parameter_value() for name in request.names
            ]
        return response

    def _on_types(self, request: Any, response: Any) -> Any:
        if all(map(self.has_parameter, request.names)):
            response.types = self.get_parameter_types(request.names)
        return response

    def _on_list(self, request: Any, response: Any) -> Any:
        response.result = self.list_parameters([*request.prefixes], request.depth)
        return response

    def _on_set_request(self, request: Any, response: Any) -> Any:
        response.results = [
            self._set_from(request.parameters[i : i + 1]) for i in range(len(request.parameters))
        ]
        return response

    def _on_set_atomically(self, request: Any, response: Any) -> Any:
        response.result = self._set_from(request.parameters)
        return response

    def _set_from(self, messages: Iterable[Any]) -> Any:
        try:
            return self.set_parameters_atomically([*map(Parameter.from_parameter_msg, messages)])
        except ParameterNotDeclaredException as error:
            return _result(str(error))


def _outside(name: str, value: float, allowed: Any, tolerance: float, mark: str) -> str:
    """Return why a value is not in a range, or ''; its bounds always are."""
    low, high = sorted((allowed.from_value, allowed.to_value))
    if any(math.isclose(value, bound, rel_tol=tolerance) for bound in (low, high)):
        return ''
    if not low < value < high:
        return f'Parameter {name} out of range{mark}Min: {low}, Max: {high}, value: {value}'
    step = allowed.step
    if step and not math.isclose(
        low + round((value - low) / step) * step, value, rel_tol=tolerance
    ):
        close = 'close enough to a valid' if tolerance else 'a valid'
        return (
            f'The parameter value for {name} is not {close} step. Min: {low}, max: {high}, '
            f'value: {value}, step: {step}'
        )
    return ''
