"""The kinematic bicycle over hills, by the lab's forward Euler or by Runge-Kutta."""

from __future__ import annotations

from math import copysign, cos, sin
from typing import TYPE_CHECKING

from barc_sim.errors import UserError
from barc_sim.vehicle.bike_model import (
    Command,
    Model,
    State,
    Vehicle,
    bikeFE,
    clamped_at_zero,
    motion,
    resistance,
    slip_angle,
    step,
    step_by,
)
from barc_sim.vehicle.integrators import integrator as named

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.vehicle.integrators import Vector

    #: Distance along the road [m] to incline [rad].
    Grade = Callable[[float], float]


def acceleration(v: float, motor: float, theta: float, vehicle: Vehicle, direction: float) -> float:
    """Return dv/dt [m/s²] at speed `v` [m/s] on an incline of `theta` [rad].

    `direction` is the sign of the motion that the resistance opposes; 0: no resistance.

    Examples
    --------
    >>> round(acceleration(8.0, 0.0, 0.1, Vehicle(), 1.0), 3)
    -0.979
    """
    opposing = direction * resistance(v, vehicle)
    return motor - vehicle.gravity * sin(theta) - opposing / vehicle.mass


def direction_of(v: float) -> float:
    """Return the sign of `v`, zero for zero.

    Examples
    --------
    >>> direction_of(-3.0)
    -1.0
    """
    return copysign(1.0, v) if v else 0.0


def with_static_resistance(v: float, after: float, free: Callable[[], float]) -> float:
    """Return the speed after a step from `v` to `after`, by the rule of `clamped_at_zero`.

    `free` makes the step without resistance; it is called only where the speed changes its sign.

    Examples
    --------
    >>> with_static_resistance(0.01, -0.02, free=lambda: 0.005)
    0.0
    """
    return clamped_at_zero(v, after, free()) if after < 0.0 < v or v < 0.0 < after else after


class KinematicBicycle:
    """Steps a state by `bikeFE` or a model called like it, or by `rk4`.

    Examples
    --------
    >>> road, turn = (lambda x: 0.0), Command(servo=0.3)
    >>> after = KinematicBicycle('rk4').step(State(v=8.0), turn, road, Vehicle(), 0.02)
    >>> round(after.psi, 4)
    0.0163
    """

    def __init__(self, integrator: str = 'euler', model: Model = bikeFE) -> None:
        """Take an integrator by its name.

        Raises
        ------
        UserError
            where there is none of that name, or `model` comes with another than 'euler'.
        """
        self._integrator = named(integrator)
        self._model = model if integrator == 'euler' else None
        if not self._model and model is not bikeFE:
            raise UserError(
                f'integrator {integrator!r} does not go with a model of your own, which makes its '
                "steps itself: leave the integrator at 'euler'"
            )

    @property
    def is_lab(self) -> bool:
        """Whether `bikeFE` makes the steps."""
        return self._model is bikeFE

    def step(self, state: State, held: Command, grade: Grade, vehicle: Vehicle, ts: float) -> State:
        """Return the state `ts` seconds later, with acceleration and steering `held`."""
        if self.is_lab:
            return step(state, held, grade(state.x), vehicle, ts)
        if self._model:
            return step_by(self._model, state, held, grade(state.x), vehicle, ts)

        def after(direction: float) -> State:
            rates = _rates(held, grade, vehicle, direction)
            return State(*self._integrator.step(rates, state, ts))

        found = after(direction_of(state.v))
        return found._replace(v=with_static_resistance(state.v, found.v, lambda: after(0.0).v))

    def reset(self) -> None:
        """Do nothing: a step depends on the state alone."""

    #: `bike_model.motion`: the velocities follow from state and steering alone.
    motion = staticmethod(motion)


def _rates(
    held: Command, grade: Grade, vehicle: Vehicle, direction: float
) -> Callable[[Vector], Vector]:
    """Return the derivative of (x, y, psi, v): the equations of which `bikeFE` is a step."""
    beta = slip_angle(held.servo, vehicle.l_f, vehicle.l_r)
    turn = sin(beta) / vehicle.l_r

    def rates(state: Vector) -> Vector:
        x, _, psi, v = state
        return (
            v * cos(psi + beta),
            v * sin(psi + beta),
            v * turn,
            acceleration(v, held.motor, grade(x), vehicle, direction),
        )

    return rates
