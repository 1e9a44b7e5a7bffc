"""What nodes share: parameters declared from a table, and refused input."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from barc_sim.errors import Parameter, UserError
from barc_sim.ros import node_helpers
from barc_sim.ros.node_helpers import RefusedInput, declare

if TYPE_CHECKING:
    from rclpy.context import Context

TABLE = [
    Parameter('mass', 2000.0, 'the mass [kg]', (1.0, 1e6), read_only=True),
    Parameter('seed', 0, 'seed', (0, 2**53)),
    Parameter('road', 'lab', 'the road'),
    Parameter('wait', default=True, description='whether to wait'),
]


def car(context: Context, **overrides: object) -> Node:
    given = [RosParameter(name, value=value) for name, value in overrides.items()]
    return Node('car', context=context, parameter_overrides=given)


def test_values_are_the_defaults_or_what_was_given(ros: Context) -> None:
    # The ends of a range belong to it.
    values = declare(car(ros, mass=1.0, seed=2**53), TABLE)
    assert values == {'mass': 1.0, 'seed': 2**53, 'road': 'lab', 'wait': True}


def test_descriptor_tells_description_and_range(ros: Context) -> None:
    node = car(ros)
    declare(node, TABLE)
    mass, seed, road = (node.describe_parameter(name) for name in ('mass', 'seed', 'road'))
    assert mass.description == 'the mass [kg]'
    (span,) = mass.floating_point_range
    assert (span.from_value, span.to_value) == (1.0, 1e6)
    (span,) = seed.integer_range
    assert (span.from_value, span.to_value) == (0, 2**53)
    assert not road.floating_point_range
    assert [one.read_only for one in (mass, seed, road)] == [True, False, False]


@pytest.mark.parametrize('value', [0.0, -1.0, 1e7, float('inf'), float('nan')])
def test_number_out_of_range_is_refused_with_the_range(ros: Context, value: float) -> None:
    with pytest.raises(UserError) as refusal:
        declare(car(ros, mass=value), TABLE)
    expected = f'parameter mass of car: {value:g} is not a number from 1 to 1e+06'
    assert str(refusal.value) == expected


@pytest.mark.parametrize(
    ('name', 'value', 'wanted'),
    [
        ('mass', 'abc', 'float, such as 2000.0'),
        ('mass', 2000, 'float, such as 2000.0'),
        ('seed', 'x', 'int, such as 0'),
        ('road', 7, "str, such as 'lab'"),
        ('wait', 'yes', 'bool, such as True'),
        ('mass', [1.0], 'float, such as 2000.0'),
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
