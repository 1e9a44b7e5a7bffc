"""The car and its road as markers, to scale."""

from __future__ import annotations

from itertools import pairwise
from math import sqrt
from typing import TYPE_CHECKING, NamedTuple

from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from barc_sim.nodes.mirrors.car import Quaternion, orientation
from barc_sim.nodes.mirrors.messages import ODOM, stamp
from barc_sim.ros.conversions import to_header
from barc_sim.vehicle.bike_model import WHEEL_RADIUS, WHEEL_WIDTH

if TYPE_CHECKING:
    from barc_sim.nodes.mirrors.ride import MirroredState
    from barc_sim.vehicle.bike_model import Vehicle
    from barc_sim.vehicle.road import Road

_BLUE, _SKY = (0.0, 0.447, 0.698), (0.337, 0.706, 0.914)
_INK, _SURFACE, _PAINT = (0.133, 0.133, 0.133), (0.49, 0.467, 0.416), (0.9, 0.9, 0.9)
_OVERHANG = 0.7  #: [m] from an axle to the bumper
_ROAD_WIDTH = 6.0  #: [m]
_LINE_WIDTH = 0.12  #: [m]
_MARGIN = 200.0  #: [m] of road before the end of its first stretch, and after the start of its last


class _Box(NamedTuple):
    """A box of the body."""

    centre: tuple[float, float, float]  #: [m] in `base_link`
    size: tuple[float, float, float]  #: [m]
    colour: tuple[float, float, float]


class CarMirror:
    """The car as a body, a cabin and four wheels that steer.

    Examples
    --------
    >>> from barc_sim.nodes.mirrors.ride import Ride
    >>> from barc_sim.vehicle.bike_model import Motion, Vehicle
    >>> from barc_sim.vehicle.road import Road
    >>> state = Ride(Road.named('lab'), Vehicle()).update(0, Motion(60.0, *5 * [0.0]), servo=0.0)
    >>> body, *_ = CarMirror('car2/', Vehicle()).of(state).markers
    >>> body.header.frame_id, round(body.pose.position.z, 2)
    ('car2/odom', 3.97)
    """

    def __init__(self, prefix: str, vehicle: Vehicle) -> None:
        """Draw `vehicle`, in the frame with `prefix` before its name."""
        middle = (vehicle.l_f - vehicle.l_r) / 2.0
        length = vehicle.l_f + vehicle.l_r + 2.0 * _OVERHANG
        self._boxes = (
            _Box((middle, 0.0, 0.5), (length, 1.76, 0.56), _BLUE),
            _Box((middle - 0.2, 0.0, 1.0), (0.48 * length, 1.4, 0.44), _SKY),
        )
        frame = prefix + ODOM
        bodies = [_marker(frame, Marker.CUBE, box.size, box.colour) for box in self._boxes]
        tyre = (2.0 * WHEEL_RADIUS, 2.0 * WHEEL_RADIUS, WHEEL_WIDTH)
        tyres = [_marker(frame, Marker.CYLINDER, tyre, _INK) for _ in range(4)]
        self._bodies, self._tyres = bodies, tyres
        self._message = MarkerArray(markers=_numbered('car', [*bodies, *tyres]))

    def of(self, state: MirroredState) -> MarkerArray:
        """Return the message of a state; the next call fills it anew."""
        pose = state.pose
        for marker, box in zip(self._bodies, self._boxes, strict=True):
            _place(marker, state, box.centre, pose.orientation)
        for marker, wheel in zip(self._tyres, state.wheels, strict=True):
            turned = orientation(pose.theta, pose.psi + wheel.steering)
            _place(marker, state, (wheel.x, wheel.y, WHEEL_RADIUS), _lying(turned))
        return self._message


def to_road(road: Road, prefix: str) -> MarkerArray:
    """Return the road's surface, and its centre line.

    Examples
    --------
    >>> from barc_sim.vehicle.road import Road
    >>> surface, line = to_road(Road.named('lab'), 'car2/').markers
    >>> line.header.frame_id, round(max(point.z for point in line.points), 2)
    ('car2/odom', 10.01)
    """
    frame = prefix + ODOM
    surface = _marker(frame, Marker.TRIANGLE_LIST, (1.0, 1.0, 1.0), _SURFACE)
    line = _marker(frame, Marker.LINE_STRIP, (_LINE_WIDTH, 0.0, 0.0), _PAINT)
    starts, half = road.starts, _ROAD_WIDTH / 2.0
    ends = (min(starts[0], 0.0) - _MARGIN, *starts[1:], max(starts[-1], 0.0) + _MARGIN)
    places = [(road.horizontal(s), road.elevation(s)) for s in ends]
    for (x0, z0), (x1, z1) in pairwise(places):
        left0, right0 = Point(x=x0, y=half, z=z0), Point(x=x0, y=-half, z=z0)
        left1, right1 = Point(x=x1, y=half, z=z1), Point(x=x1, y=-half, z=z1)
        surface.points += [right0, right1, left0, left0, right1, left1]
    line.points = [Point(x=x, z=z + 0.01) for x, z in places]
    return MarkerArray(markers=_numbered('road', [surface, line]))


def _marker(
    frame: str, kind: int, size: tuple[float, float, float], colour: tuple[float, float, float]
) -> Marker:
    red, green, blue = colour
    return Marker(
        header=to_header(0, frame),
        type=kind,
        action=Marker.ADD,
        scale=Vector3(x=size[0], y=size[1], z=size[2]),
        color=ColorRGBA(r=red, g=green, b=blue, a=1.0),
    )


def _numbered(namespace: str, markers: list[Marker]) -> list[Marker]:
    for number, marker in enumerate(markers):
        marker.ns, marker.id = namespace, number
    return markers


def _place(
    marker: Marker, state: MirroredState, centre: tuple[float, float, float], turn: Quaternion
) -> None:
    stamp(marker.header, state.stamp)
    there, turned = marker.pose.position, marker.pose.orientation
    there.x, there.y, there.z = state.pose.to_odom(*centre)
    turned.x, turned.y, turned.z, turned.w = turn


def _lying(turn: Quaternion) -> Quaternion:
    """Return `turn` after a quarter turn about x: a cylinder's axis, z, then lies along y."""
    x, y, z, w = (part / sqrt(2.0) for part in turn)
    return Quaternion(x=x + w, y=y + z, z=z - y, w=w - x)
