"""The car in space: where it is on the hills, how its wheels stand and roll (pure).

Frames are those of REP-103 and REP-105, x forward, y to the left, z up. `odom` is level, and has
its origin where the road's distance is zero. `base_link` lies on the road's surface under the
centre of mass; the road is level across, so that its grade pitches the frame before the car's
heading turns it in the surface: uphill is a negative pitch.
"""

from __future__ import annotations

from math import atan2, cos, hypot, radians, sin
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from barc_sim.vehicle.bike_model import Motion, Vehicle
    from barc_sim.vehicle.road import Road

# Of the wheels, as they are drawn (barc_sim.figures).
HALF_TRACK = 0.86  #: [m] from the car's middle to a wheel
WHEEL_RADIUS = 0.36  #: [m]
WHEEL_WIDTH = 0.26  #: [m]
#: Front left, front right, rear left, rear right: which axle (front is true) and side (left is 1).
WHEELS = ((True, 1.0), (True, -1.0), (False, 1.0), (False, -1.0))


class Quaternion(NamedTuple):
    """A rotation; of length one."""

    x: float
    y: float
    z: float
    w: float


class Pose(NamedTuple):
    """Of `base_link` in `odom`."""

    x: float  #: [m] on the map, not along the surface
    y: float  #: [m]
    z: float  #: [m]
    theta: float  #: [rad] the grade there
    psi: float  #: [rad] heading, in the road's surface
    orientation: Quaternion  #: made from the two

    def carry(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """Return where in `odom` a point of `base_link` is [m]."""
        c_psi, s_psi = cos(self.psi), sin(self.psi)
        c_theta, s_theta = cos(self.theta), sin(self.theta)
        along, across = x * c_psi - y * s_psi, x * s_psi + y * c_psi
        return (
            self.x + along * c_theta - z * s_theta,
            self.y + across,
            self.z + along * s_theta + z * c_theta,
        )


class Wheel(NamedTuple):
    """How one of the `WHEELS` stands and rolls."""

    x: float  #: [m] its middle, from the centre of mass
    y: float  #: [m]
    steering: float  #: [rad] to the left
    speed: float  #: [rad/s] about its axle, positive forward


class Acceleration(NamedTuple):
    """Of the centre of mass, in the vehicle's frame."""

    x: float = 0.0  #: [m/s²]
    y: float = 0.0  #: [m/s²]
    psi: float = 0.0  #: [rad/s²]


def orientation(theta: float, psi: float) -> Quaternion:
    """Return how a car of heading `psi` [rad] lies on a road of grade `theta` [rad].

    It is the product of a turn by -theta about y and one by psi about the z so turned.
    """
    c_theta, s_theta = cos(theta / 2.0), sin(theta / 2.0)
    c_psi, s_psi = cos(psi / 2.0), sin(psi / 2.0)
    return Quaternion(x=-s_theta * s_psi, y=-s_theta * c_psi, z=c_theta * s_psi, w=c_theta * c_psi)


def pose(motion: Motion, road: Road) -> Pose:
    """Return where a car is whose `x` runs along the surface of `road`."""
    theta = radians(road.grade_deg(motion.x))
    return Pose(
        x=road.horizontal(motion.x),
        y=motion.y,
        z=road.elevation(motion.x),
        theta=theta,
        psi=motion.psi,
        orientation=orientation(theta, motion.psi),
    )


def wheels(motion: Motion, servo: float, vehicle: Vehicle) -> tuple[Wheel, ...]:
    """Return the `WHEELS` of a car that is steered by `servo` [rad].

    The bicycle's one front wheel stands for two that are turned about the same centre: the inner
    one by more (Ackermann). Each rolls with the velocity that the ground has under it.
    """
    base = vehicle.l_f + vehicle.l_r
    found = []
    for front, side in WHEELS:
        x, y = vehicle.l_f if front else -vehicle.l_r, side * HALF_TRACK
        steering = 0.0
        if front:
            steering = atan2(base * sin(servo), base * cos(servo) - y * sin(servo))
        along = motion.v_x - motion.psi_dot * y
        across = motion.v_y + motion.psi_dot * x
        speed = (along * cos(steering) + across * sin(steering)) / WHEEL_RADIUS
        found.append(Wheel(x, y, steering, speed))
    return tuple(found)


def acceleration(before: Motion, now: Motion, dt: float) -> Acceleration:
    """Return what has led from one state to the next, `dt` seconds later; without gravity's share.

    It is that of the centre of mass over the ground: in the vehicle's frame, which turns, the
    change of velocity and psi_dot times the velocity across.
    """
    return Acceleration(
        x=(now.v_x - before.v_x) / dt - now.psi_dot * now.v_y,
        y=(now.v_y - before.v_y) / dt + now.psi_dot * now.v_x,
        psi=(now.psi_dot - before.psi_dot) / dt,
    )


def goes_on(before: Motion, now: Motion, dt: float) -> bool:
    """Return whether a car can have got from one state to the other in `dt` seconds.

    If not, it was put back to the start. The margins leave room for measurement noise.
    """
    way = hypot(now.x - before.x, now.y - before.y)
    fastest = max(abs(before.v_x), abs(now.v_x), abs(before.v_y), abs(now.v_y))
    return (
        dt > 0.0
        and way <= 2.0 * fastest * dt + 1.0
        and abs(now.v_x - before.v_x) <= 100.0 * dt + 1.0
    )
