"""The player: what it publishes of a bag, when, and with which QoS."""

from __future__ import annotations

import math
import re
import time
from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from command_line import refused, started
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from barc_sim.bags.messages import BagMessage, Topic, topic
from barc_sim.bags.playback_settings import Playback
from barc_sim.bags.writer import BagWriter
from barc_sim.errors import UserError
from barc_sim.nodes.player import BagPlayer
from barc_sim.ros.executor import QuickExecutor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from rclpy.context import Context

SECOND = 10**9
MATCHING = 0.2  #: [s] in which the player waits for subscriptions


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Return a bag with ten messages on /a and /b in 0.9 s, and one of a type that nobody has."""
    (tmp_path / 'bag').mkdir()
    writer = BagWriter(tmp_path / 'bag')
    topics = [topic(name, 'std_msgs/msg/Header') for name in ('/a', '/b')]
    for k in range(10):
        data = bytes([0, 1, 0, 0, k, *bytes(7), 1, 0, 0, 0, 0])
        for each in topics:
            received = 5 * SECOND + SECOND // 10 * k
            writer.write([BagMessage(each, data, received, received, k)])
    foreign = Topic(name='/c', type='nobody/msg/X', definition='', type_hash='', offered_qos=[])
    writer.write([BagMessage(foreign, bytes(8), 5 * SECOND, 0, 1)])
    writer.close()
    return tmp_path / 'bag'


class Played:
    """A player with a listener that keeps what arrives on each topic."""

    def __init__(self, ros: Context, bags: Sequence[Path], **settings: Any) -> None:  # noqa: ANN401
        self.arrived: dict[str, list[int]] = {}
        self.times: list[float] = []
        self.listener = Node('listener', context=ros)
        for name in ('a', 'b', 'moved'):
            self.listen(name)
        self.listener.create_subscription(Clock, '/clock', self.on_clock, 100)
        self.clocks: list[int] = []
        self.player = BagPlayer(bags, Playback(**settings), context=ros)
        self.executor = QuickExecutor(2, context=ros)
        for node in (self.listener, self.player):
            self.executor.add_node(node)

    def listen(self, name: str) -> None:
        """Keep the seconds of what arrives on a topic."""

        def keep(message: Header) -> None:
            self.arrived.setdefault(name, []).append(message.stamp.sec)
            self.times.append(time.monotonic())

        self.listener.create_subscription(Header, name, keep, 100)

    def on_clock(self, message: Clock) -> None:
        """Keep a time [ns]."""
        self.clocks.append(message.clock.sec * SECOND + message.clock.nanosec)

    def close(self) -> None:
        """End both nodes."""
        self.executor.shutdown()
        self.player.destroy_node()
        self.listener.destroy_node()


@pytest.fixture
def play(
    ros: Context, bag: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., Played]]:
    """Return a function that plays the bag with the given settings."""
    monkeypatch.setattr('barc_sim.nodes.playback_publishers._MATCHING', MATCHING)
    made: list[Played] = []

    def begin(*bags: Path, **settings: Any) -> Played:  # noqa: ANN401
        made.append(Played(ros, bags or [bag], **settings))
        return made[-1]

    yield begin
    for each in made:
        each.close()


def test_every_message_is_published_in_order(
    play: Callable[..., Played], spin_until: Callable[..., None]
) -> None:
    begin = time.monotonic()
    played = play(rate=2.0)
    spin_until(played.executor, played.player.finished.done)
    spin_until(played.executor, lambda: len(played.arrived.get('b', [])) == 10)
    assert played.arrived == {'a': [*range(10)], 'b': [*range(10)]}
    assert played.player.played == 20
    assert played.player.failure is None
    # It waits for subscriptions, and then keeps the spacing; the exact one is measured in quiet.
    assert played.times[-1] - begin > MATCHING + 0.45


def test_topics_offset_and_clock(
    play: Callable[..., Played], spin_until: Callable[..., None]
) -> None:
    settings = {'topics': [re.compile('/a')], 'start_offset': 0.45, 'clock': 100.0}
    played = play(rate=10.0, **settings)
    spin_until(
        played.executor, lambda: (len(played.arrived.get('a', [])), len(played.clocks)) == (5, 5)
    )
    assert played.arrived == {'a': [5, 6, 7, 8, 9]}
    assert sorted(played.clocks) == [5 * SECOND + SECOND // 100 * ms for ms in range(45, 91, 10)]


LATCHED_QOS = {'durability': 'transient_local', 'reliability': 'reliable', 'depth': 0}


def written(directory: Path, messages: Sequence[tuple[Topic, int, int]]) -> Path:
    """Return a bag of messages, each with its topic, its number and time of reception."""
    directory.mkdir()
    writer = BagWriter(directory)
    for each, number, received in messages:
        data = bytes([0, 1, 0, 0, number, *bytes(7), 1, 0, 0, 0, 0])
        writer.write([BagMessage(each, data, received, received, number)])
    writer.close()
    return directory


def header_topic(name: str, *qos: dict[str, Any]) -> Topic:
    return replace(topic(name, 'std_msgs/msg/Header'), offered_qos=qos)


def test_an_offset_begins_with_what_latched_topics_hold_once(
    play: Callable[..., Played], spin_until: Callable[..., None], tmp_path: Path
) -> None:
    static = header_topic('/a', *[LATCHED_QOS] * 2)  # of two publishers
    log = header_topic('/b', LATCHED_QOS | {'lifespan': {'sec': 1, 'nsec': 0}, 'depth': 2})
    plain = topic('/moved', 'std_msgs/msg/Header')
    times = [(static, 1, 0), (static, 2, SECOND), (log, 1, SECOND)]
    times += [(log, k, 9 * SECOND + k) for k in (2, 3, 4)]
    times += [(plain, k, k * SECOND) for k in range(12)] + [(static, 9, 11 * SECOND)]
    latched = written(tmp_path / 'latched', sorted(times, key=itemgetter(2)))
    played = play(latched, start_offset=10.0, rate=20.0, loop=True)
    spin_until(played.executor, lambda: len(played.arrived.get('moved', [])) >= 4)
    played.player.controls.on_key('quit')
    spin_until(played.executor, played.player.finished.done)
    assert played.arrived['moved'][:4] == [10, 11] * 2
    assert played.arrived['a'][:4] == [1, 2, 9, 9]
    assert played.arrived['b'] == [3, 4]


def test_large_latched_messages_are_held_once_for_each_publisher() -> None:
    from barc_sim.nodes.latched_messages import LatchedMessages  # noqa: PLC0415

    maps = header_topic('/map', *[LATCHED_QOS] * 2)
    sent = [BagMessage(maps, bytes(1 << 20), k, k, k) for k in range(5)]
    latched = LatchedMessages(SECOND, [maps])
    latched.add_earlier(sent)
    assert latched.held() == sent[3:]

    by_blocks = LatchedMessages(SECOND, [maps])
    for each in reversed(sent):
        assert by_blocks.wants({id(maps)}, each.received) == (each.received >= 2)
        by_blocks.add_earlier([each])
    assert by_blocks.held() == sent[3:]


@pytest.mark.parametrize(
    ('lifespan', 'held'),
    [
        ({'sec': 10, 'nsec': 5}, 10 * SECOND + 5),
        ({'sec': 'a' * 100, 'nsec': 0}, math.inf),
        ({'sec': 1}, math.inf),
        ([], math.inf),
        (None, math.inf),
    ],
)
def test_a_latched_topic_holds_for_its_lifespan(lifespan: object, held: float) -> None:
    from barc_sim.ros.topics import latch  # noqa: PLC0415

    recorded = [LATCHED_QOS | {'lifespan': lifespan, 'depth': 3}, {'durability': 'volatile'}]
    assert latch(recorded) == (3, held)
    assert latch(recorded[1:]) is None


def test_several_bags_are_played_as_one_in_order_of_reception(
    play: Callable[..., Played], spin_until: Callable[..., None], tmp_path: Path
) -> None:
    a, moved = (topic(name, 'std_msgs/msg/Header') for name in ('/a', '/moved'))
    first = written(tmp_path / 'first', [(a, k, k * SECOND) for k in (1, 2, 5)])
    second = written(tmp_path / 'second', [(a, 3, 3 * SECOND), (moved, 4, 4 * SECOND)])
    # At one time, the message of the earlier bag comes first.
    third = written(tmp_path / 'third', [(a, 6, 5 * SECOND), (moved, 7, 6 * SECOND)])
    played = play(first, second, third, rate=20.0)
    spin_until(played.executor, played.player.finished.done)
    spin_until(played.executor, lambda: len(played.times) == 7)
    assert played.arrived == {'a': [1, 2, 3, 5, 6], 'moved': [4, 7]}
    assert played.listener.count_publishers('/a') == 1
    assert played.player.progress.strip() == '5.0 / 5.0 s  7 messages  x20'


def test_records_of_a_topic_with_another_qos_have_one_publisher_that_serves_all(
    play: Callable[..., Played], spin_until: Callable[..., None], tmp_path: Path
) -> None:
    poor = header_topic('/a', {'reliability': 'best_effort', 'durability': 'volatile'})
    rich = header_topic('/a', LATCHED_QOS)
    played = play(written(tmp_path / 'two', [(poor, 1, 1), (rich, 2, 2), (poor, 3, 3)]))
    (publisher,) = played.listener.get_publishers_info_by_topic('/a')
    spin_until(played.executor, lambda: len(played.arrived.get('a', [])) == 3)
    assert played.arrived == {'a': [1, 2, 3]}
    assert publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL


@pytest.mark.parametrize(
    ('settings', 'played_messages'),
    [
        ({'duration': 0.5}, [*range(6)]),
        ({'start_offset': 0.2, 'duration': 0.3}, [2, 3, 4, 5]),
        ({'until': 5_500_000_000}, [*range(6)]),
        ({'until': 5_500_000_000, 'duration': 0.7}, [*range(8)]),  # the later end counts
    ],
    ids=str,
)
def test_the_playback_ends_at_a_time(
    play: Callable[..., Played],
    spin_until: Callable[..., None],
    settings: dict[str, float],
    played_messages: list[int],
) -> None:
    played = play(rate=50.0, topics=[re.compile('/a')], **settings)
    spin_until(played.executor, played.player.finished.done)
    spin_until(played.executor, lambda: len(played.times) == len(played_messages))
    assert played.arrived == {'a': played_messages}
    seconds = max(settings.get('start_offset', 0.0) + settings.get('duration', 0.0), 0.5)
    assert played.player.progress.strip().startswith(f'{seconds:.1f} / 0.9 s')


def test_each_turn_of_a_loop_begins_after_the_delay(
    play: Callable[..., Played], spin_until: Callable[..., None], tmp_path: Path
) -> None:
    one = written(tmp_path / 'one', [(topic('/a', 'std_msgs/msg/Header'), 1, SECOND)])
    begin = time.monotonic()
    played = play(one, loop=True, delay=0.3, clock=100.0)
    spin_until(played.executor, lambda: len(played.times) >= 2)
    assert played.times[1] - begin >= 0.6
    assert {*played.clocks} == {SECOND}  # it is published during the delay, too
    assert len(played.clocks) > 2


def test_a_topic_has_the_qos_that_the_user_sets(
    play: Callable[..., Played], spin_until: Callable[..., None]
) -> None:
    overrides = {'/a': {'durability': 'transient_local', 'lifespan': {'sec': 7, 'nsec': 0}}}
    played = play(rate=50.0, qos_overrides=overrides)
    (changed,) = played.listener.get_publishers_info_by_topic('/a')
    (other,) = played.listener.get_publishers_info_by_topic('/b')
    spin_until(played.executor, lambda: len(played.times) == 20)
    assert changed.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert changed.qos_profile.lifespan.nanoseconds == 7 * SECOND
    assert other.qos_profile.durability == DurabilityPolicy.VOLATILE


@pytest.mark.parametrize('clock', [None, 40.0], ids=['no clock', 'clock'])
def test_a_gap_of_years_is_skipped_with_a_warning(
    play: Callable[..., Played],
    spin_until: Callable[..., None],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    clock: float | None,
) -> None:
    plain, year = topic('/a', 'std_msgs/msg/Header'), 31_536_000 * SECOND
    times = [4 * SECOND, 5 * SECOND, 57 * year, 57 * year + SECOND]
    early = written(tmp_path / 'early', [(plain, k, at) for k, at in enumerate(times)])
    played = play(early, rate=20.0, clock=clock)
    spin_until(played.executor, played.player.finished.done)
    spin_until(played.executor, lambda: len(played.arrived.get('a', [])) == 4)
    assert played.arrived == {'a': [0, 1, 2, 3]}
    assert 'the bag has a gap of 1797551995 s after 1.0 s: skipped' in capfd.readouterr().err


def test_the_clock_is_published_during_a_pause(
    play: Callable[..., Played], spin_until: Callable[..., None]
) -> None:
    played = play(rate=10.0, start_paused=True, clock=40.0)
    spin_until(played.executor, lambda: len(played.clocks) >= 3)
    assert {*played.clocks} == {5 * SECOND}


def test_of_two_types_of_a_topic_the_first_is_played(
    play: Callable[..., Played],
    spin_until: Callable[..., None],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    plain, other = topic('/a', 'std_msgs/msg/Header'), topic('/a', 'std_msgs/msg/Float64')
    foreign = replace(plain, name='/b', message_encoding='json')
    nameless = replace(plain, name='/c', type='', schema_encoding=None)
    messages = [(plain, 1, 1), (other, 2, 2), (foreign, 3, 3), (nameless, 4, 4), (plain, 5, 5)]
    played = play(written(tmp_path / 'two', messages))
    spin_until(played.executor, played.player.finished.done)
    spin_until(played.executor, lambda: len(played.arrived.get('a', [])) == 2)
    assert played.arrived == {'a': [1, 5]}
    assert played.player.played == 2
    err = capfd.readouterr().err
    assert '/a as std_msgs/msg/Float64 is not played: std_msgs/msg/Header is played' in err
    assert "/b is not played: its messages are 'json', and not 'cdr'" in err
    assert '/c is not played: the bag does not have its type' in err


def test_excluded_topics_are_not_played_and_a_loop_begins_again(
    play: Callable[..., Played], spin_until: Callable[..., None]
) -> None:
    played = play(rate=50.0, loop=True, exclude=[re.compile('a')])
    spin_until(played.executor, lambda: len(played.arrived.get('b', [])) >= 20)
    assert played.arrived['b'][:20] == [*range(10)] * 2
    assert 'a' not in played.arrived
    played.player.controls.on_key('quit')
    spin_until(played.executor, played.player.finished.done)


def test_the_right_arrow_steps_one_message_and_space_goes_on(
    play: Callable[..., Played], spin_until: Callable[..., None]
) -> None:
    played = play(rate=100.0, start_paused=True)
    for count in (1, 2, 3):
        played.player.controls.on_key('right')
        spin_until(played.executor, lambda count=count: len(played.times) == count)
    assert played.player.progress.endswith('paused')
    assert played.arrived == {'a': [0, 1], 'b': [0]}
    played.player.controls.on_key('space')
    spin_until(played.executor, lambda: len(played.times) == 20)


@pytest.mark.parametrize(
    ('recorded', 'reliable', 'latched'),
    [
        ([], True, False),
        ([{'reliability': 'best_effort', 'durability': 'volatile'}], False, False),
        ([{'reliability': 1, 'durability': 1, 'depth': 3}], True, True),
        ([{'reliability': 'best_effort'}, {'durability': 'transient_local'}], True, True),
    ],
)
def test_a_topic_has_the_recorded_qos(
    recorded: list[dict[str, Any]], reliable: bool, latched: bool
) -> None:
    from barc_sim.ros.topics import offer  # noqa: PLC0415

    made: QoSProfile = offer(recorded)
    assert (made.reliability == ReliabilityPolicy.RELIABLE) == reliable
    assert (made.durability == DurabilityPolicy.TRANSIENT_LOCAL) == latched


def test_what_cannot_be_played_is_one_sentence(ros: Context, bag: Path) -> None:
    with pytest.raises(UserError, match=r'has 0\.900 s of messages: give a shorter --start-offset'):
        BagPlayer([bag], Playback(start_offset=1.0), context=ros)
    with pytest.raises(
        UserError,
        match=r'would begin at 5\.500 s, after its end at 5\.400 s: give a later --playback',
    ):
        BagPlayer([bag], Playback(start_offset=0.5, until=5_400_000_000), context=ros)
    with pytest.raises(UserError, match=r"bag' with '.*bag' has 0\.900 s of messages"):
        BagPlayer([bag, bag], Playback(start_offset=1.0), context=ros)
    with pytest.raises(UserError, match='has no topic that can be played'):
        BagPlayer([bag], Playback(topics=[re.compile('/c')]), context=ros)
    with pytest.raises(UserError, match='parameter rate of bag_player: 0 is not a number from'):
        BagPlayer([bag], context=ros, parameter_overrides=[Parameter('rate', value=0.0)])


@pytest.mark.parametrize(
    'odd',
    [
        {'name': 'a b'},
        {'type': 'std_msgs/Header'},
        {'type': 'os/path/join'},
        {'type': 'rclpy/action/ActionClient'},
        {'type': '.a/msg/B'},
        {'offered_qos': [{'depth': 'many'}]},
    ],
    ids=str,
)
def test_a_topic_that_rcl_refuses_is_left_out(
    ros: Context, tmp_path: Path, odd: dict[str, Any]
) -> None:
    bag = tmp_path / 'bag'
    bag.mkdir()
    writer = BagWriter(bag)
    refused = replace(topic('/a', 'std_msgs/msg/Header'), **odd)
    writer.write([BagMessage(refused, bytes(16), 5 * SECOND, 0, 1)])
    writer.close()
    with pytest.raises(UserError, match='has no topic that can be played'):
        BagPlayer([bag], context=ros)


def test_the_command_plays_under_other_names_and_names_what_it_cannot_play(
    ros: Context, bag: Path, spin_until: Callable[..., None]
) -> None:
    arrived: list[int] = []
    node = Node('listener', context=ros)
    node.create_subscription(Header, '/moved', lambda m: arrived.append(m.stamp.sec), 100)
    executor = QuickExecutor(2, context=ros)
    executor.add_node(node)
    with started('play', str(bag), '--rate', '10', '--remap', '/a:=/moved') as process:
        spin_until(executor, lambda: len(arrived) == 10)
        out, err = process.communicate(timeout=200)
    executor.shutdown()
    node.destroy_node()
    assert process.returncode == 0
    assert '/c is not played: the type nobody/msg/X is not installed here' in err
    assert out == 'played 0.9 / 0.9 s  20 messages  x10\n'


@pytest.mark.parametrize('rule', ['my_bag', '/a:=', ':=/b'])
def test_a_name_that_is_no_remapping_is_refused(rule: str) -> None:
    assert f"'{rule}' is not OLD:=NEW" in refused('play', '--remap', '/a:=/b', rule)
