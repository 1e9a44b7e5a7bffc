"""A user's model, controller and relay.

Each is checked when it is made, and the result of each call. What does not fit, what fails and what
takes too long is a UserCodeError: one sentence with the file, the line and the values.
"""

from __future__ import annotations

from inspect import Parameter, Signature, signature
from itertools import islice
from math import isfinite, nan
from typing import TYPE_CHECKING, Any

from barc_sim.lab.user_code.call import Calls, defined_at, guarded, number, short_repr
from barc_sim.lab.user_code.gains import gain_names
from barc_sim.lab.user_code.relay_program import Command, TimedTwist
from barc_sim.lab.user_code.source import UserCodeError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from barc_sim.lab.user_code.gains import ChosenGains
    from barc_sim.lab.user_code.importing import Folder

_BIKE_FE = ('x', 'y', 'psi', 'v', 'a', 'd_f', 'a0', 'm', 'Ff', 'theta', 'ts')
_NEXT = ('x_next', 'y_next', 'psi_next', 'v_next')
_COMMAND = ('motor', 'servo')
_GAINS = ('kp', 'ki', 'kd')
_SPEEDS = ('speed_reference', 'speed_current')
_TWIST = ('linear_x', 'angular_z')
_FLOAT = {float}


class UserModel:
    """A user's `bikeFE`, which returns four finite numbers.

    It also gets `l_f`, `l_r` and `g` if it has arguments of these names.
    """

    def __init__(self, folder: Folder, function: Callable[..., Any], budget: float | None) -> None:
        """Check that `function` takes the arguments of `bikeFE`."""
        _check_takes(folder, function, _BIKE_FE)
        self._options = _options_for(function, _BIKE_FE)
        self._calls = Calls(folder, function, budget, f'four finite numbers, [{", ".join(_NEXT)}]')

    def __call__(self, *args: float, **options: float) -> list[float]:
        """Return `[x, y, psi, v]` of the next step; the arguments are `bikeFE`'s."""
        return _numbers(self._calls, len(_NEXT), args, self._options(options))


class ControllerFactory:
    """Makes controllers of a user's class `PID`.

    Its constructor also gets options such as `output_min` and `output_max`, if it has arguments of
    these names.
    """

    def __init__(self, folder: Folder, cls: type, budget: float | None) -> None:
        """Check that the class takes three gains and has an `acc_calculate`."""
        _check_takes(folder, cls, _GAINS)
        _check_method(folder, cls, 'acc_calculate', _SPEEDS)
        self._folder = folder
        self._budget = budget
        #: Loads the file again, with global variables of its own.
        self.fresh: Callable[[], ControllerFactory] = lambda: self
        #: The gains that its file chooses.
        self.chosen: ChosenGains | None = None
        names = [*signature(cls).parameters]
        #: The names of the constructor's arguments for kp, ki and kd; empty: it takes any three.
        self.gain_names = gain_names(names) if len(names) >= len(_GAINS) else ()
        self._in_order = self.gain_names == tuple(names[:3]) or not self.gain_names
        self._options = _options_for(cls, _GAINS)
        self._calls = Calls(folder, cls, budget, 'an object')
        self._expected = 'a finite number, the acceleration [m/s²]'

    def __call__(self, kp: float, ki: float, kd: float, **options: float) -> UserPid:
        """Return a new controller."""
        taken = self._options(options)
        if self._in_order:
            instance = self._calls(kp, ki, kd, **taken)
        else:
            instance = self._calls(**dict(zip(self.gain_names, (kp, ki, kd), strict=True)), **taken)
        method = self._calls.attribute(instance, 'acc_calculate')
        dt = _dt_name(self._folder, method, _SPEEDS)
        calls = Calls(self._folder, method, self._budget, self._expected)
        return UserPid(instance, calls, dt)


class UserPid:
    """An object of a user's class `PID`."""

    def __init__(self, instance: Any, calls: Calls, dt: str) -> None:  # noqa: ANN401
        """Call `calls`, with the time step as the argument named `dt`, if any."""
        self.instance = instance  #: the object itself
        self._calls = calls
        self._dt_name = dt

    def acc_calculate(self, speed_reference: float, speed_current: float, dt: float) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        speeds = (speed_reference, speed_current)
        options = {self._dt_name: dt} if self._dt_name else {}
        result = self._calls(*speeds, **options)
        value = result if type(result) is float else self._calls.attempt(number, result)
        if value is None or not isfinite(value):
            raise self._calls.wrong(result, speeds, options)
        return value

    def read(self, name: str) -> float:
        """Return the object's attribute `name`; NaN if it is not a number."""
        value = self._calls.attempt(getattr, self.instance, name, nan)
        if type(value) is not float:
            value = self._calls.attempt(number, value)
        return nan if value is None else value

    def set_gains(self, kp: float, ki: float, kd: float) -> None:
        """Change those gains that the object has as attributes."""
        for name, value in zip(_GAINS, (kp, ki, kd), strict=True):
            if self._calls.attempt(hasattr, self.instance, name):
                self._calls.attempt(setattr, self.instance, name, value)


