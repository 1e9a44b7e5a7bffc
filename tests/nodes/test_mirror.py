"""The mirrors: the messages of states and commands, and that each can be off."""

from __future__ import annotations

from functools import partial
from math import atan2, cos, isclose, nan, radians, sin, tan
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

import numpy as np
from barc_interfaces.msg import ZDynBkMdl
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry, Path
from node_bench import NodeBench, overrides
from rclpy.qos import DurabilityPolicy, QoSProfile
from visualization_msgs.msg import Marker, MarkerArray

from barc_sim.interfaces import qos
from barc_sim.interfaces.stamps import to_nanoseconds
from barc_sim.nodes.mirror import MirrorNode, RunDiagnostics, diagnose
from barc_sim.ros.conversions import to_header
from barc_sim.ros.poses import to_state_at_rest
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.track import Track

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
        facts: Callable[[], RunDiagnostics] = RunDiagnostics,
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
            self.peer.create_subscription(kind, topic, self.received[topic].append, qos.DEFAULT)
        self.states = self.peer.create_publisher(ZDynBkMdl, 'z_vhcl', qos.DEFAULT)
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


@pytest.fixture
def make_bench(benches: Make) -> Make:
    return partial(benches, Bench)


def test_pose_lies_on_the_hill_and_is_pitched_by_it(make_bench: Make) -> None:
    odom = make_bench().answer('odom', x=110.0, y=1.5, v_x=8.0, v_y=0.5, psi_dot=0.1)
    road = Road.lab()
    position = odom.pose.pose.position
    assert position.x == road.horizontal(110.0) < 110.0 - 1.0
    assert position.y == 1.5
    assert position.z == road.elevation(110.0)

    orientation = odom.pose.pose.orientation
    assert isclose(orientation.y / orientation.w, -tan(radians(15.0)))

    assert (odom.header.frame_id, odom.child_frame_id) == ('odom', 'base_link')
    assert to_nanoseconds(odom.header.stamp) == STEP

    twist = odom.twist.twist
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == (8.0, 0.5, 0.1)


def test_a_pose_that_is_sent_back_as_the_initial_one_is_the_same_state(make_bench: Make) -> None:
    bench = make_bench()
    road = Road.lab()
    for x, psi in ((30.0, 0.4), (110.0, -2.0), (150.0, 3.0), (-5.0, 1.0)):
        pose = bench.answer('odom', x=x, y=-2.0, psi=psi).pose.pose
        assert to_state_at_rest(pose, road) == pytest.approx((x, -2.0, psi, 0.0))


def test_a_state_that_is_not_finite_is_not_mirrored(make_bench: Make) -> None:
    bench = make_bench()
    bench.send(x=nan)
    odom = bench.answer('odom', x=1.0)
    assert [odom] == bench.received['odom']
    assert odom.pose.pose.position.x == 1.0


def test_car_stands_on_the_hill_with_its_cabin_upright(make_bench: Make) -> None:
    body, cabin = make_bench().answer('markers', x=110.0, psi=0.5).markers
    road = Road.lab()
    there = np.array([road.horizontal(110.0), 0.0, road.elevation(110.0)])
    # The car's axes: turned by psi in the surface, which rises by 30 degrees.
    ahead = np.array([cos(0.5) * cos(radians(30.0)), sin(0.5), cos(0.5) * sin(radians(30.0))])
    up = np.array([-sin(radians(30.0)), 0.0, cos(radians(30.0))])
    for marker, x, z in ((body, 0.0, 0.5), (cabin, -0.2, 1.1)):
        place = marker.pose.position
        assert [place.x, place.y, place.z] == pytest.approx([*there + x * ahead + z * up])

    assert (body.type, body.pose.orientation) == (Marker.CUBE, cabin.pose.orientation)
    assert body.id != cabin.id


def test_a_late_subscriber_receives_the_road(make_bench: Make) -> None:
    bench = make_bench()
    roads: list[MarkerArray] = []
    bench.peer.create_subscription(MarkerArray, 'road_markers', roads.append, LATCHED)
    bench.until(lambda: bool(roads))
    surface, line = roads[0].markers
    highest = Road.lab().elevation(120.0)

    assert max(point.z for point in surface.points) == pytest.approx(highest)
    assert len(surface.points) == 6 * 9
    assert {point.y for point in surface.points} == {-3.0, 3.0}
    assert [point.y for point in line.points] == [0.0] * 10


