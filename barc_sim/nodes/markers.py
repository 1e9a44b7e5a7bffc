"""Markers of RViz: the car, and the surface of its road or track."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from barc_sim.ros.conversions import to_header
from barc_sim.ros.poses import to_poses

if TYPE_CHECKING:
    from geometry_msgs.msg import Pose

    from barc_sim.vehicle.road import Road
    from barc_sim.vehicle.track import Track

_BLUE = ColorRGBA(r=0.0, g=0.447, b=0.698, a=1.0)
_SKY = ColorRGBA(r=0.337, g=0.706, b=0.914, a=1.0)
_SURFACE = ColorRGBA(r=0.49, g=0.467, b=0.416, a=1.0)
_PAINT = ColorRGBA(r=0.9, g=0.9, b=0.9, a=1.0)
_LENGTH = 4.4  #: [m] of the car
_ROAD_WIDTH = 6.0  #: [m]
_LINE_WIDTH = 0.12  #: [m]
_MARGIN = 200.0  #: [m] of road before the first stretch's end and after the last stretch's start


def car_markers(pose: Pose, header: Header) -> MarkerArray:
    """Return the car, a body with a cabin, at the pose of its `base_link`."""
    body = _marker(header, Marker.CUBE, Vector3(x=_LENGTH, y=1.76, z=0.9), _BLUE)
    cabin = _marker(header, Marker.CUBE, Vector3(x=0.48 * _LENGTH, y=1.4, z=0.44), _SKY)
    q = pose.orientation
    for marker, x, z in ((body, 0.0, 0.5), (cabin, -0.2, 1.1)):
        # The vector (x, 0, z) of the car, turned by the quaternion.
        marker.pose.position = Point(
            x=pose.position.x + x * (1 - 2 * (q.y**2 + q.z**2)) + 2 * z * (q.x * q.z + q.w * q.y),
            y=pose.position.y + 2 * x * (q.x * q.y + q.w * q.z) + 2 * z * (q.y * q.z - q.w * q.x),
            z=pose.position.z + 2 * x * (q.x * q.z - q.w * q.y) + z * (1 - 2 * (q.x**2 + q.y**2)),
        )
        marker.pose.orientation = q
    return _numbered('car', [body, cabin])


def road_markers(road: Road, frame: str) -> MarkerArray:
    """Return the road's surface, and its centre line."""
    half = _ROAD_WIDTH / 2.0
    first = min(road.starts[0], 0.0) - _MARGIN
    last = max(road.starts[-1], 0.0) + _MARGIN
    distances = [first, *road.starts[1:], last]

    left: list[Point] = []
    right: list[Point] = []
    middle: list[Point] = []
    for distance in distances:
        x = road.horizontal(distance)
        z = road.elevation(distance)
        left.append(Point(x=x, y=half, z=z))
        right.append(Point(x=x, y=-half, z=z))
        middle.append(Point(x=x, y=0.0, z=z))
    return _surface('road', frame, left, right, middle)


def track_markers(track: Track, frame: str) -> MarkerArray:
    """Return a track's surface, and its centre line."""
    left, right, middle = (_points(line) for line in track.lines())
    return _surface('track', frame, left, right, middle)


def _points(line: Any) -> list[Point]:  # noqa: ANN401 (x, y, psi: arrays)
    poses = to_poses(Header(), line)['poses']
    return [each.pose.position for each in poses]


def _surface(
    name: str, frame: str, left: list[Point], right: list[Point], middle: list[Point]
) -> MarkerArray:
    """Return markers of the surface between two edges, and of the line in the middle."""
    header = to_header(0, frame)
    triangles: list[Point] = []
    quads = zip(pairwise(left), pairwise(right), strict=True)
    for (left_start, left_end), (right_start, right_end) in quads:
        triangles += [right_start, right_end, left_start]
        triangles += [left_start, right_end, left_end]
    surface = _marker(header, Marker.TRIANGLE_LIST, Vector3(x=1.0, y=1.0, z=1.0), _SURFACE)
    surface.points = triangles

    line = _marker(header, Marker.LINE_STRIP, Vector3(x=_LINE_WIDTH), _PAINT)
    line.points = middle
    line.pose.position.z = 0.01
    return _numbered(name, [surface, line])


def _marker(header: Header, kind: int, scale: Vector3, colour: ColorRGBA) -> Marker:
    return Marker(header=header, type=kind, action=Marker.ADD, scale=scale, color=colour)


def _numbered(namespace: str, markers: list[Marker]) -> MarkerArray:
    for number, marker in enumerate(markers):
        marker.ns = namespace
        marker.id = number
    return MarkerArray(markers=markers)
