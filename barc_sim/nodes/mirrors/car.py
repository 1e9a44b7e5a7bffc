"""The car in space: its pose on the hills, and the angles and speeds of its wheels (without ROS).

Frames are those of REP-103 and REP-105, x forward, y to the left, z up. `odom` is level, and has
its origin where the road's distance is zero. `base_link` lies on the road's surface under the
centre of mass; the road is level across, so that its grade pitches the frame before the car's
heading turns it in the surface: uphill is a negative pitch.
"""

from __future__ import annotations

from math import atan2, cos, hypot, radians, sin
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.vehicle.bike_model import HALF_TRACK, WHEEL_RADIUS

if TYPE_CHECKING:
    from barc_sim.vehicle.bike_model import Motion, Vehicle
    from barc_sim.vehicle.road import Road

# The wheels as barc_sim.figures draws them.
#: Front left, front right, rear left, rear right: whether at the front, and the side (left is 1).
WHEELS = ((True, 1.0), (True, -1.0), (False, 1.0), (False, -1.0))


class Quaternion(NamedTuple):
    """A rotation, of length one."""

    x: float
    y: float
    z: float
    w: float


class Pose(NamedTuple):
    """The pose of `base_link` in `odom`.

    Examples
    --------
    >>> from barc_sim.vehicle.bike_model import Motion
    >>> from barc_sim.vehicle.road import Road
    >>> uphill = pose(Motion(60.0, 0.0, 0.0, 8.0, 0.0, 0.0), Road.named('lab'))
    >>> [round(value, 2) for value in uphill.to_odom(1.0, 0.0, 0.0)]
    [60.68, 0.0, 3.3]
    """

    x: float  #: [m] on the map, not along the surface
    y: float  #: [m]
    z: float  #: [m]
    theta: float  #: [rad] the grade there
    psi: float  #: [rad] heading, in the road's surface
    orientation: Quaternion  #: from theta and psi

    def to_odom(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """Return the coordinates in `odom` of a point of `base_link` [m]."""
        c_psi, s_psi = cos(self.psi), sin(self.psi)
        c_theta, s_theta = cos(self.theta), sin(self.theta)
        along, across = x * c_psi - y * s_psi, x * s_psi + y * c_psi
        return (
            self.x + along * c_theta - z * s_theta,
            self.y + across,
            self.z + along * s_theta + z * c_theta,
        )


class Wheel(NamedTuple):
    """The place, angle and speed of one of the `WHEELS`."""

    x: float  #: [m] of its centre, from the centre of mass
    y: float  #: [m]
    steering: float  #: [rad] to the left
    speed: float  #: [rad/s] about its axle, positive forward


class Acceleration(NamedTuple):
    """The acceleration of the centre of mass, in the vehicle's frame."""

    x: float = 0.0  #: [m/s²]
    y: float = 0.0  #: [m/s²]
    psi: float = 0.0  #: [rad/s²]


def orientation(theta: float, psi: float) -> Quaternion:
    """Return the orientation of a car with heading `psi` [rad] on a road of grade `theta` [rad].

    It is a rotation by -theta about y, then one by psi about the rotated z.

    Examples
    --------
    >>> from math import radians
    >>> [round(part, 3) for part in orientation(radians(10.0), radians(90.0))]
    [-0.062, -0.062, 0.704, 0.704]
    """
    c_theta, s_theta = cos(theta / 2.0), sin(theta / 2.0)
    c_psi, s_psi = cos(psi / 2.0), sin(psi / 2.0)
    return Quaternion(x=-s_theta * s_psi, y=-s_theta * c_psi, z=c_theta * s_psi, w=c_theta * c_psi)


def pose(motion: Motion, road: Road) -> Pose:
    """Return the pose of a car, whose `x` is the distance along the surface of `road`.

    Examples
    --------
    >>> from barc_sim.vehicle.bike_model import Motion
    >>> from barc_sim.vehicle.road import Road
    >>> there = pose(Motion(60.0, 0.0, 0.0, 8.0, 0.0, 0.0), Road.named('lab'))
    >>> round(there.x, 2), round(there.z, 2)
    (59.7, 3.47)
    """
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
    """Return the `WHEELS` of a car with the steering angle `servo` [rad].

    The bicycle's front wheel stands for two that turn about the same centre, the inner one by more
    (Ackermann). Each wheel rolls without slip along its own direction.

    Examples
    --------
    >>> from barc_sim.vehicle.bike_model import Motion, Vehicle
    >>> turning = Motion(0.0, 0.0, 0.0, v_x=8.0, v_y=0.0, psi_dot=0.8)
    >>> [round(wheel.steering, 3) for wheel in wheels(turning, 0.3, Vehicle())]
    [0.327, 0.277, 0.0, 0.0]
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
    """Return the acceleration over the ground between two states, `dt` seconds apart.

    In the vehicle's frame, which rotates, it is the change of velocity plus the cross product of
    psi_dot and the velocity. Gravity is not part of it.

    Examples
    --------
    >>> from barc_sim.vehicle.bike_model import Motion
    >>> circling = Motion(0.0, 0.0, 0.0, v_x=8.0, v_y=0.0, psi_dot=0.5)
    >>> acceleration(circling, circling, 0.02)
    Acceleration(x=0.0, y=4.0, psi=0.0)
    """
    return Acceleration(
        x=(now.v_x - before.v_x) / dt - now.psi_dot * now.v_y,
        y=(now.v_y - before.v_y) / dt + now.psi_dot * now.v_x,
        psi=(now.psi_dot - before.psi_dot) / dt,
    )


def is_continuous(before: Motion, now: Motion, dt: float) -> bool:
    """Return whether a car can move from one state to the next in `dt` seconds.

    If not, it was reset. The margins leave room for measurement noise.

    Examples
    --------
    >>> from barc_sim.vehicle.bike_model import Motion
    >>> before = Motion(90.0, 0.0, 0.0, 8.0, 0.0, 0.0)
    >>> is_continuous(before, before._replace(x=90.16), 0.02)
    True
    >>> is_continuous(before, before._replace(x=0.0), 0.02)
    False
    """
    way = hypot(now.x - before.x, now.y - before.y)
    fastest = max(abs(before.v_x), abs(now.v_x), abs(before.v_y), abs(now.v_y))
    return (
        dt > 0.0
        and way <= 2.0 * fastest * dt + 1.0
        and abs(now.v_x - before.v_x) <= 100.0 * dt + 1.0
    )