def test_a_late_subscriber_receives_the_track_as_a_path_and_as_markers(make_bench: Make) -> None:
    track = Track.named('oval')
    bench = make_bench(track='oval')
    roads: list[MarkerArray] = []
    paths: list[Path] = []
    bench.peer.create_subscription(MarkerArray, 'road_markers', roads.append, LATCHED)
    bench.peer.create_subscription(Path, 'track_path', paths.append, LATCHED)
    bench.until(lambda: bool(roads and paths))
    surface, line = roads[0].markers
    assert {each.header.frame_id for each in (surface, line, paths[0])} == {'odom'}

    edges = [track.frenet(each.x, each.y, 0.0).e_y for each in surface.points]
    assert {round(e_y, 9) for e_y in edges} == {-3.0, 3.0}

    poses = [each.pose for each in paths[0].poses]
    assert len(poses) == len(track.samples()) == len(line.points)

    for k, pose in enumerate(poses[:-1]):
        place = track.frenet(
            pose.position.x, pose.position.y, 2.0 * atan2(pose.orientation.z, pose.orientation.w)
        )
        assert place.s == pytest.approx(track.samples()[k], abs=1e-9)
        assert max(abs(place.e_y), abs(sin(place.e_psi))) < 1e-9
    odom = bench.answer('odom', x=110.0, y=1.5)
    assert (odom.pose.pose.position.x, odom.pose.pose.position.z) == (110.0, 0.0)


def test_the_path_starts_again_after_a_reset_and_has_the_newest_poses(
    make_bench: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('barc_sim.nodes.mirror._MAX_POSES', 20)
    bench = make_bench(period=0.0, road='flat')
    for k in range(25):
        path = bench.answer('path', x=1.0 * k, v_x=60.0)
    assert [pose.pose.position.x for pose in path.poses] == [1.0 * k for k in range(5, 25)]
    assert to_nanoseconds(path.poses[-1].header.stamp) == 25 * STEP
    path = bench.answer('path', x=0.0, v_x=0.0)
    assert len(path.poses) == 1


def test_diagnostics_have_missed_deadlines_speed_of_time_and_lost_messages(
    make_bench: Make,
) -> None:
    facts = RunDiagnostics(missed=3, slipped=1, recorded=100, lost=0)
    bench = make_bench(namespace='/car2', facts=lambda: facts, period=0.02)
    statuses: dict[str, Any] = {}

    def is_diagnosed() -> bool:
        bench.send()
        for message in bench.received['/diagnostics']:
            statuses.update({status.name: status for status in message.status})
        return len(bench.received['/diagnostics']) > 2

    bench.until(is_diagnosed)
    first = bench.received['/diagnostics'][0].status[0]
    assert (first.level, first.name) == (b'\x01', '/car2/mirror: timing')
    timing = {entry.key: entry.value for entry in statuses['/car2/mirror: timing'].values}
    assert (timing['missed deadlines'], timing['slipped periods']) == ('3', '1')
    assert float(timing['real-time factor']) >= 0.0
    assert statuses['/car2/mirror: bag'].level == b'\x00'


# Diagnoses

BEHIND = 'stamps are 6.1 s behind the wall clock: reset, or use --clock'


@pytest.mark.parametrize(
    ('facts', 'name', 'level', 'message'),
    [
        (RunDiagnostics(), 'timing', DiagnosticStatus.OK, 'in time'),
        (RunDiagnostics(2, 1), 'timing', DiagnosticStatus.OK, 'in time'),
        (RunDiagnostics(4, 2), 'timing', DiagnosticStatus.WARN, '2 commands missed their deadline'),
        (
            RunDiagnostics(2, 4),
            'timing',
            DiagnosticStatus.WARN,
            'simulated time has fallen behind by 3 periods',
        ),
        (RunDiagnostics(stamp_lag=6.1), 'timing', DiagnosticStatus.WARN, BEHIND),
        (RunDiagnostics(2, 1, 100, 0), 'bag', DiagnosticStatus.OK, 'no lost message is counted'),
        (RunDiagnostics(2, 1, 100, 7), 'bag', DiagnosticStatus.WARN, '7 messages are lost'),
        (RunDiagnostics(2, 1, 100, 7, 'disk full'), 'bag', DiagnosticStatus.ERROR, 'disk full'),
    ],
)
def test_a_diagnosis_names_each_fault_since_the_last_one(
    facts: RunDiagnostics, name: str, level: bytes, message: str
) -> None:
    statuses = {each.name: each for each in diagnose(facts, RunDiagnostics(2, 1), 1.0)}
    assert (statuses[name].level, statuses[name].message) == (level, message)
