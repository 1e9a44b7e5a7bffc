"""The bicycles: the kinematic one, and the dynamic one with linear tyres, over the same road.

The kinematic bicycle steps by the lab's forward Euler or by Runge-Kutta. The dynamic one has slip
angles at its tyres, and the same forces along the road::

    dv_x/dt   = a + F_ext/m - F_f sin δ / m + v_y ψ'    F_f = C_f (δ - atan2(v_y + l_f ψ', v_x))
    dv_y/dt   = (F_f cos δ + F_r) / m - v_x ψ'          F_r = -C_r atan2(v_y - l_r ψ', v_x)
    dψ'/dt    = (l_f F_f cos δ - l_r F_r) / I_z

(Kong et al., IV 2015, eq. 2; for small angles Rajamani, "Vehicle Dynamics and Control", section
2.3.) Tyres are linear up to a few degrees of slip, about 4 m/s² of lateral acceleration on a dry
road.

The slip angles have no meaning at a standstill, and the equations are stiff at low speed: their
rates grow with 1/v_x. Slower than `LateralParameters.dynamic_above`, and in reverse, the car is the
kinematic bicycle, as in the single-track model of Althoff et al., "CommonRoad: Composable
benchmarks for motion planning on roads", IV 2017. When the car becomes faster than this limit, v_y
and ψ' start from the values of the kinematic bicycle; when it becomes slower, they take these
values in one step.

The integrators are after Hairer, Nørsett and Wanner, "Solving Ordinary Differential Equations I",
ch. II.1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from math import atan2, copysign, cos, hypot, sin
from typing import Annotated, Any, NamedTuple

from barc_sim.errors import UserError, limited
from barc_sim.vehicle.bike_model import (
    Command,
    Model,
    Motion,
    State,
    Vehicle,
    bikeFE,
    clamped_at_zero,
    motion,
    next_speed,
    resistance,
    slip_angle,
    step,
)
from barc_sim.vehicle.law import law

# Here: bike_model.py, as it is handed in, imports nothing of barc_sim.
limited(Vehicle)
for _law in (slip_angle, resistance, clamped_at_zero, next_speed, step, motion):
    law(_law)

#: Distance along the road [m] to incline [rad].
Grade = Callable[[float], float]
Vector = Sequence[float]
#: The derivative of a state by time, if only the state changes in a step.
Rates = Callable[[Vector], Vector]


def euler(rates: Rates, state: Vector, ts: float) -> Vector:
    """Return the state `ts` seconds later, by forward Euler."""
    return _shifted(state, rates(state), ts)


def rk4(rates: Rates, state: Vector, ts: float) -> Vector:
    """Return the state `ts` seconds later, by the classical Runge-Kutta method."""
    k1 = rates(state)
    k2 = rates(_shifted(state, k1, 0.5 * ts))
    k3 = rates(_shifted(state, k2, 0.5 * ts))
    k4 = rates(_shifted(state, k3, ts))
    return [
        value + ts / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        for value, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True)
    ]


def _shifted(state: Vector, rate: Vector, ts: float) -> Vector:
    return [value + ts * slope for value, slope in zip(state, rate, strict=True)]


INTEGRATORS = {'euler': euler, 'rk4': rk4}


@limited
class LateralParameters(NamedTuple):
    """Parameters of the dynamic bicycle beyond `Vehicle`; the defaults understeer mildly."""

    yaw_inertia: Annotated[float, 'I_z of the dynamic bicycle [kg m²]', 1.0, 1e7] = 4000.0
    front_stiffness: Annotated[float, "C_f, front axle's tyres [N/rad]", 1.0, 1e8] = 120e3
    rear_stiffness: Annotated[float, "C_r, rear axle's tyres [N/rad]", 1.0, 1e8] = 160e3
    dynamic_above: Annotated[
        float,
        'minimum speed [m/s] of the dynamic bicycle; slower and in reverse it is the kinematic one',
        0.1,
        100.0,
    ] = 3.0


def acceleration(v: float, motor: float, sine: float, vehicle: Vehicle, direction: float) -> float:
    """Return dv/dt [m/s²] at speed `v` [m/s] on an incline with this sine.

    `direction` is the sign of the motion that the resistance opposes; 0: no resistance.
    """
    opposing = direction * resistance(v, vehicle)
    return motor - vehicle.gravity * sine - opposing / vehicle.mass


def direction_of(v: float) -> float:
    """Return the sign of `v`, zero for zero."""
    return copysign(1.0, v) if v else 0.0


def with_static_resistance(v: float, after: float, free: Callable[[], float]) -> float:
    """Return the speed after a step from `v` to `after`, by the rule of `clamped_at_zero`.

    `free` returns the speed after a step without resistance; it is called only if the sign changes.
    """
    return clamped_at_zero(v, after, free()) if after < 0.0 < v or v < 0.0 < after else after


class KinematicBicycle:
    """Steps a state by `bikeFE`, by a model with the same arguments, or by `rk4`."""

    def __init__(self, integrator: str = 'euler', model: Model = bikeFE) -> None:
        """Take an integrator by name: 'euler', or 'rk4', which needs the equations of `bikeFE`."""
        if integrator not in INTEGRATORS:
            raise UserError(f"integrator {integrator!r} must be 'euler' or 'rk4'")
        self.integrator = INTEGRATORS[integrator]
        self._model = model if integrator == 'euler' else None
        self.is_lab = self._model is bikeFE  #: `bikeFE` makes the steps
        if not self._model and model is not bikeFE:
            raise UserError(
                f'integrator {integrator!r} cannot be used with a model of your own, which makes '
                "its steps itself: leave the integrator at 'euler'"
            )

    def step(self, state: State, held: Command, grade: Grade, vehicle: Vehicle, ts: float) -> State:
        """Return the state `ts` seconds later, with acceleration and steering `held`."""
        if self.is_lab:
            return step(state, held, grade(state.x), vehicle, ts)
        if self._model:
            resisting = vehicle.air_drag_coeff, vehicle.mass, vehicle.friction
            numbers = *state[:4], *held, *resisting, grade(state.x), ts
            others = {'l_f': vehicle.l_f, 'l_r': vehicle.l_r, 'g': vehicle.gravity}
            x, y, psi, v = self._model(*numbers, **others)
            return State(x, y, psi, v)

        beta = slip_angle(held.servo, vehicle.l_f, vehicle.l_r)
        turn = sin(beta) / vehicle.l_r

        def after(direction: float) -> State:
            rates = kinematic_rates(held.motor, beta, turn, grade, vehicle, direction)
            return State(*self.integrator(rates, state, ts))

        stepped = after(direction_of(state.v))
        return stepped._replace(v=with_static_resistance(state.v, stepped.v, lambda: after(0.0).v))

    def reset(self) -> None:
        """Do nothing: a step depends only on the state."""

    #: `bike_model.motion`: the velocities follow from state and steering alone.
    motion = staticmethod(motion)


def kinematic_rates(
    motor: float,
    beta: float,
    turn: float,
    grade: Grade,
    vehicle: Vehicle,
    direction: float,
    functions: Any = math,  # noqa: ANN401 (a namespace)
) -> Rates:
    """Return the derivative of (x, y, psi, v), the equations that `bikeFE` integrates.

    The car moves at an angle of `beta` [rad] to its axis, and turns by `turn` [rad] per metre. All
    numbers may be arrays, with NumPy's sin, cos, hypot and atan2 as `functions`.
    """
    sin, cos = functions.sin, functions.cos

    def rates(state: Vector) -> Vector:
        x, _, psi, v, *_ = state
        course = psi + beta
        return (
            v * cos(course),
            v * sin(course),
            v * turn,
            acceleration(v, motor, sin(grade(x)), vehicle, direction),
        )

    return rates


class DynamicBicycle:
    """Steps the dynamic bicycle; it keeps slip angle and yaw rate, which `State` does not have."""

    is_lab = False

    def __init__(self, lateral: LateralParameters | None = None, integrator: str = 'euler') -> None:
        """Begin without slip and yaw rate."""
        self.lateral = lateral or LateralParameters()
        self._kinematic = KinematicBicycle(integrator)
        self._integrator = self._kinematic.integrator
        self._beta = self._psi_dot = 0.0

    def step(self, state: State, held: Command, grade: Grade, vehicle: Vehicle, ts: float) -> State:
        """Return the state `ts` seconds later, with acceleration and steering `held`."""
        if not self._dynamic(state):
            after = self._kinematic.step(state, held, grade, vehicle, ts)
            self._set_kinematic_slip(after.v, held.servo, vehicle)
            return after
        begin = self._motion(state)

        def end(direction: float) -> Motion:
            slopes = rates(held, grade, vehicle, self.lateral, direction)
            return Motion(*self._integrator(slopes, begin, ts))

        moved = end(direction_of(begin.v_x))
        v_x = with_static_resistance(begin.v_x, moved.v_x, lambda: end(0.0).v_x)
        if v_x <= self.lateral.dynamic_above:
            v = v_x / cos(slip_angle(held.servo, vehicle.l_f, vehicle.l_r))
            self._set_kinematic_slip(v, held.servo, vehicle)
        else:
            v = hypot(v_x, moved.v_y)
            self._beta, self._psi_dot = atan2(moved.v_y, v_x), moved.psi_dot
        return State(moved.x, moved.y, moved.psi, v)

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
        """Set slip and yaw rate to those of the kinematic bicycle."""
        self._beta = slip_angle(servo, vehicle.l_f, vehicle.l_r)
        self._psi_dot = v / vehicle.l_r * sin(self._beta)


#: The longest stable step of an integrator, as a multiple of the shortest time constant.
_LONGEST = {'euler': 2.0, 'rk4': 2.785}


def check_step(lateral: LateralParameters, vehicle: Vehicle, ts: float, integrator: str) -> None:
    """Raise UserError if steps of `ts` seconds are too long for the dynamic bicycle.

    The lateral motion decays fastest at the minimum speed; an integrator is unstable if a step is
    longer than a multiple of its time constant (Rajamani, section 2.3).
    """
    i_z, c_f, c_r, v = lateral
    turning = (vehicle.l_f**2 * c_f + vehicle.l_r**2 * c_r) / i_z
    settling = v / max((c_f + c_r) / vehicle.mass, turning)
    if ts > _LONGEST[integrator] * settling:
        raise UserError(
            f'steps of {ts:g} s are too long for the dynamic bicycle at {v:g} m/s, where it '
            f'settles in {1e3 * settling:.0f} ms: raise the parameter rate or dynamic_above'
        )


#: The names of the bicycles, and what each is.
DYNAMICS = {'kinematic': 'tyres do not slip', 'dynamic': 'linear tyres'}


def bicycle(
    dynamics: str,
    integrator: str = 'euler',
    model: Model = bikeFE,
    lateral: LateralParameters | None = None,
) -> KinematicBicycle | DynamicBicycle:
    """Return the bicycle of this name; UserError: a name is unknown, or names contradict."""
    if dynamics not in DYNAMICS:
        raise UserError(f'dynamics {dynamics!r} must be {" or ".join(map(repr, DYNAMICS))}')
    if dynamics == 'kinematic':
        return KinematicBicycle(integrator, model)
    if model is not bikeFE:
        raise UserError(
            f'dynamics {dynamics!r} and a model of your own contradict each other: leave dynamics '
            "at 'kinematic', or leave out the model"
        )
    return DynamicBicycle(lateral, integrator)


def rates(
    held: Command,
    grade: Grade,
    vehicle: Vehicle,
    lateral: LateralParameters,
    direction: float = 1.0,
    functions: Any = math,  # noqa: ANN401 (a namespace)
) -> Rates:
    """Return the derivative by time of a `Motion`, with acceleration and steering `held`.

    `direction` is the sign of the motion that the resistance opposes; 0: there is none. All
    numbers may be arrays, as in `kinematic_rates`.
    """
    sin, cos, hypot, atan2 = functions.sin, functions.cos, functions.hypot, functions.atan2
    motor, servo = held
    l_f, l_r, mass = vehicle.l_f, vehicle.l_r, vehicle.mass
    cos_servo, sin_servo = cos(servo), sin(servo)

    def derivative(motion: Vector) -> Vector:
        x, _, psi, v_x, v_y, psi_dot = motion
        front = lateral.front_stiffness * (servo - atan2(v_y + l_f * psi_dot, v_x))
        rear = -lateral.rear_stiffness * atan2(v_y - l_r * psi_dot, v_x)
        free = acceleration(hypot(v_x, v_y), motor, sin(grade(x)), vehicle, direction)
        return (
            v_x * cos(psi) - v_y * sin(psi),
            v_x * sin(psi) + v_y * cos(psi),
            psi_dot,
            free - front * sin_servo / mass + v_y * psi_dot,
            (front * cos_servo + rear) / mass - v_x * psi_dot,
            (l_f * front * cos_servo - l_r * rear) / lateral.yaw_inertia,
        )

    return derivative
