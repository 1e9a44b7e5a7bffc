"""`topics`, `echo`, `param` and `graph`: what they print, how they end, and their sentences."""

from __future__ import annotations

import signal
import subprocess
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest
import yaml
from barc_interfaces.msg import ECU
from command_line import barc, call, refused, spinning, started
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray, String

from barc_sim.bags import reader as bag
from barc_sim.bags.graph import NodeGraph
from barc_sim.bags.metadata import to_yaml
from barc_sim.figures.graph_figure import lines
from barc_sim.interfaces.parameters import ParameterDeclaration
from barc_sim.ros.introspection import plain
from barc_sim.ros.parameters import declare

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rclpy.context import Context


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait a shorter time [s] for what is not in the ROS graph: all of it is in this process."""
    monkeypatch.setattr('barc_sim.ros.introspection._TIMEOUT', 0.5)
    monkeypatch.setattr('barc_sim.ros.introspection._ALONE_TIMEOUT', 0.3)
    monkeypatch.setattr('barc_sim.ros.introspection._STABLE_PERIOD', 0.2)


@pytest.fixture
def talker(ros: Context) -> Iterator[Node]:
    """Return a node that publishes a command, counting, 100 times a second."""
    node = Node('talker', context=ros, namespace='car')
    commands = node.create_publisher(ECU, 'ecu', 10)
    message = ECU(servo=-0.25)
    message.header.stamp.sec = 7

    def publish() -> None:
        message.motor += 1.0
        commands.publish(message)

    node.create_timer(0.01, publish)
    with spinning(ros, node):
        yield node


@pytest.mark.usefixtures('talker')
def test_messages_are_documents_of_yaml() -> None:
    process = barc('echo', 'car/ecu', '-n', '3')
    assert (process.returncode, process.stderr) == (0, '')

    *documents, rest = yaml.safe_load_all(process.stdout)
    assert rest is None
    assert len(documents) == 3

    first = documents[0].pop('motor')
    assert documents[0] == {
        'header': {'stamp': {'sec': 7, 'nanosec': 0}, 'frame_id': ''},
        'servo': -0.25,
    }
    assert [document['motor'] for document in documents[1:]] == [first + 1.0, first + 2.0]


@pytest.mark.usefixtures('talker')
def test_ctrl_c_ends_the_command_in_order() -> None:
    with started('echo', '/car/ecu') as process:
        assert process.stdout
        assert process.stdout.readline() == 'header:\n'
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=200)
        assert (process.returncode, err) == (0, '')


@pytest.mark.parametrize(
    'qos',
    [
        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
        QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
    ],
    ids=['latched', 'best effort'],
)
def test_messages_are_received_with_the_quality_of_their_publisher(
    ros: Context, qos: QoSProfile
) -> None:
    node = Node('talker', context=ros)
    publisher = node.create_publisher(String, 'news', qos)
    if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL:
        publisher.publish(String(data='news'))
    else:
        node.create_timer(0.01, lambda: publisher.publish(String(data='news')))
    with spinning(ros, node):
        assert barc('echo', 'news', '--once').stdout == 'data: news\n---\n'


@pytest.mark.usefixtures('talker', 'impatient')
def test_echo_refuses_a_mistake_in_one_sentence() -> None:
    for words, sentence in {
        '/car/ecus --once': 'there is no topic /car/ecus: did you mean /car/ecu?',
        '/c-ar': 'topic name must not contain characters other than',
    }.items():
        line = refused('echo', *words.split())
        assert sentence in line


@pytest.mark.usefixtures('impatient')
def test_a_domain_without_nodes_is_named_in_one_sentence(ros_domain: int, tmp_path: Path) -> None:
    nothing = f'no node is running in ROS domain {ros_domain}: start a run first'
    sentences = {
        ('echo', 'z_vhcl'): f'there is no topic /z_vhcl in ROS domain {ros_domain}: start a run',
        ('graph', '--save', str(tmp_path / 'graph.svg')): nothing,
        ('topics',): nothing,
        ('param', 'list'): nothing,
    }

    for words, sentence in sentences.items():
        assert refused(*words).startswith(f'barc {words[0]}: error: {sentence}')


def test_messages_are_written_in_the_order_of_the_definition_and_long_values_cut() -> None:
    assert to_yaml(plain(ECU(motor=1e-7, servo=float('nan')))) == (
        "header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: ''\n"
        'motor: 1.0e-07\nservo: .nan\n'
    )
    assert to_yaml(plain(Float64MultiArray(data=[1.0] * 200))).count('\n- ') == 129
    assert to_yaml(plain(String(data='x' * 200))) == f'data: {"x" * 128}...\n'


BUILT_IN = ['start_type_description_service', 'use_sim_time']
TABLE = [
    ParameterDeclaration('gain', 30.0, 'how much [1/s]', (0.0, 100.0)),
    ParameterDeclaration('mass', 2000.0, 'the mass [kg]', (1.0, 1e6), read_only=True),
    ParameterDeclaration('road', 'lab', 'the road'),
    ParameterDeclaration('seed', 0, 'the seed', (0, 2**53)),
    ParameterDeclaration('wait', default=True, description='whether to wait'),
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
    names = [f'  {name}' for name in sorted([*(each.name for each in TABLE), *BUILT_IN])]
    assert barc('param', 'list', 'one/car').stdout.splitlines() == names
    assert barc('param', 'list').stdout.splitlines() == ['/one/car:', *names]


def test_a_parameter_can_be_set(car: Node) -> None:
    assert barc('param', 'get', '/one/car', 'gain').stdout == '30.0\n'

    for name, text, expected in (
        ('gain', '20.0', 20.0),
        ('gain', '25', 25.0),
        ('gain', '1e-7', 1e-7),
        ('road', '7', '7'),
        ('road', 'off', 'off'),
        ('seed', '7', 7),
        ('wait', 'false', False),
    ):
        process = barc('param', 'set', '/one/car', name, text)
        assert (process.returncode, process.stdout, process.stderr) == (0, f'{expected}\n', '')
        assert value(car, name) == expected


@pytest.mark.usefixtures('impatient')
def test_param_refuses_a_mistake_in_one_sentence(car: Node) -> None:
    before = [value(car, parameter.name) for parameter in TABLE]
    for words, sentence in {
        'get /one/car gian': '/one/car has no parameter gian: did you mean gain?',
        'get /one/cat gain': 'there is no node /one/cat: did you mean /one/car?',
        'set /one/car gain {': "parameter gain cannot be '{': expected a value like 30.0, its "
        'present one',
        'set /one/car seed 1.5': "/one/car refused '1.5': Wrong parameter type, expected "
        "'Type.INTEGER' got 'Type.DOUBLE'",
        'set /one/car gain 101.0': "/one/car refused '101.0': Parameter gain out of range Min: "
        '0.0, Max: 100.0, value: 101.0',
        'set /one/car mass 1000': "/one/car refused '1000': Trying to set a read-only parameter: "
        'mass.',
    }.items():
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


@pytest.fixture
def endpoints(ros: Context) -> Iterator[None]:
    """Run a node that publishes at 50 Hz, one that listens, and hidden topics."""
    talker, listener = Node('talker', context=ros), Node('listener', context=ros)
    commands = talker.create_publisher(ECU, 'ecu', 10)
    talker.create_publisher(String, '_hidden', 10)
    talker.create_timer(0.02, lambda: commands.publish(ECU()))
    listener.create_subscription(ECU, 'ecu', lambda _: None, 10)
    with spinning(ros, talker, listener):
        yield


@pytest.mark.usefixtures('endpoints')
def test_topics_have_types_and_counts_nodes_and_their_quality_of_service() -> None:
    process = barc('topics', '-v')
    assert (process.returncode, process.stderr) == (0, '')
    assert '/rosout [rcl_interfaces/msg/Log] 2 publishers, 0 subscribers' in process.stdout
    assert '_hidden' not in process.stdout

    paragraph = process.stdout.partition('/ecu [')[2]
    assert paragraph.startswith('barc_interfaces/msg/ECU] 1 publisher, 1 subscriber')

    publisher, subscription, *_ = paragraph.split('\n\n')[1:]
    assert 'Node name: talker\n' in publisher
    assert 'Endpoint type: PUBLISHER\n' in publisher
    assert 'Node name: listener\n' in subscription
    assert 'Reliability: RELIABLE\n' in subscription


TELEOP = {'/vehicle_simulator', '/relay', '/bag_recorder'}
TOPICS = {'/cmd_vel', '/ecu', '/z_vhcl', '/ez_vhcl', '/environment'}


def texts(path: Path) -> set[str]:
    """Return what is written in an SVG file."""
    nodes = ET.parse(path).iter('{http://www.w3.org/2000/svg}text')
    return {''.join(node.itertext()).strip() for node in nodes}


@pytest.mark.slow
@pytest.mark.usefixtures('ros_domain')
def test_graph_of_a_drive_by_hand_live_and_from_its_bag(tmp_path: Path) -> None:
    with started('teleop', '--view', 'none', cwd=tmp_path, stderr=subprocess.DEVNULL) as run:
        assert run.stdout
        run.stdout.readline()  # names the engine
        run.stdout.readline()  # it drives
        live = call('graph', '--save', 'live.svg', cwd=tmp_path)
        run.send_signal(signal.SIGTERM)
        run.communicate(timeout=200)
    assert live.returncode == 0, live.stderr

    (path,) = (tmp_path / 'bags').iterdir()
    for name in (['--bag', str(path)], [str(path)]):
        recorded = call('graph', *name, cwd=tmp_path)
        assert recorded.stdout.splitlines()[:-1] == live.stdout.splitlines()[:-1]
    for name in ('live.svg', 'graph.svg'):
        assert texts(tmp_path / name) >= TELEOP | TOPICS
    assert '/relay              turns the driver' in live.stdout

    graph = NodeGraph.from_json(bag.info(path)['graph'])
    assert set(graph.nodes) == TELEOP
    assert set(graph.topics) >= TOPICS
    assert ('/relay', '/ecu') in graph.publications
    assert ('/ecu', '/vehicle_simulator') in graph.subscriptions
    assert ('/ecu', '/bag_recorder') in graph.subscriptions


def test_the_graph_marks_the_nodes_of_others() -> None:
    graph = NodeGraph(('/rviz',), {}, (), ())
    assert lines(graph)[1] == '/rviz  (not of this package)'
