"""What a user writes, as barc_sim calls it: model, controller, relay, checked at each call."""

from __future__ import annotations

import inspect
from math import isfinite, nan
from typing import TYPE_CHECKING, Any

from barc_sim.lab.user_code.call import Calls, number, shown, where
from barc_sim.lab.user_code.source import UserCodeError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from barc_sim.lab.user_code.importing import Folder

_BIKE_FE = ('x', 'y', 'psi', 'v', 'a', 'd_f', 'a0', 'm', 'Ff', 'theta', 'ts')
_NEXT = ('x_next', 'y_next', 'psi_next', 'v_next')
_COMMAND = ('motor', 'servo')
_GAINS = ('kp', 'ki', 'kd')
_SPEEDS = ('speed_reference', 'speed_current')
_TWIST = ('linear_x', 'angular_z')
_FLOAT = {float}
_EVERY_KIND = inspect.Parameter.VAR_KEYWORD


class UserModel:
    """A user's `bikeFE`.

    Where it takes them, by name, it is also told `l_f`, `l_r` and `g`.
    """

    def __init__(self, folder: Folder, function: Callable[..., Any], budget: float | None) -> None:
        """Check that `function` takes what it is to be given.

        Raises
        ------
        UserCodeError
            where it does not.
        """
        _check_takes(folder, function, _BIKE_FE)
        self._options = _options(function, _BIKE_FE)
        self._calls = Calls(folder, function, budget, f'four finite numbers, [{", ".join(_NEXT)}]')

    def __call__(self, *args: float, **options: float) -> list[float]:
        """Return `[x, y, psi, v]` of the next step; the arguments are `bikeFE`'s.

        Raises
        ------
        UserCodeError
            where the user's function fails, or returns anything but four finite numbers.
        """
        taken = self._options(options)
        result = self._calls(*args, **taken)
        numbers = _numbers(result, len(_NEXT))
        if numbers is None:
            raise self._calls.wrong(result, args, taken)
        return numbers


class ControllerFactory:
    """A user's class `PID`: makes controllers of it.

    Where it takes them, by name, its constructor is also told further options by name, such as
    `output_min` and `output_max`.
    """

    def __init__(self, folder: Folder, cls: type, budget: float | None) -> None:
        """Check that the class takes three gains and has an `acc_calculate`.

        Raises
        ------
        UserCodeError
            where it does not.
        """
        _check_takes(folder, cls, _GAINS)
        method = getattr(cls, 'acc_calculate', None)
        if not callable(method):
            raise UserCodeError(
                f'{where(folder, cls)}: the class {cls.__name__} has no method '
                'acc_calculate(self, speed_reference, speed_current)'
            )
        self._folder = folder
        self._budget = budget
        self._options = _options(cls, _GAINS)
        self._calls = Calls(folder, cls, budget, 'an object')
        self._expected = 'a finite number, the acceleration [m/s²]'

    def __call__(self, kp: float, ki: float, kd: float, **options: float) -> UserPid:
        """Return a fresh controller.

        Raises
        ------
        UserCodeError
            where the user's constructor fails.
        """
        instance = self._calls(kp, ki, kd, **self._options(options))
        method = instance.acc_calculate
        dt_name = _dt_name(self._folder, method, _SPEEDS)
        calls = Calls(self._folder, method, self._budget, self._expected)
        return UserPid(instance, calls, dt_name)


class UserPid:
    """An object of a user's class `PID`.

    Attributes
    ----------
    instance
        The object itself.
    """

    def __init__(self, instance: Any, calls: Calls, dt_name: str) -> None:  # noqa: ANN401
        """Call `calls`, with dt by the name `dt_name` unless that is empty."""
        self.instance = instance
        self._calls = calls
        self._dt_name = dt_name

    def acc_calculate(self, speed_reference: float, speed_current: float, dt: float) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call.

        Raises
        ------
        UserCodeError
            where the user's method fails, or returns anything but a finite number.
        """
        speeds = (speed_reference, speed_current)
        options = {self._dt_name: dt} if self._dt_name else {}
        result = self._calls(*speeds, **options)
        value = result if type(result) is float else number(result)
        if value is None or not isfinite(value):
            raise self._calls.wrong(result, speeds, options)
        return value

    def tell(self, name: str) -> float:
        """Return the object's attribute `name`, NaN where it has no such number."""
        value = number(getattr(self.instance, name, nan))
        return nan if value is None else value

    def set_gains(self, kp: float, ki: float, kd: float) -> None:
        """Change those gains that the object has as attributes."""
        for name, value in zip(_GAINS, (kp, ki, kd), strict=True):
            if hasattr(self.instance, name):
                setattr(self.instance, name, value)


