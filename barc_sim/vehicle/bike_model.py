"""The kinematic bicycle over hills: `bikeFE`, and records over the same arithmetic.

The equations are those of the ME131 lab "Simulating kinematic models in ROS" (after Kong et al.,
"Kinematic and dynamic vehicle models for autonomous driving control design", IV 2015, eq. 1),
integrated with forward Euler. Positions run along the road's surface.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import atan, copysign, cos, sin, tan
from typing import NamedTuple

L_F = 1.5
L_R = 1.5
GRAVITY = 9.8

#: What is called as `bikeFE` is, and returns x, y, psi and v of the next step.
Model = Callable[..., Sequence[float]]


class Vehicle(NamedTuple):
    """The vehicle's parameters; the defaults are the lab's."""

    mass: float = 2000.0  #: [kg]
    air_drag_coeff: float = 0.01308  #: [N s²/m²] a_0
    friction: float = 0.01711  #: [N] F_f, rolling resistance
    l_f: float = L_F  #: [m] centre of mass to the front axle
    l_r: float = L_R  #: [m] centre of mass to the rear axle
    gravity: float = GRAVITY  #: [m/s²]


class State(NamedTuple):
    """The vehicle's state: its centre of mass, in the frame of the road's surface."""

    x: float = 0.0  #: [m] along the road's surface
    y: float = 0.0  #: [m] to the left of the road's x axis
    psi: float = 0.0  #: [rad] heading, counter-clockwise from x
    v: float = 0.0  #: [m/s] speed in the direction psi + beta


class Input(NamedTuple):
    """The command to the actuators."""

    motor: float = 0.0  #: [m/s²] acceleration
    servo: float = 0.0  #: [rad] front steering angle, positive to the left


class Forces(NamedTuple):
    """What the road and the air do to the vehicle, positive forwards; their sum is F_ext."""

    friction: float  #: [N]
    drag: float  #: [N]
    gravity: float  #: [N]


class Motion(NamedTuple):
    """The state as `z_vhcl` tells it: velocities in the vehicle's frame."""

    x: float  #: [m]
    y: float  #: [m]
    psi: float  #: [rad]
    v_x: float  #: [m/s] along the vehicle's axis
    v_y: float  #: [m/s] to the vehicle's left
    psi_dot: float  #: [rad/s]


def slip_angle(d_f: float, l_f: float = L_F, l_r: float = L_R) -> float:
    """Return β [rad], the angle from the vehicle's axis to its velocity, for steering `d_f`."""
    return atan(l_r / (l_f + l_r) * tan(d_f))


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

    Resistance slows the vehicle to a standstill and never pushes it backwards: in a step that
    passes through zero speed, the next speed is zero, or what command and gravity alone make of
    it where they pass through zero, too.

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
    """
    beta = slip_angle(d_f, l_f, l_r)
    resistance = a0 * v * v + Ff
    push = -m * g * sin(theta)
    f_ext = push - copysign(resistance, v) if v else push
    v_next = v + ts * (a + f_ext / m)
    v_unresisted = v + ts * (a + push / m)
    if v > 0.0:
        v_next = max(v_next, min(v_unresisted, 0.0))
    elif v < 0.0:
        v_next = min(v_next, max(v_unresisted, 0.0))
    return [
        x + ts * v * cos(psi + beta),
        y + ts * v * sin(psi + beta),
        psi + ts * v / l_r * sin(beta),
        v_next,
    ]


def step(
    state: State,
    command: Input,
    theta: float,
    vehicle: Vehicle,
    ts: float,
    model: Model = bikeFE,
) -> State:
    """Return the state `ts` seconds later, on an incline of `theta` [rad], by `model`."""
    x, y, psi, v = model(
        *state,
        *command,
        vehicle.air_drag_coeff,
        vehicle.mass,
        vehicle.friction,
        theta,
        ts,
        l_f=vehicle.l_f,
        l_r=vehicle.l_r,
        g=vehicle.gravity,
    )
    return State(x, y, psi, v)


def motion(state: State, servo: float, vehicle: Vehicle) -> Motion:
    """Return the velocities in the vehicle's frame while it is steered by `servo` [rad]."""
    beta = slip_angle(servo, vehicle.l_f, vehicle.l_r)
    return Motion(
        x=state.x,
        y=state.y,
        psi=state.psi,
        v_x=state.v * cos(beta),
        v_y=state.v * sin(beta),
        psi_dot=state.v / vehicle.l_r * sin(beta),
    )


def forces(v: float, theta: float, vehicle: Vehicle) -> Forces:
    """Return the forces at speed `v` [m/s] on an incline of `theta` [rad]."""
    direction = copysign(1.0, v) if v else 0.0
    return Forces(
        friction=-vehicle.friction * direction,
        drag=-vehicle.air_drag_coeff * v * v * direction,
        gravity=-vehicle.mass * vehicle.gravity * sin(theta),
    )
