"""The controllers of a run, of speed and lane, by name; and any object with `acc_calculate`."""

from __future__ import annotations

from copy import deepcopy
from inspect import Parameter, signature
from math import inf, nan
from typing import TYPE_CHECKING, Any

from barc_sim.control.controller import read_term
from barc_sim.control.excitation import PRBS, CoastDown, Steps
from barc_sim.control.lane import LaneLaw, LaneLQR, PurePursuit, Stanley
from barc_sim.control.lqr import LQR
from barc_sim.control.mpc import MPC, SpeedMPC
from barc_sim.control.pid import PID
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.control.controller import Controller, Gain

#: By the name that `--controller-type` and the parameter `controller_type` take.
TYPES: Mapping[str, type[Controller]] = {
    'pid': PID,
    'lqr': LQR,
    'prbs': PRBS,
    'steps': Steps,
    'coast-down': CoastDown,
}
DEFAULT_TYPE = 'pid'
#: By the name that `--lane` and the parameter `lane_type` take.
LANE_TYPES: Mapping[str, type[LaneLaw]] = {
    'lqr': LaneLQR,
    'stanley': Stanley,
    'pure-pursuit': PurePursuit,
    'mpc': MPC,
    'speed-mpc': SpeedMPC,
}
DEFAULT_LANE = 'lqr'
#: The gains of all of them, by name.
GAINS: Mapping[str, Gain] = {
    name: gain for controller in TYPES.values() for name, gain in controller.gains.items()
}
#: The terms of all of them, by name.
TERMS: Mapping[str, str] = {
    name: meaning for controller in TYPES.values() for name, meaning in controller.terms.items()
}
_MEMBERS = ('gains', 'terms', 'output_min', 'output_max', 'saturated', 'reset')


def as_controller(controller: Any) -> Controller:  # noqa: ANN401 (any object of the user's)
    """Return `controller` itself if it is a whole `Controller`, an adapter around it otherwise.

    The lab's `acc_calculate(speed_reference, speed_current)` is enough; a third argument receives
    dt. Gains and terms are those that the object declares, or those of the PID.

    Raises
    ------
    UserError
        where it is no object with such a method.
    """
    if isinstance(controller, type):
        raise UserError(
            f'controller={controller.__name__} is a class; expected an object, such as '
            f'{controller.__name__}(kp=30.0, ki=200.0, kd=0.1)'
        )
    if not callable(getattr(controller, 'acc_calculate', None)):
        raise UserError(
            f'controller={controller!r} has no method '
            'acc_calculate(speed_reference, speed_current): expected an object with one'
        )
    takes_dt = _dt_argument(controller.acc_calculate) is not None
    if takes_dt and all(hasattr(controller, name) for name in _MEMBERS):
        return controller  # type: ignore[no-any-return]
    declared = getattr(controller, 'gains', PID.gains)
    gains = {name: gain for name, gain in declared.items() if hasattr(controller, name)}

    def new(**values: float) -> Any:  # noqa: ANN401 (as above)
        fresh = deepcopy(controller)
        for name, value in values.items():
            setattr(fresh, name, value)
        return fresh

    given = {name: getattr(controller, name) for name in gains}
    return Adapter(new, gains, given, getattr(controller, 'terms', PID.terms))


class Adapter:
    """A `Controller` around an object that may lack limits of its output and a reset.

    The terms are the object's attributes of these names, NaN where it has no such number;
    `saturated` is true where the output was cut here, or the object has it true.
    """

    def __init__(
        self,
        new: Callable[..., Any],
        gains: Mapping[str, Gain] = PID.gains,
        values: Mapping[str, float] | None = None,
        terms: Mapping[str, str] = PID.terms,
    ) -> None:
        """Take objects from `new`, called with the gains by name; a reset takes a fresh one."""
        self._new = new
        self.gains, self.terms = gains, terms
        defaults = {name: gain.default for name, gain in gains.items()}
        self.__dict__.update(defaults if values is None else values)
        self.output_min, self.output_max = -inf, inf
        self.reset()

    def reset(self) -> None:
        """Begin with a fresh object."""
        self._held = self._values()
        self._controller = self._make(self._held)
        self._dt = _dt_argument(self._controller.acc_calculate)
        self.__dict__.update(dict.fromkeys(self.terms, nan))
        self.saturated = False

    def acc_calculate(self, speed_reference: float, speed_current: float, dt: float) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        if (values := self._values()) != self._held:
            self._held = values
            self._set(values)
        speeds = speed_reference, speed_current
        if self._dt is None:
            raw = self._controller.acc_calculate(*speeds)
        elif self._dt:
            raw = self._controller.acc_calculate(*speeds, **{self._dt: dt})
        else:
            raw = self._controller.acc_calculate(*speeds, dt)
        output = min(max(raw, self.output_min), self.output_max)
        for name in self.terms:
            self.__dict__[name] = self._read(name)
        self.saturated = output != raw or self._read('saturated') == 1.0
        return float(output)

    def _values(self) -> dict[str, float]:
        return {name: self.__dict__[name] for name in self.gains}

    def _make(self, values: Mapping[str, float]) -> Any:  # noqa: ANN401 (of the type that `new` returns)
        return self._new(**values)

    def _set(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            setattr(self._controller, name, value)

    def _read(self, name: str) -> float:
        return read_term(self._controller, name)


def _dt_argument(method: Any) -> str | None:  # noqa: ANN401 (any object of the user's)
    """Return the name by which a method takes dt; empty: by position; None: it takes none."""
    accepted = signature(method)
    parameters = accepted.parameters
    if 'dt' in parameters and parameters['dt'].kind is not Parameter.POSITIONAL_ONLY:
        return 'dt'
    for arguments, answer in (((0.0, 0.0), None), ((0.0, 0.0, 0.0), '')):
        try:
            accepted.bind(*arguments)
        except TypeError:
            continue
        return answer
    raise UserError(
        f'acc_calculate takes ({", ".join(parameters)}): expected (speed_reference, speed_current)'
    )
