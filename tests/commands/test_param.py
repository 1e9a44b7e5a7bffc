"""The param command, and runs with the parameters of another run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

import yaml
from command_line import barc, refused, spinning
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from barc_sim.errors import Parameter
from barc_sim.ros.node_helpers import declare

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.context import Context

BUILT_IN = ['start_type_description_service', 'use_sim_time']
TABLE = [
    Parameter('gain', 30.0, 'how much [1/s]', (0.0, 100.0)),
    Parameter('mass', 2000.0, 'the mass [kg]', (1.0, 1e6), read_only=True),
    Parameter('road', 'lab', 'the road'),
    Parameter('seed', 0, 'the seed', (0, 2**53)),
    Parameter('wait', default=True, description='whether to wait'),
]


@pytest.fixture
def car(ros: Context) -> Iterator[Node]:
    """Return a node with parameters of every kind that we have."""
    node = Node('car', context=ros, namespace='one')
    declare(node, TABLE)
    with spinning(ros, node):
        yield node


def value(node: Node, name: str) -> object:
    return node.get_parameter(name).value


@pytest.mark.usefixtures('car')
def test_names_are_listed_of_one_node_and_of_all() -> None:
    names = [f'  {name}' for name in sorted([*(one.name for one in TABLE), *BUILT_IN])]
    assert barc('param', 'list', 'one/car').stdout.splitlines() == names
    assert barc('param', 'list').stdout.splitlines() == ['/one/car:', *names]


@pytest.mark.usefixtures('car')
def test_value_is_printed_with_its_type() -> None:
    assert barc('param', 'get', '/one/car', 'gain').stdout == 'Double value is: 30.0\n'
    assert barc('param', 'get', '/one/car', 'wait').stdout == 'Boolean value is: True\n'


@pytest.mark.parametrize(
    ('name', 'text', 'expected'),
    [
        ('gain', '20.0', 20.0),
        ('gain', '20', 20.0),
        ('gain', '1e-7', 1e-7),
        ('road', '7', '7'),
        ('road', 'off', 'off'),
        ('seed', '7', 7),
        ('wait', 'false', False),
    ],
)
def test_value_is_set(car: Node, name: str, text: str, expected: object) -> None:
    done = barc('param', 'set', '/one/car', name, text)
    assert (done.returncode, done.stdout, done.stderr) == (0, 'Set parameter successful\n', '')
    assert value(car, name) == expected


@pytest.mark.parametrize(
    ('words', 'sentence'),
    [
        ('get /one/car gian', '/one/car has no parameter gian: did you mean gain?'),
        ('get /one/cat gain', 'there is no node /one/cat: did you mean /one/car?'),
        ('set /one/car gain {', "'{' is not a value in YAML: a string may need quotes"),
        (
            'set /one/car seed 1.5',
            (
                'parameter seed cannot be set: /one/car refused it: Wrong parameter type, expected '
                "'Type.INTEGER' got 'Type.DOUBLE'"
            ),
        ),
        (
            'set /one/car gain 101.0',
            (
                'parameter gain cannot be set: /one/car refused it: Parameter gain out of range '
                'Min: 0.0, Max: 100.0, value: 101.0'
            ),
        ),
        (
            'set /one/car mass 1000',
            (
                'parameter mass cannot be set: it is read-only: set it at the start '
                '(--ros-args -p car:mass:=1000.0)'
            ),
        ),
    ],
)
@pytest.mark.usefixtures('impatient')
def test_mistake_is_one_sentence(car: Node, words: str, sentence: str) -> None:
    before = [value(car, parameter.name) for parameter in TABLE]
    assert refused('param', *words.split()) == f'barc param: error: {sentence}'
    assert [value(car, parameter.name) for parameter in TABLE] == before


@pytest.mark.usefixtures('impatient')
def test_node_that_offers_no_parameters_is_named(ros: Context) -> None:
    mute = Node('mute', context=ros, start_parameter_services=False)
    with spinning(ros, mute):
        assert 'error: /mute has no parameter services' in refused('param', 'list', 'mute')
        among = barc('param', 'list')
    assert (among.returncode, among.stdout) == (0, '')
    assert '/mute has no parameter services' in among.stderr


def test_dump_is_a_file_of_parameters(car: Node) -> None:
    given = {'gain': 1e-7, 'road': '7', 'seed': 2**53, 'wait': False}
    car.set_parameters([RosParameter(name, value=one) for name, one in given.items()])
    car.declare_parameter('motor.delay', 0.02)
    dump = yaml.safe_load(barc('param', 'dump', '/one/car').stdout)
    (found,) = (each['ros__parameters'] for node, each in dump.items() if node == '/one/car')
    assert {name: found[name] for name in given} == given
    assert found['motor'] == {'delay': 0.02}
