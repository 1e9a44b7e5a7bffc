"""The kinematic bicycle over hills: `bikeFE`, and the records of its arguments and results.

The equations are those of the ME131 lab "Simulating kinematic models in ROS" (after Kong et al.,
"Kinematic and dynamic vehicle models for autonomous driving control design", IV 2015, eq. 1),
integrated with forward Euler. Positions run along the road's surface.

The law of air drag and rolling friction is `resistance`; `surroundings` gives its two parts for the
log. `next_speed` is one step of the longitudinal motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import atan, cos, sin, tan
from typing import TYPE_CHECKING, Annotated, NamedTuple

from barc_sim.interfaces.records import Command, Surroundings, VehicleState

if TYPE_CHECKING:
    from barc_sim.vehicle.road import RoadPoint

L_F = 1.5
L_R = 1.5
GRAVITY = 9.8
# The car's dimensions, as it is drawn and as its wheels roll; no force depends on them.
HALF_TRACK = 0.86  #: [m] from the centre line to a wheel
WHEEL_RADIUS = 0.36  #: [m]
WHEEL_WIDTH = 0.26  #: [m]

#: A function with the arguments and the result of `bikeFE`: a user's model.
Model = Callable[..., Sequence[float]]


class Vehicle(NamedTuple):
    """The vehicle's parameters; the defaults are the lab's.

    Each has its meaning and its limits. `vehicle/bicycles.py` applies `limited`, which makes the
    constructor check them, so that this module has nothing but the equations.

    Examples
    --------
    >>> Vehicle(mass=1200.0).mass
    1200.0
    """

    mass: Annotated[float, 'm, the mass [kg]', 1.0, 1e6] = 2000.0
    air_drag_coeff: Annotated[float, 'a_0, air drag [N s²/m²]', 0.0, 1e3] = 0.01308
    friction: Annotated[float, 'F_f, rolling resistance [N]', 0.0, 1e6] = 0.01711
    l_f: Annotated[float, 'centre of mass to front axle [m]', 0.01, 100.0] = L_F
    l_r: Annotated[float, 'centre of mass to rear axle [m]', 0.01, 100.0] = L_R
    gravity: Annotated[float, 'g [m/s²]', 0.0, 100.0] = GRAVITY


_LABS_CAR = Vehicle()


class BicycleState(NamedTuple):
    """The vehicle's state: its centre of mass, in the frame of the road's surface."""

    x: float = 0.0  #: [m] along the road's surface
    y: float = 0.0  #: [m] to the left of the road's x axis
    psi: float = 0.0  #: [rad] heading, counter-clockwise from x
    v: float = 0.0  #: [m/s] speed in the direction psi + beta


def slip_angle(d_f: float, l_f: float = L_F, l_r: float = L_R) -> float:
    """Return β [rad], the angle from the vehicle's axis to its velocity, for steering `d_f`."""
    return atan(l_r / (l_f + l_r) * tan(d_f))


def resistance(v: float, vehicle: Vehicle) -> float:
    """Return the force [N] of air drag and rolling friction at speed `v` [m/s].

    `surroundings` has its two parts.
    """
    return vehicle.air_drag_coeff * v * v + vehicle.friction


def clamped_at_zero(before: float, after: float, without_resistance: float) -> float:
    """Return the speed [m/s] after a step in which a speed passes through zero.

    Resistance slows the vehicle to a standstill and never pushes it backwards: the next speed is
    zero, or the speed without resistance if this passes through zero, too.
    """
    if before > 0.0:
        return max(after, min(without_resistance, 0.0))
    return min(after, max(without_resistance, 0.0))


def next_speed(v: float, a: float, gravity_force: float, vehicle: Vehicle, ts: float) -> float:
    """Return the speed [m/s] one forward-Euler step of `ts` seconds after `v`.

    `a` [m/s²] is the commanded acceleration, and `gravity_force` [N] acts along the road, positive
    forwards.
    """
    opposing = resistance(v, vehicle)
    if v <= 0.0:
        opposing = -opposing if v < 0.0 else 0.0
    after = v + ts * (a + (gravity_force - opposing) / vehicle.mass)
    if after < 0.0 < v or v < 0.0 < after:
        after = clamped_at_zero(v, after, v + ts * (a + gravity_force / vehicle.mass))
    return after


