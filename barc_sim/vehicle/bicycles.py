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

from math import atan2, copysign, cos, sin, sqrt
from typing import Annotated, Any, NamedTuple

from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import limited
from barc_sim.interfaces.records import Command, VehicleState
from barc_sim.vehicle.bike_model import (
    BicycleState,
    Model,
    Vehicle,
    clamped_at_zero,
    motion,
    next_speed,
    resistance,
    slip_angle,
    step,
)
from barc_sim.vehicle.law import law
from barc_sim.vehicle.road import Inclines, theta_at

# Here, so that bike_model.py has nothing but the equations.
limited(Vehicle)
for _law in (slip_angle, resistance, clamped_at_zero, next_speed, step, motion):
    law(_law)

#: The names of the integrators, and what each is.
INTEGRATORS = {'euler': 'forward Euler', 'rk4': 'the classical Runge-Kutta method'}
#: The names of the bicycles, and what each is.
DYNAMICS = {'kinematic': 'tyres do not slip', 'dynamic': 'linear tyres'}


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


class Slip(NamedTuple):
    """The part of the dynamic bicycle's state that `BicycleState` does not have."""

    beta: float = 0.0  #: [rad] from the vehicle's axis to its velocity
    psi_dot: float = 0.0  #: [rad/s]


NO_SLIP = Slip()


@law
def slip_of(record: Any) -> Slip:  # noqa: ANN401 (a record of an array)
    """Return the slip in the fields of a record of an array, which `store_slip` has stored."""
    return Slip(record.beta, record.psi_dot)


@law
def store_slip(record: Any, slip: Slip) -> None:  # noqa: ANN401 (a record of an array)
    """Store the slip in a record, which has a field for each field of `Slip`."""
    record.beta = slip.beta
    record.psi_dot = slip.psi_dot


class Bicycle(NamedTuple):
    """A bicycle: its parameters, its equations and its integrator."""

    vehicle: Vehicle
    lateral: LateralParameters
    is_dynamic: bool  #: otherwise it is the kinematic one
    is_rk4: bool  #: otherwise the integrator is forward Euler


def bicycle_of(
    dynamics: str = 'kinematic',
    integrator: str = 'euler',
    vehicle: Vehicle | None = None,
    lateral: LateralParameters | None = None,
) -> Bicycle:
    """Return the bicycle of these names; UserError: a name is unknown."""
    if dynamics not in DYNAMICS:
        raise UserError(f'dynamics {dynamics!r} must be {" or ".join(map(repr, DYNAMICS))}')
    if integrator not in INTEGRATORS:
        raise UserError(f'integrator {integrator!r} must be {" or ".join(map(repr, INTEGRATORS))}')
    return Bicycle(
        vehicle or Vehicle(),
        lateral or LateralParameters(),
        is_dynamic=dynamics == 'dynamic',
        is_rk4=integrator == 'rk4',
    )


@law
def bicycle_step(
    bicycle: Bicycle,
    state: BicycleState,
    slip: Slip,
    command: Command,
    inclines: Inclines,
    stretch: int,
    ts: float,
) -> tuple[BicycleState, Slip]:
    """Return state and slip `ts` seconds later, with a constant `command`.

    The step begins on the stretch of the road of this number.
    """
    if bicycle.is_dynamic:
        return dynamic_step(bicycle, state, slip, command, inclines, stretch, ts)
    return kinematic_step(bicycle, state, command, inclines, stretch, ts), slip


@law
def bicycle_motion(bicycle: Bicycle, state: BicycleState, slip: Slip, servo: float) -> VehicleState:
    """Return the velocities in the vehicle's frame, at a steering angle of `servo` [rad]."""
    if bicycle.is_dynamic and is_slipping(bicycle, state, slip):
        return slipping_motion(state, slip)
    return motion(state, servo, bicycle.vehicle)


