"""The mirrors: the messages of states and commands, and that each can be off."""

from __future__ import annotations

from functools import partial
from math import atan2, isclose, nan, radians, tan
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from barc_interfaces.msg import ECU, ZDynBkMdl
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry, Path
from node_bench import NodeBench, overrides
from rclpy.qos import DurabilityPolicy, QoSProfile
from visualization_msgs.msg import Marker, MarkerArray

from barc_sim.bags import names
from barc_sim.nodes.diagnosis import Facts
from barc_sim.nodes.mirror import WHEEL_RADIUS, MirrorNode
from barc_sim.ros.node_helpers import to_header, to_nanoseconds
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context

    Make = Callable[..., 'Bench']

STEP = 20_000_000  # [ns]
TYPES = {
    'odom': Odometry,
    'markers': MarkerArray,
    'path': Path,
    '/diagnostics': DiagnosticArray,
}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Bench(NodeBench):
    """A mirror, and a node that publishes states and commands and subscribes to the mirrors."""

    def __init__(
        self,
        context: Context,
        spin_until: Callable[..., None],
        *,
        namespace: str = '',
        facts: Callable[[], Facts] = Facts,
        period: float = 1.0,
        **parameters: float | str | bool,
    ) -> None:
        self.mirror = MirrorNode(
            facts=facts,
            period=period,
            context=context,
            namespace=namespace,
            parameter_overrides=overrides(**parameters),
        )
        super().__init__(context, spin_until, self.mirror, namespace)
        self.received: dict[str, list[Any]] = {topic: [] for topic in TYPES}
        for topic, kind in TYPES.items():
            self.peer.create_subscription(kind, topic, self.received[topic].append, names.QOS)
        self.states = self.peer.create_publisher(ZDynBkMdl, 'z_vhcl', names.QOS)
        self.commands = self.peer.create_publisher(ECU, 'ecu', names.QOS)
        self.sent = 0

    def send(self, **state: float) -> None:
        """Publish the next state."""
        self.sent += 1
        self.states.publish(ZDynBkMdl(header=to_header(self.sent * STEP), **state))

    def answer(self, topic: str, **state: float) -> Any:  # noqa: ANN401 (as the topic has it)
        """Return what is published on a topic when a state is."""
        messages = self.received[topic]
        before = len(messages)
        self.send(**state)
        self.until(lambda: len(messages) > before)
        return messages[-1]

    def mirrored(self) -> set[str]:
        """Return the names of the topics that the mirror publishes."""
        own = {'rosout', 'parameter_events'}
        return {end.topic_name.lstrip('/') for end in self.mirror.publishers} - own


@pytest.fixture
def bench(benches: Make) -> Make:
    return partial(benches, Bench)


def test_pose_lies_on_the_hill_and_is_pitched_by_it(bench: Make) -> None:
    odom = bench().answer('odom', x=110.0, y=1.5, v_x=8.0, v_y=0.5, psi_dot=0.1)
    there, turn = odom.pose.pose.position, odom.pose.pose.orientation
    road = Road.lab()
    assert (there.x, there.y, there.z) == (road.horizontal(110.0), 1.5, road.elevation(110.0))
    assert there.x < 110.0 - 1.0
    assert isclose(turn.y / turn.w, -tan(radians(15.0)))
    assert (odom.header.frame_id, odom.child_frame_id) == ('odom', 'base_link')
    assert to_nanoseconds(odom.header.stamp) == STEP
    twist = odom.twist.twist
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == (8.0, 0.5, 0.1)


def angle_of(tyre: Marker) -> float:
    """Return the angle [rad] to which a wheel of a car that points along x is turned."""
    turn = tyre.pose.orientation  # after a quarter turn about x
    return 2.0 * atan2(turn.z, turn.w)


def test_front_wheels_are_steered_as_commanded_the_inner_one_by_more(bench: Make) -> None:
    world = bench()
    world.commands.publish(ECU(servo=nan))
    world.commands.publish(ECU(servo=0.3))
    markers = world.received['markers']

    def is_turned() -> bool:
        world.send()
        return bool(markers) and angle_of(markers[-1].markers[2]) > 0.1

    world.until(is_turned)
    angles = [angle_of(tyre) for tyre in markers[-1].markers[2:]]
    assert angles == pytest.approx([0.327, 0.277, 0.0, 0.0], abs=1e-3)


def test_state_that_is_not_finite_is_left_out(bench: Make) -> None:
    world = bench()
    world.send(x=nan)
    odom = world.answer('odom', x=1.0)
    assert [odom] == world.received['odom']
    assert odom.pose.pose.position.x == 1.0