class RelayFactory:
    """Makes relays of a user's function `relay`, or class `Relay` with a method `relay`."""

    def __init__(
        self, folder: Folder, relay: Callable[..., Any] | type, budget: float | None
    ) -> None:
        """Check that it takes a Twist's two values."""
        if isinstance(relay, type):
            _check_takes(folder, relay, ())
            _check_method(folder, relay, 'relay', _TWIST)
            self._new: Calls | None = Calls(folder, relay, budget, 'an object')
        else:
            _dt_name(folder, relay, _TWIST)
            self._new = None
        self._folder, self._budget, self._function = folder, budget, relay

    def __call__(self) -> UserRelay:
        """Return a new relay."""
        function = self._new.attribute(self._new(), 'relay') if self._new else self._function
        dt = _dt_name(self._folder, function, _TWIST)
        expected = f'two finite numbers, [{", ".join(_COMMAND)}]'
        return UserRelay(Calls(self._folder, function, self._budget, expected), dt)

    def commands(self, calls: Sequence[TimedTwist]) -> list[Command]:
        """Return what a new one answers to these calls, which are evenly spaced."""
        relay, dt = self(), calls[1].t - calls[0].t
        return [Command(t, *relay.relay(x, z, dt)) for t, x, z in calls]


class UserRelay:
    """A user's function `relay`, or an object of the class `Relay`."""

    def __init__(self, calls: Calls, dt: str) -> None:
        """Call `calls`, with the time step as the argument named `dt`, if any."""
        self._calls = calls
        self._dt_name = dt

    def relay(self, linear_x: float, angular_z: float, dt: float) -> tuple[float, float]:
        """Return motor [m/s²] and servo [rad] for a Twist, `dt` seconds after the last call."""
        twist = (linear_x, angular_z)
        options = {self._dt_name: dt} if self._dt_name else {}
        motor, servo = _numbers(self._calls, len(_COMMAND), twist, options)
        return motor, servo


def _check_method(folder: Folder, cls: type, name: str, arguments: Sequence[str]) -> None:
    if not callable(guarded(getattr, cls, name, default=None)):
        raise UserCodeError(
            f'{defined_at(folder, cls)}: the class {cls.__name__} has no method '
            f'{name}(self, {", ".join(arguments)})'
        )


def _numbers(
    calls: Calls, count: int, args: tuple[float, ...], options: Mapping[str, float]
) -> list[float]:
    """Call the function; return its result as a list of `count` finite floats, or refuse it."""
    result = calls(*args, **options)
    # The most common case, checked in each step.
    plain = type(result) is list and len(result) == count and {*map(type, result)} == _FLOAT
    if plain and (isfinite(sum(result)) or all(map(isfinite, result))):
        return result  # type: ignore[no-any-return]
    numbers = calls.attempt(_converted, result, count)
    if numbers is None:
        raise calls.wrong(result, args, options)
    return numbers


def _converted(result: Any, count: int) -> list[float] | None:  # noqa: ANN401 (a user's)
    if hasattr(result, 'ravel'):
        result = list(islice(result.ravel(), count + 1))
    if not isinstance(result, (list, tuple)) or len(result) != count:
        return None
    values = [value if type(value) is float else number(value) for value in islice(result, count)]
    finite = [value for value in values if value is not None and isfinite(value)]
    return finite if len(finite) == count else None


def _check_takes(folder: Folder, function: Callable[..., Any], names: Sequence[str]) -> None:
    """Refuse a function that does not take the arguments `names`."""
    found = _signature(folder, function)
    if not _binds(found, len(names)):
        raise _takes(folder, function, found, names)


def _dt_name(folder: Folder, function: Callable[..., Any], names: Sequence[str]) -> str:
    """Return the name of the time step among the arguments of `function`, empty if there is none.

    That is `dt`, or the one required argument after `names`.
    """
    found = _signature(folder, function)
    count = len(names)
    if 'dt' in found.parameters and _binds(found, count, dt=0.0):
        return 'dt'
    if _binds(found, count):
        return ''
    for name in list(found.parameters)[count:]:
        if _binds(found, count, **{name: 0.0}):
            return name
    raise _takes(folder, function, found, names)


def _signature(folder: Folder, function: Callable[..., Any]) -> Signature:
    try:
        return signature(function)
    except Exception as error:
        raise UserCodeError(
            f'{defined_at(folder, function)}: expected a function, got {short_repr(function)}'
        ) from error


def _takes(
    folder: Folder, function: Callable[..., Any], found: Signature, names: Sequence[str]
) -> UserCodeError:
    name = guarded(getattr, function, '__name__', default=short_repr(function))
    return UserCodeError(
        f'{defined_at(folder, function)}: {name} takes ({", ".join(found.parameters)}); '
        f'expected ({", ".join(names)})'
    )


def _binds(found: Signature, count: int, **options: float) -> bool:
    try:
        found.bind(*range(count), **options)
    except TypeError:
        return False
    return True


def _options_for(
    function: Callable[..., Any], names: Sequence[str]
) -> Callable[[dict[str, float]], dict[str, float]]:
    """Return a function that selects the options that `function` takes after `names`."""
    parameters = list(signature(function).parameters.values())
    if any(parameter.kind is Parameter.VAR_KEYWORD for parameter in parameters):
        return lambda options: options
    taken = {parameter.name for parameter in parameters[len(names) :]}
    if not taken:
        return lambda _: {}
    return lambda options: {name: options[name] for name in options if name in taken}