def model_step(
    model: Model, state: BicycleState, command: Command, theta: float, vehicle: Vehicle, ts: float
) -> BicycleState:
    """Return the state after a step of a user's own model, which has the arguments of `bikeFE`."""
    x, y, psi, v = model(
        state.x,
        state.y,
        state.psi,
        state.v,
        command.motor,
        command.servo,
        vehicle.air_drag_coeff,
        vehicle.mass,
        vehicle.friction,
        theta,
        ts,
        l_f=vehicle.l_f,
        l_r=vehicle.l_r,
        g=vehicle.gravity,
    )
    return BicycleState(x, y, psi, v)


# Along the road


@law
def acceleration(v: float, motor: float, sine: float, vehicle: Vehicle, direction: float) -> float:
    """Return dv/dt [m/s²] at speed `v` [m/s] on an incline with this sine.

    `direction` is the sign of the motion that the resistance opposes; 0: no resistance.
    """
    opposing = direction * resistance(v, vehicle)
    return motor - vehicle.gravity * sine - opposing / vehicle.mass


@law
def direction_of(v: float) -> float:
    """Return the sign of `v`, zero for zero."""
    return copysign(1.0, v) if v else 0.0


@law
def passes_zero(before: float, after: float) -> bool:
    """Return whether the sign of a speed changes in a step."""
    return after < 0.0 < before or before < 0.0 < after


# The kinematic bicycle


@law
def kinematic_step(
    bicycle: Bicycle,
    state: BicycleState,
    command: Command,
    inclines: Inclines,
    stretch: int,
    ts: float,
) -> BicycleState:
    """Return the state of the kinematic bicycle `ts` seconds later."""
    if not bicycle.is_rk4:
        return step(state, command, inclines.thetas[stretch], bicycle.vehicle, ts)

    vehicle = bicycle.vehicle
    after = _kinematic_rk4(vehicle, state, command, inclines, stretch, ts, direction_of(state.v))
    if not passes_zero(state.v, after.v):
        return after
    free = _kinematic_rk4(vehicle, state, command, inclines, stretch, ts, 0.0)
    return BicycleState(after.x, after.y, after.psi, clamped_at_zero(state.v, after.v, free.v))


@law
def kinematic_rates(
    vehicle: Vehicle, state: BicycleState, motor: float, beta: float, theta: float, direction: float
) -> BicycleState:
    """Return the derivatives by time of the state, the equations that `bikeFE` integrates.

    The car moves at an angle of `beta` [rad] to its axis. `direction` is the sign of the motion
    that the resistance opposes; 0: there is none.
    """
    course = state.psi + beta
    return BicycleState(
        state.v * cos(course),
        state.v * sin(course),
        state.v * (sin(beta) / vehicle.l_r),
        acceleration(state.v, motor, sin(theta), vehicle, direction),
    )


@law
def _kinematic_rk4(
    vehicle: Vehicle,
    state: BicycleState,
    command: Command,
    inclines: Inclines,
    stretch: int,
    ts: float,
    direction: float,
) -> BicycleState:
    """Return the state after a step by Runge-Kutta."""
    motor = command.motor
    beta = slip_angle(command.servo, vehicle.l_f, vehicle.l_r)
    k1 = kinematic_rates(vehicle, state, motor, beta, inclines.thetas[stretch], direction)

    at = _shifted_state(state, k1, 0.5 * ts)
    theta = theta_at(inclines, stretch, at.x)
    k2 = kinematic_rates(vehicle, at, motor, beta, theta, direction)

    at = _shifted_state(state, k2, 0.5 * ts)
    theta = theta_at(inclines, stretch, at.x)
    k3 = kinematic_rates(vehicle, at, motor, beta, theta, direction)

    at = _shifted_state(state, k3, ts)
    theta = theta_at(inclines, stretch, at.x)
    k4 = kinematic_rates(vehicle, at, motor, beta, theta, direction)

    return BicycleState(
        state.x + rk4_change(k1.x, k2.x, k3.x, k4.x, ts),
        state.y + rk4_change(k1.y, k2.y, k3.y, k4.y, ts),
        state.psi + rk4_change(k1.psi, k2.psi, k3.psi, k4.psi, ts),
        state.v + rk4_change(k1.v, k2.v, k3.v, k4.v, ts),
    )


