"""What nodes share: parameters, refused input, claims to a topic, the take of messages."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from command_line import wait_for
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from std_msgs.msg import Int64

from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import ParameterDeclaration
from barc_sim.ros import node_helpers
from barc_sim.ros.node_helpers import RefusedInput, declare
from barc_sim.ros.peers import claim, others_here
from barc_sim.ros.recording.polled import Taker

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.context import Context

TABLE = [
    ParameterDeclaration('mass', 2000.0, 'the mass [kg]', (1.0, 1e6), read_only=True),
    ParameterDeclaration('seed', 0, 'seed', (0, 2**53)),
    ParameterDeclaration('road', 'lab', 'the road'),
    ParameterDeclaration('wait', default=True, description='whether to wait'),
]


def car(context: Context, **overrides: object) -> Node:
    given = [Parameter(name, value=value) for name, value in overrides.items()]
    return Node('car', context=context, parameter_overrides=given)


def test_parameters_have_their_defaults_or_the_users_values(ros: Context) -> None:
    # The ends of a range belong to it.
    node = car(ros, mass=1.0, seed=2**53)
    assert declare(node, TABLE) == {'mass': 1.0, 'seed': 2**53, 'road': 'lab', 'wait': True}
    mass, seed, road = (node.describe_parameter(name) for name in ('mass', 'seed', 'road'))
    assert mass.description == 'the mass [kg]'
    spans = [*mass.floating_point_range, *seed.integer_range, *road.floating_point_range]
    assert [(each.from_value, each.to_value) for each in spans] == [(1.0, 1e6), (0, 2**53)]
    assert [one.read_only for one in (mass, seed, road)] == [True, False, False]


@pytest.mark.parametrize(
    ('name', 'value', 'wanted'),
    [
        ('mass', 'abc', 'float, such as 2000.0'),
        ('seed', 'x', 'int, such as 0'),
        ('road', 7, "str, such as 'lab'"),
        ('wait', 'yes', 'bool, such as True'),
    ],
)
def test_wrong_type_is_refused_with_an_example(
    ros: Context, name: str, value: object, wanted: str
) -> None:
    with pytest.raises(UserError) as refusal:
        declare(car(ros, **{name: value}), TABLE)
    message = str(refusal.value)
    assert message.startswith(f'parameter {name} of car must be of type {wanted}: ')
    assert '\n' not in message


def test_every_refusal_counts_and_one_a_second_is_logged(
    ros: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = Node('car', context=ros)
    logged: list[str] = []
    monkeypatch.setattr(node.get_logger(), 'warning', logged.append)
    clock = iter((100.0, 100.1, 100.9, 101.0, 101.5))
    monkeypatch.setattr(node_helpers.time, 'monotonic', lambda: next(clock))
    refused, described = RefusedInput(node), []

    def describe() -> str:
        described.append(refused.count)
        return 'nonsense'

    for _ in range(5):
        refused.add(describe)
    monkeypatch.undo()
    node.destroy_node()
    assert refused.count == 5
    assert described == [1, 4]
    first, second = logged
    assert 'refused nonsense' in first
    assert 'refused nonsense (4 refused so far)' in second


HOLDER = Path(__file__).with_name('programs') / 'hold_topic.py'


def test_another_process_holds_its_claim_until_it_is_killed(ros: Context, ros_domain: int) -> None:
    node = Node('car', context=ros)
    assert not others_here(ros_domain)

    with subprocess.Popen(
        [sys.executable, HOLDER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout
        assert holder.stdout.readline() == 'held\n'
        assert others_here(ros_domain)
        with pytest.raises(UserError):
            claim(node, 'z_vhcl')

        holder.kill()
        holder.wait(timeout=200)
    assert not others_here(ros_domain)

    claim(node, 'z_vhcl').close()


#: A subscription that is created later receives what was published before.
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def nodes(ros: Context) -> Iterator[tuple[Node, Node]]:
    nodes = Node('publisher', context=ros), Node('subscriber', context=ros)
    yield nodes
    for node in nodes:
        node.destroy_node()


def test_messages_are_taken_with_their_times_number_and_publisher(nodes: tuple[Node, Node]) -> None:
    publishing, subscribing = nodes
    publisher = publishing.create_publisher(Int64, 'number', LATCHED)
    before = time.time_ns()
    for number in range(3):
        publisher.publish(Int64(data=number))
    after = time.time_ns()
    time.sleep(0.01)  # so that the two times of a message cannot be mistaken for each other
    subscribed = time.time_ns()
    subscription = subscribing.create_subscription(
        Int64, 'number', lambda _: None, LATCHED, raw=True
    )
    taker, taken = Taker(), []
    wait_for(lambda: taken.extend(taker.take(subscription, 10)) or len(taken) == 3)
    taker.close()
    data, published, received, numbers, publishers = zip(*taken, strict=True)
    assert [deserialize_message(each, Int64).data for each in data] == [0, 1, 2]
    assert all(before <= each <= after for each in published)
    assert all(subscribed <= each <= time.time_ns() for each in received)
    assert numbers == (1, 2, 3)

    (info,) = subscribing.get_publishers_info_by_topic('number')
    assert {*publishers} == {bytes(info.endpoint_gid)}