def bikeFE(  # noqa: N802 (the lab's name)
    x: float,
    y: float,
    psi: float,
    v: float,
    a: float,
    d_f: float,
    a0: float,
    m: float,
    Ff: float,  # noqa: N803 (the lab's name)
    theta: float,
    ts: float,
    *,
    l_f: float = L_F,
    l_r: float = L_R,
    g: float = GRAVITY,
) -> list[float]:
    """Return `[x, y, psi, v]` one forward-Euler step of `ts` seconds later.

    It is `step` with the lab's arguments. A run calls `step`, not this function: as the `model` of
    a plant or a scenario, `bikeFE` stands for no model of the user's.

    Parameters
    ----------
    x, y
        [m] position along the road's surface, and to the left.
    psi
        [rad] heading.
    v
        [m/s] speed.
    a
        [m/s²] acceleration command.
    d_f
        [rad] front steering angle.
    a0
        [N s²/m²] air drag coefficient.
    m
        [kg] mass.
    Ff
        [N] rolling resistance.
    theta
        [rad] incline of the road, positive uphill.
    ts
        [s] time step.
    l_f, l_r
        [m] centre of mass to the front and to the rear axle.
    g
        [m/s²] gravity.

    Examples
    --------
    >>> bikeFE(0.0, 0.0, 0.0, 8.0, 1.0, 0.0, a0=0.0, m=2000.0, Ff=0.0, theta=0.0, ts=0.02)
    [0.16, 0.0, 0.0, 8.02]
    """
    # Any numbers, as in the lab: `_replace` checks nothing.
    vehicle = _LABS_CAR._replace(
        mass=m, air_drag_coeff=a0, friction=Ff, l_f=l_f, l_r=l_r, gravity=g
    )
    return [*step(BicycleState(x, y, psi, v), Command(a, d_f), theta, vehicle, ts)]


def step(
    state: BicycleState, command: Command, theta: float, vehicle: Vehicle, ts: float
) -> BicycleState:
    """Return the state one forward-Euler step later, on an incline of `theta` [rad].

        β = atan(l_r / (l_f + l_r) · tan δ)
        x⁺ = x + ts · v · cos(ψ + β)
        y⁺ = y + ts · v · sin(ψ + β)
        ψ⁺ = ψ + ts · v / l_r · sin β
        v⁺ = v + ts · (a + (-m · g · sin θ - resistance) / m)

    Resistance acts against the motion and never pushes the vehicle backwards: see `next_speed`.
    """
    beta = slip_angle(command.servo, vehicle.l_f, vehicle.l_r)
    way = ts * state.v
    direction = state.psi + beta
    gravity_force = -vehicle.mass * vehicle.gravity * sin(theta)
    return BicycleState(
        state.x + way * cos(direction),
        state.y + way * sin(direction),
        state.psi + way / vehicle.l_r * sin(beta),
        next_speed(state.v, command.motor, gravity_force, vehicle, ts),
    )


def motion(state: BicycleState, servo: float, vehicle: Vehicle) -> VehicleState:
    """Return the velocities in the vehicle's frame, at a steering angle of `servo` [rad]."""
    beta = slip_angle(servo, vehicle.l_f, vehicle.l_r)
    return VehicleState(
        state.x,
        state.y,
        state.psi,
        v_x=state.v * cos(beta),
        v_y=state.v * sin(beta),
        psi_dot=state.v / vehicle.l_r * sin(beta),
    )


def surroundings(v: float, road: RoadPoint, vehicle: Vehicle) -> Surroundings:
    """Return the forces at speed `v` [m/s] on a point of the road; arrays, for arrays of both."""
    direction = (v > 0.0) * 1.0 - (v < 0.0)
    friction = -vehicle.friction * direction
    drag = -vehicle.air_drag_coeff * v * v * direction
    gravity = -vehicle.mass * vehicle.gravity * road.sin_theta
    return Surroundings(road.theta_deg, road.elevation, friction, drag, gravity)
