"""Poses of ROS from states and lines, and back.

Frames are those of REP-103 and REP-105: x forward, y to the left, z up. `odom` is level, and has
its origin where the road's distance is zero. `base_link` lies on the road's surface under the
centre of mass. The road is level across: its grade first pitches the frame, then the car's heading
turns it within the surface. Uphill is a negative pitch.
"""

from __future__ import annotations

from math import atan2, cos, nan, radians, sin
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion

from barc_sim.vehicle.bike_model import BicycleState

if TYPE_CHECKING:
    from barc_interfaces.msg import ZDynBkMdl
    from std_msgs.msg import Header

    from barc_sim.vehicle.road import Road

_NORM_TOLERANCE = 1e-3  #: of the squared norm of a quaternion that is a rotation


def to_pose(state: ZDynBkMdl, road: Road) -> Pose:
    """Return the pose of `base_link` in `odom`; the state's `x` is along the road's surface.

    The orientation is a rotation by -theta about y, then by psi about the rotated z.
    """
    theta = radians(road.grade_deg(state.x))
    c_theta = cos(theta / 2.0)
    s_theta = sin(theta / 2.0)
    c_psi = cos(state.psi / 2.0)
    s_psi = sin(state.psi / 2.0)

    position = Point(x=road.horizontal(state.x), y=state.y, z=road.elevation(state.x))
    orientation = Quaternion(
        x=-s_theta * s_psi, y=-s_theta * c_psi, z=c_theta * s_psi, w=c_theta * c_psi
    )
    return Pose(position=position, orientation=orientation)


def to_state_at_rest(pose: Pose, road: Road) -> BicycleState:
    """Return the state of a car at rest at `pose` on the map; not a number: there is none.

    It undoes `to_pose`: `x` of the state is along the road's surface, and the heading is in
    its plane. Of the orientation only the direction counts in which the car points on the map.
    """
    x = road.along(pose.position.x)
    theta = radians(road.grade_deg(x))

    q = pose.orientation
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    if not abs(norm - 1.0) < _NORM_TOLERANCE:
        return BicycleState(x, pose.position.y, nan)
    east = 1.0 - 2.0 * (q.y * q.y + q.z * q.z)
    north = 2.0 * (q.x * q.y + q.w * q.z)
    return BicycleState(x, pose.position.y, atan2(north, east / cos(theta)))


def to_poses(header: Header, poses: Any) -> dict[str, Any]:  # noqa: ANN401 (x, y, psi: arrays)
    """Return the field `poses` of a Path."""
    path = []
    for x, y, psi in zip(*poses, strict=True):
        half = 0.5 * float(psi)
        pose = Pose(position=Point(x=float(x), y=float(y)))
        pose.orientation = Quaternion(z=sin(half), w=cos(half))
        path.append(PoseStamped(header=header, pose=pose))
    return {'poses': path}