def test_car_is_drawn_to_scale_on_its_wheels(bench: Make) -> None:
    body, _, *tyres = bench(l_f=1.0, l_r=2.0).answer('markers', x=5.0).markers
    assert (body.type, [tyre.type for tyre in tyres]) == (Marker.CUBE, [Marker.CYLINDER] * 4)
    places = [(tyre.pose.position.x, tyre.pose.position.z) for tyre in tyres]
    assert places == [(6.0, WHEEL_RADIUS)] * 2 + [(3.0, WHEEL_RADIUS)] * 2
    left, right = (tyre.pose.position.y for tyre in tyres[:2])
    assert left == -right > 0.0
    assert body.scale.x == pytest.approx(4.4)
    assert len({(marker.ns, marker.id) for marker in (body, *tyres)}) == 5


def test_cylinders_lie_on_their_axles(bench: Make) -> None:
    tyre = bench().answer('markers', psi=0.5).markers[-1]
    turn = tyre.pose.orientation
    # The cylinder's z axis in `odom`: the third column of the rotation's matrix.
    axis = (
        2.0 * (turn.x * turn.z + turn.w * turn.y),
        2.0 * (turn.y * turn.z - turn.w * turn.x),
        1.0 - 2.0 * (turn.x * turn.x + turn.y * turn.y),
    )
    assert [abs(part) for part in axis] == pytest.approx([0.479426, 0.877583, 0.0], abs=1e-6)


def test_road_is_latched(bench: Make) -> None:
    world = bench()
    roads: list[MarkerArray] = []
    world.peer.create_subscription(MarkerArray, 'road_markers', roads.append, LATCHED)
    world.until(lambda: bool(roads))
    surface, line = roads[0].markers
    highest = Road.lab().elevation(120.0)
    assert max(point.z for point in surface.points) == pytest.approx(highest)
    assert len(surface.points) == 6 * 9
    assert {point.y for point in surface.points} == {-3.0, 3.0}
    assert [point.y for point in line.points] == [0.0] * 10


def test_path_begins_anew_after_a_reset_and_stays_bounded(bench: Make) -> None:
    world = bench(period=0.0, diagnostics=False)
    for k in range(250):
        path = world.answer('path', x=1.0 * k, v_x=60.0)
    poses = path.poses
    assert 100 <= len(poses) <= 200
    assert poses[0].pose.position.x == 0.0
    path = world.answer('path', x=0.0, v_x=0.0)
    assert len(path.poses) == 1


def test_path_has_the_places_so_far(bench: Make) -> None:
    world = bench(period=0.0, diagnostics=False)
    for k in range(10):
        path = world.answer('path', x=1.0 * k, v_x=50.0)
    assert [pose.pose.position.x for pose in path.poses] == [1.0 * k for k in range(10)]
    assert path.header.frame_id == 'odom'
    assert to_nanoseconds(path.poses[-1].header.stamp) == 10 * STEP


def test_frames_bear_the_namespace(bench: Make) -> None:
    world = bench(namespace='/car2')
    odom = world.answer('odom')
    assert (odom.header.frame_id, odom.child_frame_id) == ('car2/odom', 'car2/base_link')
    assert world.answer('markers').markers[0].header.frame_id == 'car2/odom'


def test_diagnostics_combine_facts_and_topics(bench: Make) -> None:
    known = Facts(missed=3, slipped=1, recorded=100, lost=0)
    world = bench(namespace='/car2', facts=lambda: known, period=0.02)
    diagnosed: dict[str, Any] = {}

    def is_diagnosed() -> bool:
        world.send()
        world.commands.publish(ECU())
        for message in world.received['/diagnostics']:
            diagnosed.update({status.name: status for status in message.status})
        return '/car2/mirror: command' in diagnosed and len(world.received['/diagnostics']) > 2

    world.until(is_diagnosed)
    first = world.received['/diagnostics'][0].status[0]
    assert (first.level, first.name) == (b'\x01', '/car2/mirror: timing')
    timing = {entry.key: entry.value for entry in diagnosed['/car2/mirror: timing'].values}
    assert (timing['missed deadlines'], timing['slipped periods']) == ('3', '1')
    assert float(timing['real-time factor']) >= 0.0
    (age,) = diagnosed['/car2/mirror: command'].values
    assert 0.0 <= float(age.value) < 60.0
    assert diagnosed['/car2/mirror: bag'].level == b'\x00'


@pytest.mark.parametrize(
    ('off', 'topics'),
    [
        ('odom', {'odom'}),
        ('path', {'path'}),
        ('markers', {'markers', 'road_markers'}),
        ('diagnostics', {'diagnostics'}),
    ],
)
def test_mirror_that_is_off_has_no_publisher(bench: Make, off: str, topics: set[str]) -> None:
    every = bench().mirrored()
    assert topics <= every
    assert bench(**{off: False}).mirrored() == every - topics