@law
def _shifted_state(state: BicycleState, rates: BicycleState, t: float) -> BicycleState:
    """Return the state after `t` seconds of these rates."""
    return BicycleState(
        state.x + t * rates.x,
        state.y + t * rates.y,
        state.psi + t * rates.psi,
        state.v + t * rates.v,
    )


@law
def rk4_change(k1: float, k2: float, k3: float, k4: float, ts: float) -> float:
    """Return the change of a value in a step of `ts` seconds, from its four rates."""
    return ts / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


# The dynamic bicycle


@law
def is_slipping(bicycle: Bicycle, state: BicycleState, slip: Slip) -> bool:
    """Return whether the car is fast enough for the equations of the dynamic bicycle."""
    return state.v * cos(slip.beta) > bicycle.lateral.dynamic_above


@law
def slipping_motion(state: BicycleState, slip: Slip) -> VehicleState:
    """Return the velocities of the dynamic bicycle in the vehicle's frame."""
    return VehicleState(
        state.x,
        state.y,
        state.psi,
        state.v * cos(slip.beta),
        state.v * sin(slip.beta),
        slip.psi_dot,
    )


@law
def kinematic_slip(v: float, servo: float, vehicle: Vehicle) -> Slip:
    """Return the slip of the kinematic bicycle at speed `v` [m/s]."""
    beta = slip_angle(servo, vehicle.l_f, vehicle.l_r)
    return Slip(beta, v / vehicle.l_r * sin(beta))


@law
def dynamic_step(
    bicycle: Bicycle,
    state: BicycleState,
    slip: Slip,
    command: Command,
    inclines: Inclines,
    stretch: int,
    ts: float,
) -> tuple[BicycleState, Slip]:
    """Return state and slip of the dynamic bicycle `ts` seconds later."""
    vehicle = bicycle.vehicle
    if not is_slipping(bicycle, state, slip):
        after = kinematic_step(bicycle, state, command, inclines, stretch, ts)
        return after, kinematic_slip(after.v, command.servo, vehicle)

    before = slipping_motion(state, slip)
    direction = direction_of(before.v_x)
    end = _dynamic_end(bicycle, before, command, inclines, stretch, ts, direction)

    v_x = end.v_x
    if passes_zero(before.v_x, v_x):
        free = _dynamic_end(bicycle, before, command, inclines, stretch, ts, 0.0)
        v_x = clamped_at_zero(before.v_x, v_x, free.v_x)

    if v_x <= bicycle.lateral.dynamic_above:
        v = v_x / cos(slip_angle(command.servo, vehicle.l_f, vehicle.l_r))
        return BicycleState(end.x, end.y, end.psi, v), kinematic_slip(v, command.servo, vehicle)
    v = sqrt(v_x * v_x + end.v_y * end.v_y)
    return BicycleState(end.x, end.y, end.psi, v), Slip(atan2(end.v_y, v_x), end.psi_dot)


@law
def dynamic_rates(
    bicycle: Bicycle, at: VehicleState, command: Command, theta: float, direction: float
) -> VehicleState:
    """Return the derivatives by time of a motion of the dynamic bicycle.

    `direction` is the sign of the motion that the resistance opposes; 0: there is none.
    """
    vehicle = bicycle.vehicle
    lateral = bicycle.lateral
    cos_servo = cos(command.servo)
    sin_servo = sin(command.servo)

    # The lateral forces of the tyres [N].
    front_y = at.v_y + vehicle.l_f * at.psi_dot
    rear_y = at.v_y - vehicle.l_r * at.psi_dot
    front = lateral.front_stiffness * (command.servo - atan2(front_y, at.v_x))
    rear = -lateral.rear_stiffness * atan2(rear_y, at.v_x)
    turning = vehicle.l_f * front * cos_servo - vehicle.l_r * rear

    v = sqrt(at.v_x * at.v_x + at.v_y * at.v_y)
    free = acceleration(v, command.motor, sin(theta), vehicle, direction)
    cos_psi = cos(at.psi)
    sin_psi = sin(at.psi)
    return VehicleState(
        at.v_x * cos_psi - at.v_y * sin_psi,
        at.v_x * sin_psi + at.v_y * cos_psi,
        at.psi_dot,
        free - front * sin_servo / vehicle.mass + at.v_y * at.psi_dot,
        (front * cos_servo + rear) / vehicle.mass - at.v_x * at.psi_dot,
        turning / lateral.yaw_inertia,
    )


