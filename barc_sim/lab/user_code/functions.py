"""A user's model, controller and relay; the result of each call is checked."""

from __future__ import annotations

from inspect import signature
from itertools import islice
from math import inf, isfinite, nan
from typing import TYPE_CHECKING, Any

from barc_sim.control.rates import RATE, STALE_AFTER
from barc_sim.lab.user_code.call import Calls, defined_at, guarded, number
from barc_sim.lab.user_code.ros_world import Command, TimedTwist
from barc_sim.lab.user_code.signatures import check_takes, dt_name, gain_names, options_for
from barc_sim.lab.user_code.source import UserCodeError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

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
    """A user's `bikeFE`.

    It also gets `l_f`, `l_r` and `g` if it has arguments of these names.
    """

    def __init__(self, folder: Folder, function: Callable[..., Any], budget: float | None) -> None:
        """Check that `function` takes the arguments of `bikeFE`.

        Raises
        ------
        UserCodeError
            if it does not.
        """
        check_takes(folder, function, _BIKE_FE)
        self._options = options_for(function, _BIKE_FE)
        self._calls = Calls(folder, function, budget, f'four finite numbers, [{", ".join(_NEXT)}]')

    def __call__(self, *args: float, **options: float) -> list[float]:
        """Return `[x, y, psi, v]` of the next step; the arguments are `bikeFE`'s.

        Raises
        ------
        UserCodeError
            if the user's function fails, or returns anything but four finite numbers.
        """
        taken = self._options(options)
        result = self._calls(*args, **taken)
        numbers = _numbers(self._calls, result, len(_NEXT))
        if numbers is None:
            raise self._calls.wrong(result, args, taken)
        return numbers


class ControllerFactory:
    """Makes controllers of a user's class `PID`.

    Its constructor also gets options such as `output_min` and `output_max`, if it has arguments of
    these names.
    """

    def __init__(self, folder: Folder, cls: type, budget: float | None) -> None:
        """Check that the class takes three gains and has an `acc_calculate`.

        Raises
        ------
        UserCodeError
            if it does not.
        """
        check_takes(folder, cls, _GAINS)
        method = guarded(getattr, cls, 'acc_calculate', default=None)
        if not callable(method):
            raise UserCodeError(
                f'{defined_at(folder, cls)}: the class {cls.__name__} has no method '
                'acc_calculate(self, speed_reference, speed_current)'
            )
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
        self._options = options_for(cls, _GAINS)
        self._calls = Calls(folder, cls, budget, 'an object')
        self._expected = 'a finite number, the acceleration [m/s²]'

    def __call__(self, kp: float, ki: float, kd: float, **options: float) -> UserPid:
        """Return a new controller.

        Raises
        ------
        UserCodeError
            if the user's constructor fails.
        """
        taken = self._options(options)
        if self._in_order:
            instance = self._calls(kp, ki, kd, **taken)
        else:
            instance = self._calls(**dict(zip(self.gain_names, (kp, ki, kd), strict=True)), **taken)
        method = self._calls.attribute(instance, 'acc_calculate')
        dt = dt_name(self._folder, method, _SPEEDS)
        calls = Calls(self._folder, method, self._budget, self._expected)
        return UserPid(instance, calls, dt)


class UserPid:
    """An object of a user's class `PID`.

    Attributes
    ----------
    instance
        The object itself.
    """

    def __init__(self, instance: Any, calls: Calls, dt: str) -> None:  # noqa: ANN401
        """Call `calls`, with the time step as the argument named `dt`, if any."""
        self.instance = instance
        self._calls = calls
        self._dt_name = dt

    def acc_calculate(self, speed_reference: float, speed_current: float, dt: float) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call.

        Raises
        ------
        UserCodeError
            if the user's method fails, or returns anything but a finite number.
        """
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
        """Check that it takes a Twist's two values.

        Raises
        ------
        UserCodeError
            if it does not.
        """
        if isinstance(relay, type):
            check_takes(folder, relay, ())
            if not callable(guarded(getattr, relay, 'relay', default=None)):
                raise UserCodeError(
                    f'{defined_at(folder, relay)}: the class {relay.__name__} has no method '
                    'relay(self, linear_x, angular_z)'
                )
        self._folder = folder
        self._budget = budget
        self._new = Calls(folder, relay, budget, 'an object') if isinstance(relay, type) else None
        self._function = relay
        if self._new is None:
            dt_name(folder, relay, _TWIST)

    def __call__(self) -> UserRelay:
        """Return a new relay.

        Raises
        ------
        UserCodeError
            if the user's constructor fails.
        """
        function = self._new.attribute(self._new(), 'relay') if self._new else self._function
        dt = dt_name(self._folder, function, _TWIST)
        expected = f'two finite numbers, [{", ".join(_COMMAND)}]'
        return UserRelay(Calls(self._folder, function, self._budget, expected), dt)

    def commands(self, twists: Sequence[TimedTwist], duration: float) -> list[Command]:
        """Return what a new one answers from 0 to `duration` [s], as the node `relay` calls it.

        The node calls it `RATE` times a second with the latest of the `twists`, and with zeros
        where that is stale.

        Raises
        ------
        UserCodeError
            if user code fails, or returns anything but two finite numbers.
        """
        relay, found = self(), []
        dt, nothing = 1.0 / RATE, TimedTwist(-inf, 0.0, 0.0)
        for k in range(round(duration * RATE)):
            t = k * dt
            latest = max((each for each in twists if each.t <= t + 1e-9), default=nothing)
            used = latest if t - latest.t <= STALE_AFTER else nothing
            found.append(Command(t, *relay.relay(used.linear_x, used.angular_z, dt)))
        return found


class UserRelay:
    """A user's function `relay`, or an object of the class `Relay`."""

    def __init__(self, calls: Calls, dt: str) -> None:
        """Call `calls`, with the time step as the argument named `dt`, if any."""
        self._calls = calls
        self._dt_name = dt

    def relay(self, linear_x: float, angular_z: float, dt: float) -> tuple[float, float]:
        """Return motor [m/s²] and servo [rad] for a Twist, `dt` seconds after the last call.

        Raises
        ------
        UserCodeError
            if user code fails, or returns anything but two finite numbers.
        """
        twist = (linear_x, angular_z)
        options = {self._dt_name: dt} if self._dt_name else {}
        result = self._calls(*twist, **options)
        numbers = _numbers(self._calls, result, len(_COMMAND))
        if numbers is None:
            raise self._calls.wrong(result, twist, options)
        return numbers[0], numbers[1]


def _numbers(calls: Calls, result: Any, count: int) -> list[float] | None:  # noqa: ANN401
    """Return `result` as a list of `count` finite floats; None if it is something else."""
    # The most common case, checked in each step.
    if type(result) is list and len(result) == count and {*map(type, result)} == _FLOAT:
        return result if isfinite(sum(result)) or all(map(isfinite, result)) else None
    return calls.attempt(_converted, result, count)


def _converted(result: Any, count: int) -> list[float] | None:  # noqa: ANN401 (a user's)
    if hasattr(result, 'ravel'):
        result = list(islice(result.ravel(), count + 1))
    if not isinstance(result, (list, tuple)) or len(result) != count:
        return None
    values = [value if type(value) is float else number(value) for value in islice(result, count)]
    for value in values:
        if value is None or not isfinite(value):
            return None
    return values  # type: ignore[return-value]  # no None is left
