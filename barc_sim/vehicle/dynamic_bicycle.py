"""The dynamic bicycle with linear tyres, over the same road and against the same forces.

    dv_x/dt   = a + F_ext/m - F_f sin δ / m + v_y ψ'    F_f = C_f (δ - atan2(v_y + l_f ψ', v_x))
    dv_y/dt   = (F_f cos δ + F_r) / m - v_x ψ'          F_r = -C_r atan2(v_y - l_r ψ', v_x)
    dψ'/dt    = (l_f F_f cos δ - l_r F_r) / I_z

(Kong et al., IV 2015, eq. 2; for small angles Rajamani, "Vehicle Dynamics and Control", section
2.3.) Tyres are linear up to a few degrees of slip, about 4 m/s² across on a dry road.

The slip angles have no meaning at a standstill, and the equations become stiff on the way there:
their rates grow with 1/v_x. Slower than `LateralParameters.dynamic_above`, and in reverse, the car
is the kinematic bicycle, as in the single-track model of Althoff et al., "CommonRoad: Composable
benchmarks for motion planning on roads", IV 2017. On the way up v_y and ψ' begin at the values of
the kinematic bicycle; on the way down they take these values in one step.
"""

from __future__ import annotations

from math import atan2, cos, hypot, sin
from typing import TYPE_CHECKING

from barc_sim.errors import UserError
from barc_sim.vehicle.bike_model import Command, Motion, State, Vehicle, slip_angle
from barc_sim.vehicle.integrators import integrator as named
from barc_sim.vehicle.kinematic_bicycle import (
    KinematicBicycle,
    acceleration,
    direction_of,
    with_static_resistance,
)
from barc_sim.vehicle.lateral_dynamics import LateralParameters, eigenvalues

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.vehicle.integrators import Vector
    from barc_sim.vehicle.kinematic_bicycle import Grade


class DynamicBicycle:
    """Makes steps of the dynamic bicycle; it keeps slip angle and yaw rate, which `State` lacks.

    Examples
    --------
    >>> road, turn, car = (lambda x: 0.0), Command(servo=0.3), DynamicBicycle(integrator='rk4')
    >>> after = car.step(State(v=8.0), turn, road, Vehicle(), 0.02)
    >>> round(after.psi, 4)
    0.0023
    """

    is_lab = False

    def __init__(self, lateral: LateralParameters | None = None, integrator: str = 'euler') -> None:
        """Begin without slip and yaw rate.

        Raises
        ------
        UserError
            where there is no integrator of that name.
        """
        self.lateral = lateral or LateralParameters()
        self._integrator = named(integrator)
        self._kinematic = KinematicBicycle(integrator)
        self._beta = self._psi_dot = 0.0

    def check(self, vehicle: Vehicle, ts: float) -> None:
        """Raise UserError where steps of `ts` seconds are too long for the integrator.

        They are where it makes a motion grow that decays, at the speed at which it begins.
        """
        v = self.lateral.dynamic_above
        for rate in eigenvalues(vehicle, self.lateral, v):
            if rate.real < 0.0 and self._integrator.amplification(rate * ts) > 1.0:
                raise UserError(
                    f'steps of {ts:g} s are too long for the dynamic bicycle at {v:g} m/s, where '
                    f'it settles in {1e3 / abs(rate):.0f} ms: raise the parameter rate or '
                    'dynamic_above'
                )

    def step(self, state: State, held: Command, grade: Grade, vehicle: Vehicle, ts: float) -> State:
        """Return the state `ts` seconds later, with acceleration and steering `held`."""
        if not self._dynamic(state):
            after = self._kinematic.step(state, held, grade, vehicle, ts)
            self._set_kinematic_slip(after.v, held.servo, vehicle)
            return after
        begin = self._motion(state)

        def end(direction: float) -> Motion:
            slopes = rates(held, grade, vehicle, self.lateral, direction)
            return Motion(*self._integrator.step(slopes, begin, ts))

        found = end(direction_of(begin.v_x))
        v_x = with_static_resistance(begin.v_x, found.v_x, lambda: end(0.0).v_x)
        if v_x <= self.lateral.dynamic_above:
            v = v_x / cos(slip_angle(held.servo, vehicle.l_f, vehicle.l_r))
            self._set_kinematic_slip(v, held.servo, vehicle)
        else:
            v = hypot(v_x, found.v_y)
            self._beta, self._psi_dot = atan2(found.v_y, v_x), found.psi_dot
        return State(found.x, found.y, found.psi, v)

    def reset(self) -> None:
        """Reset slip and yaw rate to zero."""
        self._beta = self._psi_dot = 0.0

    def motion(self, state: State, servo: float, vehicle: Vehicle) -> Motion:
        """Return the velocities in the vehicle's frame; `servo` [rad] counts at low speed only."""
        if self._dynamic(state):
            return self._motion(state)
        return self._kinematic.motion(state, servo, vehicle)

    def _dynamic(self, state: State) -> bool:
        return state.v * cos(self._beta) > self.lateral.dynamic_above

    def _motion(self, state: State) -> Motion:
        x, y, psi, v = state
        return Motion(x, y, psi, v * cos(self._beta), v * sin(self._beta), self._psi_dot)

    def _set_kinematic_slip(self, v: float, servo: float, vehicle: Vehicle) -> None:
        """Slip and turn as the kinematic bicycle does."""
        self._beta = slip_angle(servo, vehicle.l_f, vehicle.l_r)
        self._psi_dot = v / vehicle.l_r * sin(self._beta)


def rates(
    held: Command,
    grade: Grade,
    vehicle: Vehicle,
    lateral: LateralParameters,
    direction: float = 1.0,
) -> Callable[[Vector], Vector]:
    """Return the derivative by time of a `Motion`, with acceleration and steering `held`.

    `direction` is the sign of the motion that the resistance opposes; 0: there is none.

    Examples
    --------
    >>> flat, held = (lambda x: 0.0), Command(motor=2.0)
    >>> derivative = rates(held, flat, Vehicle(), LateralParameters())
    >>> round(derivative((0.0, 0.0, 0.0, 8.0, 0.0, 0.0))[3], 2)
    2.0
    """
    motor, servo = held
    l_f, l_r, mass = vehicle.l_f, vehicle.l_r, vehicle.mass
    cos_servo, sin_servo = cos(servo), sin(servo)

    def derivative(motion: Vector) -> Vector:
        x, _, psi, v_x, v_y, psi_dot = motion
        front = lateral.front_stiffness * (servo - atan2(v_y + l_f * psi_dot, v_x))
        rear = -lateral.rear_stiffness * atan2(v_y - l_r * psi_dot, v_x)
        free = acceleration(hypot(v_x, v_y), motor, grade(x), vehicle, direction)
        return (
            v_x * cos(psi) - v_y * sin(psi),
            v_x * sin(psi) + v_y * cos(psi),
            psi_dot,
            free - front * sin_servo / mass + v_y * psi_dot,
            (front * cos_servo + rear) / mass - v_x * psi_dot,
            (l_f * front * cos_servo - l_r * rear) / lateral.yaw_inertia,
        )

    return derivative
