"""Answers each state with a command: what the node `controller` computes, without ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.control.adapter import as_controller
from barc_sim.control.pid import ACCELERATION_LIMIT, FIRST_DT, NO_LIMIT, SPEED_REFERENCE
from barc_sim.control.types import DEFAULT_TYPE, TYPES
from barc_sim.errors import UserError
from barc_sim.vehicle.parameters import Parameter

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.control.controller import Controller

    #: Takes a function that returns a sentence, so that a suppressed warning costs nothing.
    Warn = Callable[[Callable[[], str]], None]

SPEEDS = (-100.0, 100.0)  #: [m/s]
_FASTEST = 1e6  #: [m/s] A faster state is refused.
_NANOSECONDS = 1_000_000_000
TYPE = Parameter(
    'controller_type', DEFAULT_TYPE, f'which controller: {", ".join(TYPES)}', read_only=True
)
_PARAMETERS = [
    Parameter('speed_reference', SPEED_REFERENCE, 'the speed to hold [m/s]', SPEEDS),
    Parameter(
        'subtract_error',
        default=False,
        description='whether to control the true speed, z_vhcl minus ez_vhcl, not the measured',
    ),
]


class Answer(NamedTuple):
    """What a controller computed for a state."""

    reference: float  #: [m/s]
    speed: float  #: [m/s] as the controller was given it
    acceleration: float  #: [m/s²]


class CruiseControl:
    """A controller with its parameters; its dt is the difference of the states' stamps.

    Attributes
    ----------
    controller
        What computes; `reset` and `configure` change it.
    values
        The parameters by name.

    Examples
    --------
    >>> cruise = CruiseControl(None, 'pid', print, print)
    >>> cruise.configure({each.name: each.default for each in cruise.parameters()})
    >>> cruise.answer(stamp=0, speed=7.75)
    Answer(reference=8.0, speed=7.75, acceleration=7.5)
    """

    def __init__(self, controller: Controller | None, kind: str, refuse: Warn, warn: Warn) -> None:
        """Use `controller`, or the one of the type `kind`; anything with `acc_calculate` will do.

        `refuse` takes why a state is refused, and `warn` what else is odd.

        Raises
        ------
        UserError
            where there is no such type.
        """
        if controller is None and kind not in TYPES:
            raise UserError(
                f'parameter controller_type of controller is {kind!r}: expected '
                f'{" or ".join(TYPES)}'
            )
        self.controller = TYPES[kind]() if controller is None else as_controller(controller)
        self.values: dict[str, Any] = {}
        self._refuse, self._warn = refuse, warn
        self._previous: int | None = None

    def parameters(self, acceleration_limit: float = ACCELERATION_LIMIT) -> list[Parameter]:
        """Return the declarations of the parameters: gains first.

        `acceleration_limit` [m/s²] is the default of that parameter.
        """
        gains = [
            Parameter(
                name,
                float(getattr(self.controller, name)),
                f'{gain.meaning} [{gain.unit}]',
                gain.between,
            )
            for name, gain in self.controller.gains.items()
        ]
        limit = Parameter(
            'acceleration_limit',
            acceleration_limit,
            'greatest acceleration commanded, either way [m/s²]',
            (0.01, NO_LIMIT),
        )
        return [*gains, limit, *_PARAMETERS]

    def configure(self, values: Mapping[str, Any]) -> None:
        """Set parameters."""
        self.values.update(values)
        controller = self.controller
        for name in controller.gains:
            setattr(controller, name, self.values[name])
        controller.output_max = self.values['acceleration_limit']
        controller.output_min = -controller.output_max

    def reset(self) -> None:
        """Begin anew."""
        self.controller.reset()
        self._previous = None

    def answer(self, stamp: int, speed: float) -> Answer | None:
        """Return the answer to the state stamped `stamp` [ns]; None if its speed is refused."""
        if not abs(speed) <= _FASTEST:  # NaN, too
            self._refuse(lambda: f'a state whose speed is {speed} m/s')
            return None
        dt = FIRST_DT
        if self._previous is not None:
            dt = (stamp - self._previous) / _NANOSECONDS
            if dt < 0.0:
                back = -dt
                self._warn(lambda: f'time went back by {back:g} s: the controller is reset')
                self.controller.reset()
                dt = FIRST_DT
        self._previous = stamp
        reference = float(self.values['speed_reference'])
        return Answer(reference, speed, self.controller.acc_calculate(reference, speed, dt))
