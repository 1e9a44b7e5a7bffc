"""Parameters of a table are declared on a node, with their ranges and the user's values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import ParameterDeclaration
from barc_sim.ros.parameters import declare

if TYPE_CHECKING:
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