class RelayFactory:
    """A user's function `relay`, or class `Relay` with a method `relay`: makes relays of it."""

    def __init__(
        self, folder: Folder, relay: Callable[..., Any] | type, budget: float | None
    ) -> None:
        """Check that it takes what it is to be given.

        Raises
        ------
        UserCodeError
            where it does not.
        """
        if isinstance(relay, type):
            _check_takes(folder, relay, ())
            if not callable(getattr(relay, 'relay', None)):
                raise UserCodeError(
                    f'{where(folder, relay)}: the class {relay.__name__} has no method '
                    'relay(self, linear_x, angular_z)'
                )
        self._folder = folder
        self._budget = budget
        self._new = Calls(folder, relay, budget, 'an object') if isinstance(relay, type) else None
        self._function = relay
        if self._new is None:
            _dt_name(folder, relay, _TWIST)

    def __call__(self) -> UserRelay:
        """Return a fresh relay.

        Raises
        ------
        UserCodeError
            where the user's constructor fails.
        """
        function = self._new().relay if self._new else self._function
        dt_name = _dt_name(self._folder, function, _TWIST)
        expected = f'two finite numbers, [{", ".join(_COMMAND)}]'
        return UserRelay(Calls(self._folder, function, self._budget, expected), dt_name)


class UserRelay:
    """A user's relay at work."""

    def __init__(self, calls: Calls, dt_name: str) -> None:
        """Call `calls`, with dt by the name `dt_name` unless that is empty."""
        self._calls = calls
        self._dt_name = dt_name

    def relay(self, linear_x: float, angular_z: float, dt: float) -> tuple[float, float]:
        """Return motor [m/s²] and servo [rad] for a Twist, `dt` seconds after the last call.

        Raises
        ------
        UserCodeError
            where user code fails, or returns anything but two finite numbers.
        """
        twist = (linear_x, angular_z)
        options = {self._dt_name: dt} if self._dt_name else {}
        result = self._calls(*twist, **options)
        numbers = _numbers(result, len(_COMMAND))
        if numbers is None:
            raise self._calls.wrong(result, twist, options)
        return numbers[0], numbers[1]


def _numbers(result: Any, count: int) -> list[float] | None:  # noqa: ANN401 (a user's)
    """Return `result` as a list of `count` finite floats; None where it is none."""
    # Most often it is one already, and is asked for in each step.
    if type(result) is list and len(result) == count and {*map(type, result)} == _FLOAT:
        return result if isfinite(sum(result)) or all(map(isfinite, result)) else None
    if hasattr(result, 'ravel'):
        result = list(result.ravel())
    if not isinstance(result, (list, tuple)) or len(result) != count:
        return None
    values = [value if type(value) is float else number(value) for value in result]
    for value in values:
        if value is None or not isfinite(value):
            return None
    return values  # type: ignore[return-value]  # no None is left


def _check_takes(folder: Folder, function: Callable[..., Any], names: Sequence[str]) -> None:
    """Refuse a function that does not take as many arguments as there are `names`."""
    signature = _signature(folder, function)
    if not _binds(signature, len(names)):
        raise _takes(folder, function, signature, names)


def _dt_name(folder: Folder, function: Callable[..., Any], names: Sequence[str]) -> str:
    """Return what `function`, which takes `names`, calls dt; empty where it does not take it.

    That is `dt`, or any name of an argument that it can't be called without.
    """
    signature = _signature(folder, function)
    count = len(names)
    if 'dt' in signature.parameters and _binds(signature, count, dt=0.0):
        return 'dt'
    if _binds(signature, count):
        return ''
    for name in list(signature.parameters)[count:]:
        if _binds(signature, count, **{name: 0.0}):
            return name
    raise _takes(folder, function, signature, names)


def _signature(folder: Folder, function: Callable[..., Any]) -> inspect.Signature:
    try:
        return inspect.signature(function)
    except (TypeError, ValueError) as error:
        raise UserCodeError(
            f'{where(folder, function)}: expected a function of Python, not {shown(function)}'
        ) from error


def _takes(
    folder: Folder,
    function: Callable[..., Any],
    signature: inspect.Signature,
    names: Sequence[str],
) -> UserCodeError:
    name = getattr(function, '__name__', shown(function))
    return UserCodeError(
        f'{where(folder, function)}: {name} takes ({", ".join(signature.parameters)}); expected '
        f'({", ".join(names)})'
    )


def _binds(signature: inspect.Signature, count: int, **options: float) -> bool:
    try:
        signature.bind(*range(count), **options)
    except TypeError:
        return False
    return True


def _options(
    function: Callable[..., Any], names: Sequence[str]
) -> Callable[[dict[str, float]], dict[str, float]]:
    """Return what picks those options that `function` takes beyond its first arguments."""
    parameters = list(inspect.signature(function).parameters.values())
    if any(parameter.kind is _EVERY_KIND for parameter in parameters):
        return lambda options: options
    taken = {parameter.name for parameter in parameters[len(names) :]}
    if not taken:
        return lambda _: {}
    return lambda options: {name: options[name] for name in options if name in taken}
