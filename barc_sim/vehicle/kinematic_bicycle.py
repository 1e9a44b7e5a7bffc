"""The kinematic bicycle over hills, by the lab's forward Euler or by Runge-Kutta."""

from __future__ import annotations

from math import copysign, cos, sin
from typing import TYPE_CHECKING

from barc_sim.errors import UserError
from barc_sim.vehicle.bike_model import (
    Input,
    Model,
    State,
    Vehicle,
    bikeFE,
    motion,
    slip_angle,
    step,
)
from barc_sim.vehicle.integrators import integrator as named

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.vehicle.integrators import Vector

    #: Distance along the road [m] to incline [rad].
    Grade = Callable[[float], float]


def along_the_road(
    v: float, motor: float, theta: float, vehicle: Vehicle, direction: float
) -> float:
    """Return what motor, road and air make of it, dv/dt [m/s²], on an incline of `theta` [rad].

    `direction` is the sign of the motion that the resistance opposes; 0: there is none.
    """
    resistance = vehicle.air_drag_coeff * v * v + vehicle.friction
    return motor - vehicle.gravity * sin(theta) - direction * resistance / vehicle.mass


def direction_of(v: float) -> float:
    """Return the sign of `v`, zero for zero."""
    return copysign(1.0, v) if v else 0.0


def resisted(v: float, v_next: float, unresisted: Callable[[], float]) -> float:
    """Return the speed after a step from `v`, by `bikeFE`'s rule where it passes through zero.

    Resistance does not push the car backwards: `v_next` is what it would make of the speed,
    `unresisted` returns what the step without it does.
    """
    if v_next < 0.0 < v:
        return max(v_next, min(unresisted(), 0.0))
    if v < 0.0 < v_next:
        return min(v_next, max(unresisted(), 0.0))
    return v_next


class KinematicBicycle:
    """Steps a state by `bikeFE` or a model called like it, or by `rk4`."""

    def __init__(self, integrator: str = 'euler', model: Model = bikeFE) -> None:
        """Take an integrator by its name.

        Raises
        ------
        UserError
            where there is none of that name, or it is to integrate what makes its own steps.
        """
        self._integrator = named(integrator)
        self._model = model if integrator == 'euler' else None
        if not self._model and model is not bikeFE:
            raise UserError(
                f'integrator {integrator!r} does not go with a model of your own, which makes its '
                "steps itself: leave the integrator at 'euler'"
            )

    def step(self, state: State, held: Input, grade: Grade, vehicle: Vehicle, ts: float) -> State:
        """Return the state `ts` seconds later, with acceleration and steering `held`."""
        if self._model:
            return step(state, held, grade(state.x), vehicle, ts, self._model)

        def after(direction: float) -> State:
            rates = _rates(held, grade, vehicle, direction)
            return State(*self._integrator.step(rates, state, ts))

        found = after(direction_of(state.v))
        return found._replace(v=resisted(state.v, found.v, lambda: after(0.0).v))

    def forget(self) -> None:
        """Begin anew from any state; what the step needs is all in it."""

    #: `bike_model.motion`: the velocities follow from state and steering alone.
    motion = staticmethod(motion)


def _rates(
    held: Input, grade: Grade, vehicle: Vehicle, direction: float
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
            along_the_road(v, held.motor, grade(x), vehicle, direction),
        )

    return rates