@law
def _dynamic_end(
    bicycle: Bicycle,
    begin: VehicleState,
    command: Command,
    inclines: Inclines,
    stretch: int,
    ts: float,
    direction: float,
) -> VehicleState:
    """Return the motion after a step, by the bicycle's integrator."""
    k1 = dynamic_rates(bicycle, begin, command, inclines.thetas[stretch], direction)
    if not bicycle.is_rk4:
        return _shifted_motion(begin, k1, ts)

    at = _shifted_motion(begin, k1, 0.5 * ts)
    theta = theta_at(inclines, stretch, at.x)
    k2 = dynamic_rates(bicycle, at, command, theta, direction)

    at = _shifted_motion(begin, k2, 0.5 * ts)
    theta = theta_at(inclines, stretch, at.x)
    k3 = dynamic_rates(bicycle, at, command, theta, direction)

    at = _shifted_motion(begin, k3, ts)
    theta = theta_at(inclines, stretch, at.x)
    k4 = dynamic_rates(bicycle, at, command, theta, direction)

    return VehicleState(
        begin.x + rk4_change(k1.x, k2.x, k3.x, k4.x, ts),
        begin.y + rk4_change(k1.y, k2.y, k3.y, k4.y, ts),
        begin.psi + rk4_change(k1.psi, k2.psi, k3.psi, k4.psi, ts),
        begin.v_x + rk4_change(k1.v_x, k2.v_x, k3.v_x, k4.v_x, ts),
        begin.v_y + rk4_change(k1.v_y, k2.v_y, k3.v_y, k4.v_y, ts),
        begin.psi_dot + rk4_change(k1.psi_dot, k2.psi_dot, k3.psi_dot, k4.psi_dot, ts),
    )


@law
def _shifted_motion(motion: VehicleState, rates: VehicleState, t: float) -> VehicleState:
    """Return the motion after `t` seconds of these rates."""
    return VehicleState(
        motion.x + t * rates.x,
        motion.y + t * rates.y,
        motion.psi + t * rates.psi,
        motion.v_x + t * rates.v_x,
        motion.v_y + t * rates.v_y,
        motion.psi_dot + t * rates.psi_dot,
    )


#: The longest stable step of an integrator, as a multiple of the shortest time constant.
_LONGEST = {'euler': 2.0, 'rk4': 2.785}


def check_step(lateral: LateralParameters, vehicle: Vehicle, ts: float, integrator: str) -> None:
    """Raise UserError if steps of `ts` seconds are too long for the dynamic bicycle.

    The lateral motion decays fastest at the minimum speed; an integrator is unstable if a step is
    longer than a multiple of its time constant (Rajamani, section 2.3).
    """
    v = lateral.dynamic_above
    front = lateral.front_stiffness
    rear = lateral.rear_stiffness
    turning = (vehicle.l_f**2 * front + vehicle.l_r**2 * rear) / lateral.yaw_inertia
    settling = v / max((front + rear) / vehicle.mass, turning)
    if ts > _LONGEST[integrator] * settling:
        raise UserError(
            f'steps of {ts:g} s are too long for the dynamic bicycle at {v:g} m/s, where it '
            f'settles in {1e3 * settling:.0f} ms: raise the parameter rate or dynamic_above'
        )
