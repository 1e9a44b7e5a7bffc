"""The relay alone: the commands that answer Twists, and the Twists that it refuses."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from barc_interfaces.msg import ECU, ZDynBkMdl
from geometry_msgs.msg import Twist, Vector3
from node_bench import NodeBench, overrides
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from barc_sim.interfaces import qos
from barc_sim.nodes.relay import Relay

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context

    Make = Callable[..., 'Bench']


class Bench(NodeBench):
    """A relay, and a node that sends it Twists and receives its commands."""

    def __init__(
        self, context: Context, spin_until: Callable[..., None], **parameters: float | bool | str
    ) -> None:
        self.relay = Relay(context=context, parameter_overrides=overrides(**parameters))
        super().__init__(context, spin_until, self.relay)
        self.commands: list[ECU] = []
        self.peer.create_subscription(ECU, 'ecu', self.commands.append, qos.DEFAULT)
        self.twists = self.peer.create_publisher(Twist, 'cmd_vel', 10)  # as the stock ones do
        self.states = self.peer.create_publisher(ZDynBkMdl, 'z_vhcl', qos.DEFAULT)

    def send(self, forward: float = 0.0, turn: float = 0.0, brake: float = 0.0) -> None:
        """Publish a Twist of these shares."""
        self.twists.publish(Twist(linear=Vector3(x=forward, z=-brake), angular=Vector3(z=turn)))

    def until_motor(self, motor: float) -> None:
        """Spin until a command of this acceleration arrives."""
        self.commands.clear()
        self.until(lambda: any(command.motor == motor for command in self.commands))


@pytest.fixture
def make_bench(benches: Make) -> Make:
    return partial(benches, Bench)


def test_a_relay_without_a_driver_commands_coasting_without_a_stamp(make_bench: Make) -> None:
    bench = make_bench()
    bench.until(lambda: len(bench.commands) >= 5)
    assert {(c.motor, c.servo, c.header.stamp.sec) for c in bench.commands} == {(0.0, 0.0, 0)}


def test_a_twist_commands_its_share_of_the_limits_also_after_they_change(make_bench: Make) -> None:
    bench = make_bench(acceleration=3.0, stale_after=60.0)
    bench.send(forward=0.5)
    bench.until_motor(1.5)
    bench.relay.set_parameters([Parameter('acceleration', value=5.0)])
    bench.until_motor(2.5)
    bench.send(forward=7.0)
    bench.until_motor(5.0)


def test_twists_that_are_not_finite_are_refused_with_one_warning_and_counted(
    make_bench: Make, capfd: pytest.CaptureFixture[str]
) -> None:
    bench = make_bench(stale_after=60.0)
    bench.send(forward=0.5)
    for value in (float('nan'), float('inf'), float('-inf')):
        bench.send(forward=value)
        bench.send(turn=value)
        bench.send(brake=value)
    bench.until(lambda: bench.relay.refused.count == 9)
    bench.until_motor(2.0)

    assert capfd.readouterr().err.count('refused a Twist') == 1


def test_a_reset_clears_the_request_and_straightens_the_wheel(make_bench: Make) -> None:
    bench = make_bench(stale_after=60.0)
    bench.send(forward=1.0, turn=1.0)
    bench.until_motor(4.0)
    bench.call(Trigger, 'relay/reset')
    bench.until_motor(0.0)
    assert bench.relay.driver.servo == 0.0
