"""The recorder: what it records, from when, and how its bag ends."""

from __future__ import annotations

import re
import shutil
import time
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

import mcap_doctor
import yaml
from barc_interfaces.msg import ECU
from builtin_interfaces.msg import Time
from command_line import wait_for
from mcap.reader import SeekingReader
from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.action import ActionClient, ActionServer
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import (
    DurabilityPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.serialization import deserialize_message
from rclpy.service_introspection import ServiceIntrospectionState
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock
from std_msgs.msg import ColorRGBA, Float64
from std_srvs.srv import Trigger

from barc_sim.bags import reader as bag
from barc_sim.bags.contents import Contents
from barc_sim.bags.graph import NodeGraph
from barc_sim.bags.recording_settings import Recording
from barc_sim.errors import UserError
from barc_sim.nodes.recorder import BagRecorder
from barc_sim.ros.executor import QuickExecutor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from rclpy.action.server import ServerGoalHandle


LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture
def recorder(ros: Context, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[BagRecorder]:
    """Return a recorder, with the parameter as its settings."""
    node = BagRecorder(tmp_path, getattr(request, 'param', None), context=ros)
    yield node
    node.destroy_node()


@pytest.fixture
def talker(ros: Context, recorder: BagRecorder) -> Iterator[Node]:  # noqa: ARG001 (begins first)
    node = Node('talker', context=ros)
    yield node
    node.destroy_node()


@pytest.fixture
def stranger(ros_domain: int) -> Iterator[Node]:
    """Return a node of another DDS participant."""
    context = Context()
    context.init(domain_id=ros_domain)
    node = Node('stranger', context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def executor(ros: Context, recorder: BagRecorder) -> Iterator[QuickExecutor]:
    executor = QuickExecutor(2, context=ros)
    executor.add_node(recorder)
    yield executor
    executor.shutdown()


def messages(path: Path, topic: str) -> list[Any]:
    """Return the messages of a topic, read by a reader that is not ours."""
    (file,) = path.glob('*.mcap')
    with file.open('rb') as stream:
        reader = SeekingReader(stream, validate_crcs=True)
        return [message for _, _, message in reader.iter_messages(topics=[topic])]


def kept(recorder: BagRecorder, topic: str, kind: type[Any]) -> list[Any]:
    """Return what a topic's messages are in the bag, which is closed."""
    recorder.close()
    return [deserialize_message(message.data, kind) for message in messages(recorder.path, topic)]


def test_keeps_every_message_as_it_was_sent(recorder: BagRecorder, talker: Node) -> None:
    publisher = talker.create_publisher(ECU, 'ecu', 100)
    recorder.discover()
    sent = [ECU(motor=0.1 * k, servo=-0.01 * k) for k in range(250)]
    before = time.time_ns()
    for message in sent:
        publisher.publish(message)
    after = time.time_ns()
    assert kept(recorder, '/ecu', ECU) == sent
    records = messages(recorder.path, '/ecu')
    assert [message.sequence for message in records] == list(range(1, 251))
    for message in records:
        assert before <= message.publish_time <= message.log_time
        assert message.publish_time <= after


def test_records_the_log_and_events_of_constructors(recorder: BagRecorder, talker: Node) -> None:
    talker.declare_parameter('gain', 2.0)
    talker.get_logger().info('ready')
    recorder.announce()
    of_talker = [
        parameter.name
        for event in kept(recorder, '/parameter_events', ParameterEvent)
        if event.node == '/talker'
        for parameter in event.new_parameters
    ]
    assert 'use_sim_time' in of_talker
    assert 'gain' in of_talker
    logs = kept(recorder, '/rosout', Log)
    assert ('talker', 'ready') in [(log.name, log.msg) for log in logs]
    assert 'bag_recorder' in [log.name for log in logs]


def test_a_topic_without_a_definition_or_a_type(
    recorder: BagRecorder,
    executor: QuickExecutor,
    talker: Node,
    spin_until: Callable[[QuickExecutor, Callable[[], object]], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def missing(name: str) -> type[Any]:
        raise UserError(f'{name} is missing')

    monkeypatch.setattr('barc_sim.ros.topics.schema', {}.__getitem__)
    publisher = talker.create_publisher(Float64, 'value', LATCHED)
    recorder.discover()
    spin_until(executor, publisher.get_subscription_count)
    publisher.publish(Float64(data=2.0))
    monkeypatch.setattr('barc_sim.ros.recording.subscriptions.message_class', missing)
    talker.create_publisher(ColorRGBA, 'color', 10)
    recorder.discover()
    recorder.discover()
    assert kept(recorder, '/value', Float64) == [Float64(data=2.0)]
    why = 'std_msgs/msg/ColorRGBA: std_msgs/msg/ColorRGBA is missing'
    assert bag.info(recorder.path)['not recorded /color'] == why
    with AnyReader([recorder.path]) as reader:
        assert reader.topics['/value'].msgcount == 1
    texts = [deserialize_message(m.data, Log).msg for m in messages(recorder.path, '/rosout')]
    assert texts.count(f'/color is not recorded: {why}') == 1
    without = '/value is recorded without the definition of std_msgs/msg/Float64'
    assert sum(text.startswith(without) for text in texts) == 1


def test_parameter_overrides_the_folder(ros: Context, tmp_path: Path) -> None:
    override = Parameter('bag_dir', value=str(tmp_path / 'here'))
    node = BagRecorder(tmp_path / 'there', context=ros, parameter_overrides=[override])
    node.destroy_node()
    assert node.path.parent == tmp_path / 'here'


def recording(**settings: Any) -> pytest.MarkDecorator:  # noqa: ANN401 (of any kind)
    """Return the mark of a test whose recorder has these settings."""
    return pytest.mark.parametrize('recorder', [Recording(**settings)], indirect=True)


@recording(topics=(re.compile('value'),), min_free_space=0.0)
def test_what_a_full_disk_refuses_is_lost_also_after_the_node_is_destroyed(
    recorder: BagRecorder, talker: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(28, 'No space left on device')

    publisher = talker.create_publisher(Float64, 'value', 100)
    recorder.discover()
    publisher.publish(Float64())
    wait_for(lambda: recorder.counts.get('/value') == 1)
    monkeypatch.setattr('barc_sim.bags.appender.AtomicAppender.put', refuse)
    for _ in range(7):
        publisher.publish(Float64())
    recorder.destroy_node()
    assert recorder.counts == {'/value': 1}
    assert recorder.missing.lost['/value'] == {'bag_recorder': 7}


@recording(depth=5)
def test_losses_are_counted_for_each_publisher_and_kept(
    ros: Context, recorder: BagRecorder, talker: Node
) -> None:
    other = Node('other', context=ros)
    first, second = (node.create_publisher(Float64, 'value', 100) for node in (talker, other))
    recorder.discover()
    first.publish(Float64())
    second.publish(Float64())
    wait_for(lambda: recorder.counts.get('/value') == 2)
    for _ in range(500):
        first.publish(Float64())
    for _ in range(3):
        second.publish(Float64())
    recorder.close()
    other.destroy_node()
    lost = 505 - recorder.counts['/value']
    assert lost > 0
    assert recorder.missing.lost['/value'] == {'talker': lost}
    text = (recorder.path / 'metadata.yaml').read_text()
    custom = yaml.safe_load(text)['rosbag2_bagfile_information']['custom_data']
    for kept in (bag.info(recorder.path), custom):
        assert kept['lost_messages'] == str(lost)
        assert kept['lost /value'] == f'{lost} ({lost} of talker)'


@recording(depth=5)
def test_losses_have_the_name_of_a_node_that_is_discovered_after_its_publisher(
    recorder: BagRecorder, talker: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    publisher = talker.create_publisher(Float64, 'value', 100)
    find = recorder.get_publishers_info_by_topic

    def nameless(topic: str) -> list[Any]:
        ends = find(topic)
        for end in ends:
            end.node_name = '_NODE_NAME_UNKNOWN_'  # as rmw has it
        return ends

    with monkeypatch.context() as early:
        early.setattr(recorder, 'get_publishers_info_by_topic', nameless)
        recorder.discover()
    publisher.publish(Float64())
    wait_for(lambda: recorder.counts.get('/value') == 1)
    recorder.discover()
    for _ in range(500):
        publisher.publish(Float64())
    recorder.close()
    assert recorder.missing.lost['/value'] == {'talker': 501 - recorder.counts['/value']}


def test_late_publisher_that_offers_less_costs_the_others_nothing(
    recorder: BagRecorder, talker: Node
) -> None:
    # Deep enough for all, as DDS may complete the match only after some of them.
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    first = talker.create_publisher(Float64, 'value', latched)
    recorder.discover()
    for k in range(50):
        first.publish(Float64(data=float(k)))
        if k == 20:
            late = talker.create_publisher(Float64, 'value', BEST_EFFORT)
            recorder.discover()
    late.publish(Float64(data=-1.0))
    values = [message.data for message in kept(recorder, '/value', Float64)]
    assert sorted(values) == [-1.0, *map(float, range(50))]
    assert recorder.missing.lost['/value'] == {}


def test_a_topic_is_recorded_before_it_has_a_publisher(
    recorder: BagRecorder, talker: Node, stranger: Node
) -> None:
    recorder.expect(dict.fromkeys(('asked', 'silent'), 'std_msgs/msg/Float64'))
    for name in ('wanted', 'silent_too'):
        talker.create_subscription(Float64, name, lambda _: None, 10)
    recorder.discover()
    for topic in ('asked', 'wanted'):
        publisher = stranger.create_publisher(Float64, topic, 10)
        wait_for(lambda publisher=publisher: publisher.get_subscription_count() > 0)
        publisher.publish(Float64(data=5.0))
        assert publisher.wait_for_all_acked(Duration(seconds=30))
        stranger.destroy_publisher(publisher)
    recorder.close()  # `discover` was not called again
    assert {name for name in recorder.counts if not name.startswith('/r')} >= {'/asked', '/wanted'}
    with AnyReader([recorder.path]) as reader:
        assert not {'/silent', '/silent_too'} & set(reader.topics)
        for topic in ('/asked', '/wanted'):
            assert reader.topics[topic].msgcount == 1
            (connection,) = reader.topics[topic].connections
            assert connection.digest.startswith('RIHS01_')
    text = (recorder.path / 'metadata.yaml').read_text()
    assert 'name: /silent' not in text


@pytest.mark.parametrize('expected', [True, False], ids=['expected', 'found'])
@pytest.mark.parametrize('qos', [LATCHED, BEST_EFFORT, 10], ids=['latched', 'best effort', 'plain'])
def test_a_topic_is_recorded_as_its_publishers_offer_it(
    recorder: BagRecorder, talker: Node, qos: QoSProfile | int, *, expected: bool
) -> None:
    if expected:
        recorder.expect({'value': 'std_msgs/msg/Float64'})
    publisher = talker.create_publisher(Float64, 'value', qos)
    recorder.discover()
    publisher.publish(Float64(data=1.0))
    wait_for(lambda: recorder.counts.get('/value') == 1)
    publisher.publish(Float64(data=2.0))
    wait_for(lambda: recorder.counts.get('/value') == 2)
    recorder.close()
    assert recorder.missing.lost['/value'] == {}
    with AnyReader([recorder.path]) as reader:
        (connection,) = reader.topics['/value'].connections
        (offered,) = connection.ext.offered_qos_profiles
        expected = publisher.qos_profile
        assert offered.durability.name == expected.durability.name
        assert offered.reliability.name == expected.reliability.name


def test_a_type_that_replaces_another_between_two_searches_is_named(
    recorder: BagRecorder, stranger: Node
) -> None:
    first = stranger.create_publisher(Float64, 'value', 10)
    wait_for(lambda: recorder.discover() or first.get_subscription_count() == 1)
    stranger.destroy_publisher(first)
    stranger.create_publisher(ColorRGBA, 'value', 10)
    type_names = {'std_msgs/msg/Float64', 'std_msgs/msg/ColorRGBA'}
    wait_for(lambda: {*dict(recorder.get_topic_names_and_types())['/value']} == type_names)
    wait_for(lambda: recorder.discover() or bool(recorder.missing.left_out))
    why = 'its type is std_msgs/msg/Float64'
    assert recorder.missing.left_out == {'/value as std_msgs/msg/ColorRGBA': why}


def test_a_publisher_that_replaces_another_between_two_searches_is_recorded(
    recorder: BagRecorder, stranger: Node
) -> None:
    first = stranger.create_publisher(Float64, 'value', 10)
    wait_for(lambda: recorder.discover() or first.get_subscription_count() == 1)
    wait_for(lambda: recorder.discover() or recorder._source._topics['/value'].publishers == 1)  # noqa: SLF001
    stranger.destroy_publisher(first)
    second = stranger.create_publisher(Float64, 'value', BEST_EFFORT)
    infos = recorder.get_publishers_info_by_topic
    wait_for(
        lambda: (
            [each.qos_profile.reliability for each in infos('/value')] == [BEST_EFFORT.reliability]
        )
    )
    wait_for(lambda: recorder.discover() or second.get_subscription_count() == 1)
    second.publish(Float64(data=2.0))
    wait_for(lambda: recorder.counts.get('/value') == 1)


def test_nothing_from_a_best_effort_publisher_is_an_unknown_loss(
    recorder: BagRecorder, talker: Node
) -> None:
    for name, qos in (('silent', BEST_EFFORT), ('idle', 10), ('heard', BEST_EFFORT)):
        publisher = talker.create_publisher(Float64, name, qos)
    recorder.discover()
    publisher.publish(Float64())
    wait_for(lambda: recorder.counts.get('/heard') == 1)
    recorder.close()
    why = 'no message arrived from talker, which sends with best effort'
    assert recorder.missing.unknown == {'/silent': why}
    assert bag.info(recorder.path)['lost /silent'] == f'unknown: {why}'
    assert recorder.summary.splitlines()[0].endswith('lost 0 or more')


def test_what_the_middleware_could_not_deliver_is_lost(
    recorder: BagRecorder, talker: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('barc_sim.ros.recording.topic.undelivered', lambda _: 18)
    talker.create_publisher(Float64, 'image', BEST_EFFORT)
    recorder.discover()
    recorder.close()
    assert recorder.missing.lost['/image'] == {'talker': 18}


def test_the_feedback_of_an_action_is_recorded_with_its_definition(
    ros: Context, tmp_path: Path
) -> None:
    from test_msgs.action import Fibonacci  # noqa: PLC0415

    kind = Fibonacci.Impl.FeedbackMessage
    hidden = Recording(topics=[re.compile('feedback')])
    recorder, talker = BagRecorder(tmp_path, hidden, context=ros), Node('talker', context=ros)
    publisher = talker.create_publisher(kind, 'count/_action/feedback', 10)
    recorder.discover()
    sent = kind(feedback=Fibonacci.Feedback(sequence=[1, 1, 2]))
    publisher.publish(sent)
    recorder.destroy_node()
    talker.destroy_node()
    with AnyReader([recorder.path]) as reader:
        ((connection, _, data),) = reader.messages()
        assert connection.msgtype == 'test_msgs/action/Fibonacci_FeedbackMessage'
        read: Any = reader.deserialize(data, connection.msgtype)
    assert read.feedback.sequence.tolist() == [1, 1, 2]
    assert recorder.missing.left_out == {}


def overridden(**policies: object) -> pytest.MarkDecorator:
    """Return the mark of a test whose recorder subscribes to `value` with these policies."""
    return recording(qos_overrides={'/value': policies})


@overridden(reliability='best_effort', depth=10)
def test_an_override_replaces_what_the_publishers_offer(
    recorder: BagRecorder, talker: Node
) -> None:
    # Deep enough for all, as DDS may complete the match only after some of them.
    publisher = talker.create_publisher(Float64, 'value', 100)
    weak = talker.create_publisher(Float64, 'value', BEST_EFFORT)
    recorder.discover()
    (subscription,) = talker.get_subscriptions_info_by_topic('/value')
    assert subscription.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    for k in range(50):  # more than the depth of the override
        publisher.publish(Float64(data=float(k)))
    weak.publish(Float64(data=-1.0))
    values = [message.data for message in kept(recorder, '/value', Float64)]
    assert sorted(values) == [-1.0, *map(float, range(50))]


@overridden(
    history='keep_all',
    depth=0,
    reliability='reliable',
    durability='transient_local',
    deadline={'sec': 0, 'nsec': 0},
    lifespan={'sec': 0, 'nsec': 0},
    liveliness='automatic',
    liveliness_lease_duration={'sec': 0, 'nsec': 0},
    avoid_ros_namespace_conventions=False,
)
def test_a_whole_profile_with_a_queue_without_limit_is_taken(
    recorder: BagRecorder, talker: Node
) -> None:
    latched = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = talker.create_publisher(Float64, 'value', latched)
    for k in range(1000):
        publisher.publish(Float64(data=float(k)))
    recorder.discover()
    wait_for(lambda: recorder.counts.get('/value') == 1000)
    recorder.close()
    assert recorder.missing.lost['/value'] == {}


@overridden(durability='volatile')
@pytest.mark.parametrize('expected', [True, False], ids=['expected', 'found'])
def test_a_volatile_override_leaves_out_what_a_publisher_has_kept(
    recorder: BagRecorder, talker: Node, *, expected: bool
) -> None:
    publisher = talker.create_publisher(Float64, 'value', LATCHED)
    publisher.publish(Float64(data=1.0))
    if expected:
        recorder.expect({'value': 'std_msgs/msg/Float64'})
    recorder.discover()
    publisher.publish(Float64(data=2.0))
    assert kept(recorder, '/value', Float64) == [Float64(data=2.0)]


@overridden(reliability='reliable', durability='transient_local')
def test_a_publisher_that_does_not_match_the_override_is_named(
    recorder: BagRecorder, talker: Node
) -> None:
    talker.create_publisher(Float64, 'value', BEST_EFFORT)
    recorder.discover()
    recorder.discover()
    why = (
        'it does not match the quality of service that is set for the topic: '
        'Best effort publisher and reliable subscription, '
        'Volatile publisher and transient local subscription'
    )
    assert recorder.missing.left_out == {'/value of talker': why}
    recorder.close()
    texts = [deserialize_message(m.data, Log).msg for m in messages(recorder.path, '/rosout')]
    assert texts.count(f'/value of talker is not recorded: {why}') == 1


@overridden(reliability='best_effort')
def test_nothing_over_a_best_effort_override_is_an_unknown_loss(
    recorder: BagRecorder, talker: Node
) -> None:
    talker.create_publisher(Float64, 'value', 10)
    recorder.discover()
    why = 'no message arrived from talker, which sends with best effort'
    assert recorder.missing.unknown == {'/value': why}


@recording(topic_types=['std_msgs/msg/Float64'], exclude_topic_types=['std_msgs/msg/ColorRGBA'])
def test_topics_are_chosen_by_their_type(recorder: BagRecorder, talker: Node) -> None:
    recorder.expect({'asked': 'std_msgs/msg/Float64', 'color': 'std_msgs/msg/ColorRGBA'})
    publishers = [talker.create_publisher(Float64, name, 10) for name in ('asked', 'found')]
    publishers.append(talker.create_publisher(ColorRGBA, 'color', 10))
    recorder.discover()
    for publisher in publishers:
        publisher.publish(publisher.msg_type())
    recorder.close()
    assert recorder.counts == {'/asked': 1, '/found': 1}


@recording(include_hidden_topics=True)
def test_hidden_topics_of_actions_and_services_are_recorded(
    recorder: BagRecorder,
    executor: QuickExecutor,
    talker: Node,
    spin_until: Callable[[QuickExecutor, Callable[[], object]], None],
) -> None:
    from test_msgs.action import Fibonacci  # noqa: PLC0415

    def count(goal: ServerGoalHandle) -> Fibonacci.Result:
        goal.publish_feedback(Fibonacci.Feedback(sequence=[1, 1, 2]))
        goal.succeed()
        return Fibonacci.Result(sequence=[1, 1, 2, 3])

    executor.add_node(talker)
    server = ActionServer(talker, Fibonacci, 'count', count)
    client = ActionClient(talker, Fibonacci, 'count')
    stop = talker.create_service(Trigger, 'stop', lambda _, response: response)
    stop.configure_introspection(
        talker.get_clock(), QoSProfile(depth=10), ServiceIntrospectionState.CONTENTS
    )
    recorder.discover()

    goal = client.send_goal_async(Fibonacci.Goal(order=4))
    spin_until(executor, goal.done)
    result = goal.result().get_result_async()
    spin_until(executor, result.done)
    stopped = talker.create_client(Trigger, 'stop').call_async(Trigger.Request())
    spin_until(executor, stopped.done)
    client.destroy()
    server.destroy()
    recorder.close()

    hidden = {name: count for name, count in recorder.counts.items() if '/_' in name}
    assert hidden.keys() == {
        '/count/_action/feedback',
        '/count/_action/status',
        '/stop/_service_event',
    }
    assert hidden['/count/_action/feedback'] == 1
    with AnyReader([recorder.path]) as reader:
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)  # with the bag's own definitions
    assert recorder.missing.left_out == {}


@recording(use_sim_time=True, exclude=(re.compile('clock'),))
def test_nothing_before_the_first_clock_is_recorded_and_its_number_is_kept(
    recorder: BagRecorder, talker: Node
) -> None:
    publisher = talker.create_publisher(Float64, 'value', 10)
    clock = talker.create_publisher(Clock, '/clock', 10)
    recorder.discover()
    publisher.publish(Float64(data=1.0))
    clock.publish(Clock(clock=Time(sec=7)))
    publisher.publish(Float64(data=2.0))
    recorder.close()
    ((value),) = messages(recorder.path, '/value')
    assert value.log_time == 7 * 10**9
    assert recorder.counts == {'/value': 1}
    left_out = recorder.missing.before_clock
    assert left_out >= 1
    assert f'not recorded before /clock: {left_out} messages' in recorder.summary
    assert bag.info(recorder.path)['not recorded before /clock'] == f'{left_out} messages'


@pytest.mark.parametrize('expected', [True, False], ids=['expected', 'found'])
def test_a_second_type_of_a_topic_is_named_and_costs_the_first_nothing(
    recorder: BagRecorder, talker: Node, stranger: Node, *, expected: bool
) -> None:
    other = stranger.create_publisher(ColorRGBA, 'value', LATCHED)
    if expected:
        recorder.expect({'value': 'std_msgs/msg/Float64'})
    # DDS accepts one type of a topic in a participant, which is the recorder's, too.
    talker.create_subscription(Float64, 'value', lambda _: None, 10)
    wait_for(lambda: recorder.discover() or bool(recorder.missing.left_out))
    why = 'its type is std_msgs/msg/Float64'
    assert recorder.missing.left_out == {'/value as std_msgs/msg/ColorRGBA': why}
    publisher = talker.create_publisher(Float64, 'value', 10)
    wait_for(lambda: recorder.discover() or publisher.get_subscription_count() == 2)
    other.publish(ColorRGBA())
    publisher.publish(Float64())
    wait_for(lambda: recorder.counts.get('/value') == 1)
    recorder.close()
    assert bag.info(recorder.path)['not recorded /value as std_msgs/msg/ColorRGBA'] == why
    texts = [deserialize_message(m.data, Log).msg for m in messages(recorder.path, '/rosout')]
    assert [text for text in texts if 'is not recorded' in text] == [
        f'/value as std_msgs/msg/ColorRGBA is not recorded: {why}'
    ]


def test_of_two_publishers_types_that_of_the_same_process_is_recorded(
    stranger: Node, recorder: BagRecorder, talker: Node
) -> None:
    stranger.create_publisher(ColorRGBA, 'value', 10)
    wait_for(lambda: talker.count_publishers('value') == 1)
    publisher = talker.create_publisher(Float64, 'value', LATCHED)
    publisher.publish(Float64())
    wait_for(lambda: recorder.discover() or recorder.counts.get('/value') == 1)
    why = 'its type is std_msgs/msg/Float64'
    assert recorder.missing.left_out == {'/value as std_msgs/msg/ColorRGBA': why}


def test_what_a_publisher_has_kept_is_recorded_beside_one_that_keeps_nothing(
    ros: Context, tmp_path: Path
) -> None:
    talker = Node('talker', context=ros)
    talker.create_publisher(Float64, 'value', 10)
    talker.create_publisher(Float64, 'value', LATCHED).publish(Float64())
    recorder = BagRecorder(tmp_path, context=ros)
    wait_for(lambda: recorder.counts.get('/value') == 1)
    recorder.destroy_node()
    talker.destroy_node()


def test_a_publisher_in_place_of_one_that_has_gone_is_recorded(
    recorder: BagRecorder, talker: Node
) -> None:
    for count, qos in enumerate((10, BEST_EFFORT), start=1):
        publisher = talker.create_publisher(Float64, 'value', qos)
        recorder.discover()
        publisher.publish(Float64())
        wait_for(lambda count=count: recorder.counts.get('/value') == count)
        talker.destroy_publisher(publisher)
        recorder.discover()


@pytest.fixture
def request_service(
    talker: Node,
    executor: QuickExecutor,
    spin_until: Callable[..., None],
) -> Callable[[str], tuple[bool, str]]:
    """Return a function that calls one of the recorder's services."""
    executor.add_node(talker)

    def call(name: str) -> tuple[bool, str]:
        client = talker.create_client(Trigger, f'bag_recorder/{name}')
        response = client.call_async(Trigger.Request())
        spin_until(executor, response.done)
        return response.result().success, response.result().message

    return call


def test_services_pause_and_resume(
    recorder: BagRecorder, talker: Node, request_service: Callable[[str], tuple[bool, str]]
) -> None:
    publisher = talker.create_publisher(Float64, 'value', 10)
    recorder.discover()
    wait_for(publisher.get_subscription_count)
    assert request_service('pause') == (True, 'paused')
    publisher.publish(Float64(data=1.0))
    assert publisher.wait_for_all_acked(Duration(seconds=100.0))
    assert request_service('resume') == (True, 'recording')
    publisher.publish(Float64(data=2.0))
    wait_for(lambda: recorder.counts.get('/value') == 1)
    recorder.close()
    assert recorder.counts['/value'] == 1
    assert recorder.missing.lost['/value'] == {}


@recording(topics=[re.compile('value')], max_bag_duration=0.2, compression_format='lz4')
def test_a_new_file_begins_after_the_duration(recorder: BagRecorder, talker: Node) -> None:
    publisher = talker.create_publisher(Float64, 'value', 1000)
    recorder.discover()
    sent: list[float] = []

    def has_split() -> bool:
        sent.append(float(len(sent)))
        publisher.publish(Float64(data=sent[-1]))
        return len(recorder.files) == 3

    wait_for(has_split)
    recorder.close()
    with AnyReader([recorder.path]) as reader:
        values: list[Any] = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
        ]
    assert [value.data for value in values] == sent
    assert f'recorded {len(sent)} messages in 3 files, lost 0' == recorder.summary
    for file in recorder.files:
        mcap_doctor.check(file)
        with file.open('rb') as stream:
            summary = SeekingReader(stream, validate_crcs=True).get_summary()
        assert summary
        assert summary.statistics
        assert {index.compression for index in summary.chunk_indexes} == {'lz4'}
        span = summary.statistics.message_end_time - summary.statistics.message_start_time
        assert span <= 2e8


@recording(start_paused=True)
def test_a_recording_that_starts_paused_begins_with_resume(
    recorder: BagRecorder, talker: Node
) -> None:
    publisher = talker.create_publisher(Float64, 'value', 10)
    recorder.discover()
    publisher.publish(Float64(data=1.0))
    assert recorder.is_paused
    recorder.announce()
    recorder.resume()
    publisher.publish(Float64(data=2.0))
    assert kept(recorder, '/value', Float64) == [Float64(data=2.0)]


def test_messages_around_a_pause_are_recorded(recorder: BagRecorder, talker: Node) -> None:
    publisher = talker.create_publisher(Float64, 'value', 10)
    recorder.discover()
    for value in (1.0, 2.0, 3.0):
        publisher.publish(Float64(data=value))
        if value == 1.0:
            recorder.pause()
        else:
            recorder.resume()
    assert kept(recorder, '/value', Float64) == [Float64(data=1.0), Float64(data=3.0)]


@recording(topics=[re.compile('value')])
def test_a_service_splits_the_bag(
    recorder: BagRecorder, talker: Node, request_service: Callable[[str], tuple[bool, str]]
) -> None:
    publisher = talker.create_publisher(Float64, 'value', 10)
    recorder.discover()
    for value in (1.0, 2.0):
        publisher.publish(Float64(data=value))
        assert request_service('split_bagfile') == (
            True,
            f'recording to {str(recorder.files[-1])!r}',
        )
    assert recorder.counts == {'/value': 2}
    recorder.close()
    with AnyReader(recorder.files) as reader:
        assert reader.topics['/value'].msgcount == 2
    assert [len(Contents(file).counted) for file in recorder.files] == [1, 1, 0]


@recording(topics=[re.compile('value')], snapshot_mode=True, max_cache_size=3000)
def test_a_snapshot_has_the_newest_messages(
    recorder: BagRecorder, talker: Node, request_service: Callable[[str], tuple[bool, str]]
) -> None:
    publisher = talker.create_publisher(Float64, 'value', 100)
    recorder.discover()
    recorder.announce()
    for k in range(50):
        publisher.publish(Float64(data=float(k)))
    assert request_service('snapshot') == (True, 'the messages in memory are written')
    wait_for(lambda: recorder.counts)
    publisher.publish(Float64(data=-1.0))
    assert recorder.missing.total == 0
    values = [message.data for message in kept(recorder, '/value', Float64)]
    assert 2 < len(values) < 20
    assert values == [float(k) for k in range(50)][-len(values) :]


def test_without_snapshot_mode_the_service_names_the_option(
    recorder: BagRecorder,  # noqa: ARG001 (is called)
    request_service: Callable[[str], tuple[bool, str]],
) -> None:
    why = 'all messages are written at once: record with --snapshot-mode'
    assert request_service('snapshot') == (False, why)


def test_keys_pause_and_end_it(recorder: BagRecorder) -> None:
    recorder.on_key('space')
    assert recorder.is_paused
    recorder.on_key('space')
    assert not recorder.is_paused
    recorder.on_key('quit')
    assert recorder.finished.done()


def test_a_write_error_ends_the_run(recorder: BagRecorder) -> None:
    shutil.rmtree(recorder.path)
    wait_for(recorder.finished.done)
    assert str(recorder.failure).endswith('failed: it was removed while recording')
    recorder.close()
    assert not recorder.path.exists()


def test_graph_is_in_the_bag_without_a_run(recorder: BagRecorder, talker: Node) -> None:
    talker.create_publisher(Float64, 'speed', 10)
    recorder.close()
    graph = NodeGraph.from_json(bag.info(recorder.path)['graph'])
    assert graph.nodes == ('/bag_recorder', '/talker')
    assert ('/talker', '/speed') in graph.publications
