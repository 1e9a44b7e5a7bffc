"""`/clock`: other nodes follow the simulator's time at any pace."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from functools import partial
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from barc_interfaces.msg import ECU, ZDynBkMdl
from command_line import started
from node_bench import NodeBench, overrides
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from barc_sim.bags import names
from barc_sim.bags.messages import to_nanoseconds
from barc_sim.nodes.simulator import VehicleSimulator

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from rclpy.context import Context

    Make = Callable[..., 'Bench']

#: As rclpy's and rclcpp's time sources subscribe.
CLOCK_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
#: A plain node in a process of its own whose time comes from /clock alone.
FOLLOWER = """
import json
import rclpy
from rclpy.parameter import Parameter
rclpy.init()
node = rclpy.create_node(
    'follower', parameter_overrides=[Parameter('use_sim_time', value=True)]
)
print('ready', flush=True)
found = []
while len(set(found)) < 40:
    rclpy.spin_once(node)
    found.append(node.get_clock().now().nanoseconds)
print(json.dumps(found))
"""


class Bench(NodeBench):
    """A simulator, a driver that answers it, and the times of clock and states."""

    def __init__(
        self, context: Context, spin_until: Callable[..., None], **parameters: float | bool
    ) -> None:
        check_period = parameters.pop('check_period', 1.0)
        self.simulator = VehicleSimulator(
            check_period=check_period, context=context, parameter_overrides=overrides(**parameters)
        )
        super().__init__(context, spin_until, self.simulator)
        self.times: list[int] = []
        self.stamps: list[int] = []
        self.answers = True
        self.commands = self.peer.create_publisher(ECU, 'ecu', names.QOS)
        self.peer.create_subscription(ZDynBkMdl, 'z_vhcl', self._on_state, names.QOS)
        self.peer.create_subscription(Clock, '/clock', self._on_clock, 100)

    def _on_state(self, state: ZDynBkMdl) -> None:
        self.stamps.append(to_nanoseconds(state.header.stamp))
        if self.answers:
            self.commands.publish(ECU(header=state.header, motor=1.0))

    def _on_clock(self, message: Clock) -> None:
        self.times.append(to_nanoseconds(message.clock))


@pytest.fixture
def bench(benches: Make) -> Make:
    return partial(benches, Bench)


@pytest.mark.parametrize(
    ('parameters', 'expected'),
    [
        ({}, 0),
        ({'clock': True}, 1),
        ({'realtime_factor': 5.0}, 1),
        ({'realtime_factor': 0.5}, 1),
        ({'realtime_factor': 0.0}, 1),
    ],
)
def test_clock_is_published_at_another_factor_or_on_request(
    bench: Make, parameters: dict[str, float | bool], expected: int
) -> None:
    assert bench(**parameters).peer.count_publishers('/clock') == expected


def test_clock_stands_while_paused_and_is_repeated_for_late_nodes(bench: Make) -> None:
    world = bench(realtime_factor=5.0, check_period=0.02)
    world.until(lambda: len(world.times) > 5)
    assert world.call(SetBool, 'vehicle_simulator/pause', data=True).message == 'paused'
    late: list[Clock] = []
    world.peer.create_subscription(Clock, '/clock', late.append, CLOCK_QOS)
    world.until(lambda: len(late) > 5)
    assert {to_nanoseconds(message.clock) for message in late} == {world.stamps[-1]}
    world.call(SetBool, 'vehicle_simulator/pause', data=False)
    world.until(lambda: world.times[-1] > to_nanoseconds(late[0].clock))


@pytest.mark.usefixtures('ros_domain')
def test_plain_node_in_another_process_keeps_time_with_a_run(tmp_path: Path) -> None:
    options = ['--road', 'flat', '--distance', '0', '--realtime-factor', 'max', '--quiet']
    with subprocess.Popen(
        [sys.executable, '-c', FOLLOWER], stdout=subprocess.PIPE, text=True
    ) as follower:
        assert follower.stdout
        assert follower.stdout.readline() == 'ready\n'
        with started('acc', *options, cwd=tmp_path) as run:
            printed, _ = follower.communicate(timeout=60)
            run.send_signal(signal.SIGINT)
            path, _ = run.communicate(timeout=60)
    followed = [time for time in json.loads(printed) if time]
    assert followed == sorted(followed)
    stamps, times = recorded(tmp_path / path.strip())
    assert set(followed) <= set(stamps)
    assert set(times) == set(stamps)


def recorded(path: Path) -> tuple[list[int], list[int]]:
    """Return the states' stamps and the clock's times [ns] in a bag."""
    stamps, times = [], []
    with AnyReader([path]) as reader:
        wanted = [each for each in reader.connections if each.topic in {'/z_vhcl', '/clock'}]
        for connection, _, data in reader.messages(connections=wanted):
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic == '/clock':
                times.append(to_nanoseconds(message.clock))
            else:
                stamps.append(to_nanoseconds(message.header.stamp))
    return stamps, times
