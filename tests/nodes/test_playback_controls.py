"""A playback obeys the parameters and the services of barc_sim, and those of rosbag2."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from builtin_interfaces.msg import Time
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from barc_sim.bags.messages import BagMessage, topic
from barc_sim.bags.playback_settings import Playback
from barc_sim.bags.writer import BagWriter
from barc_sim.nodes.player import BagPlayer
from barc_sim.ros.executor import QuickExecutor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from rclpy.context import Context

SECOND = 10**9
START = 100  #: [s] of the bag
COUNT = 50  #: messages, one each second
LATCHED = {'durability': 'transient_local', 'reliability': 'reliable', 'depth': 1}


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Return a bag with a message a second on /a, and two on the latched topic /map."""
    directory = tmp_path / 'bag'
    directory.mkdir()
    writer = BagWriter(directory)
    plain = topic('/a', 'std_msgs/msg/Header')
    latched = topic('/map', 'std_msgs/msg/Header')
    latched = type(latched)(**{**vars(latched), 'offered_qos': [LATCHED]})
    for k in range(COUNT):
        data = bytes([0, 1, 0, 0, k, *bytes(7), 1, 0, 0, 0, 0])
        received = (START + k) * SECOND
        if k in {0, 20}:
            writer.write([BagMessage(latched, data, received, received, k)])
        writer.write([BagMessage(plain, data, received, received, k)])
    writer.close()
    return directory


class Client:
    """A player, and a node that calls its services and keeps what it publishes."""

    def __init__(self, ros: Context, bag: Path, spin: Callable[..., None], settings: Any) -> None:  # noqa: ANN401
        self._spin = spin
        self.node = Node('client', context=ros)
        self.messages: list[int] = []
        self.maps: list[int] = []
        self.clocks: list[float] = []
        self.node.create_subscription(Header, 'a', self._on_message, 100)
        self.node.create_subscription(Header, 'map', self._on_map, 100)
        self.node.create_subscription(Clock, 'clock', self._on_clock, 100)
        self.player = BagPlayer([bag], Playback(**settings), context=ros)
        self.executor = QuickExecutor(2, context=ros)
        for node in (self.node, self.player):
            self.executor.add_node(node)

    def _on_message(self, message: Header) -> None:
        self.messages.append(message.stamp.sec)

    def _on_map(self, message: Header) -> None:
        self.maps.append(message.stamp.sec)

    def _on_clock(self, message: Clock) -> None:
        self.clocks.append(message.clock.sec + message.clock.nanosec / 1e9)

    def call(self, kind: Any, name: str, **fields: Any) -> Any:  # noqa: ANN401 (any service)
        """Call a service, and return its response."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready)
        future = client.call_async(kind.Request(**fields))
        self.until(future.done)
        return future.result()

    def trigger(self, name: str) -> tuple[bool, str]:
        """Call a service of the player's own."""
        response = self.call(Trigger, f'bag_player/{name}')
        return response.success, response.message

    def set(self, name: str, value: float) -> str:
        """Set a parameter of the player; return why that was refused."""
        parameter = Parameter(name, value=value).to_parameter_msg()
        response = self.call(SetParameters, 'bag_player/set_parameters', parameters=[parameter])
        return str(response.results[0].reason)

    def get(self, name: str) -> float:
        """Return the value of a parameter of the player."""
        response = self.call(GetParameters, 'bag_player/get_parameters', names=[name])
        return float(response.values[0].double_value)

    def until(self, condition: Callable[[], bool]) -> None:
        """Spin until the condition is true."""
        self._spin(self.executor, condition)

    def until_played(self, *messages: int) -> None:
        """Spin until these, and no others, are the messages on /a."""
        self.until(lambda: len(self.messages) >= len(messages))
        assert self.messages == [*messages]

    def close(self) -> None:
        """End both nodes."""
        self.executor.shutdown()
        self.player.destroy_node()
        self.node.destroy_node()


@pytest.fixture
def play(
    ros: Context, bag: Path, spin_until: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., Client]]:
    """Return a function that plays the bag with the given settings."""
    monkeypatch.setattr('barc_sim.nodes.playback_publishers._MATCHING', 0.2)
    clients: list[Client] = []

    def begin(**settings: Any) -> Client:  # noqa: ANN401
        clients.append(Client(ros, bag, spin_until, settings))
        return clients[-1]

    yield begin
    for each in clients:
        each.close()


def test_services_step_pause_and_resume(play: Callable[..., Client]) -> None:
    client = play(start_paused=True, rate=1000.0)
    assert client.trigger('play_next') == (True, 'paused at 0.000 s')
    assert client.trigger('play_next') == (True, 'paused at 0.000 s')  # /map, then /a
    client.until_played(0)
    assert client.trigger('play_next') == (True, 'paused at 1.000 s')
    client.until_played(0, 1)
    is_resumed, state = client.trigger('toggle_paused')
    assert is_resumed
    assert state.startswith('playing at ')
    client.until(client.player.finished.done)
    client.until_played(*range(COUNT))


def test_a_pause_holds_the_time_and_a_step_needs_one(play: Callable[..., Client]) -> None:
    client = play(rate=0.001)
    client.until_played(0)
    refused = (False, 'the playback is not paused: pause it first')
    assert client.trigger('play_next') == refused
    is_paused, state = client.trigger('pause')
    assert is_paused
    assert state.startswith('paused at ')
    assert client.trigger('pause') == (True, state)
    is_resumed, _ = client.trigger('resume')
    assert is_resumed
    assert client.trigger('play_next') == refused


def test_the_service_stop_ends_the_playback(play: Callable[..., Client]) -> None:
    client = play(rate=0.001)
    client.until_played(0)
    is_stopped, state = client.trigger('stop')
    assert is_stopped
    assert state.startswith('stopped at ')
    client.until(client.player.finished.done)
    assert client.player.failure is None


def test_a_stop_does_not_wait_for_subscriptions(
    play: Callable[..., Client], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ('_MATCHING', '_MAX_MATCHING'):
        monkeypatch.setattr(f'barc_sim.nodes.playback_publishers.{name}', 1000.0)
    client = play()
    client.player.controls.on_key('quit')
    client.until(client.player.finished.done)
    assert client.player.played == 0


def test_the_rate_is_a_parameter_that_counts_at_once(play: Callable[..., Client]) -> None:
    client = play(rate=0.001)
    client.until_played(0)
    assert client.get('rate') == 0.001
    assert client.set('rate', 0.0).startswith('Parameter rate out of range')
    assert client.set('rate', 1000.0) == ''
    client.until(client.player.finished.done)
    client.until_played(*range(COUNT))
    assert client.player.progress.endswith('x1000')


def test_keys_change_the_rate(play: Callable[..., Client]) -> None:
    client = play(start_paused=True)
    client.player.controls.on_key('up')
    client.player.controls.on_key('up')
    assert client.get('rate') == pytest.approx(1.2)
    client.player.controls.on_key('down')
    assert client.get('rate') == pytest.approx(1.1)

    client.player.controls.on_key('quit')
    client.until(client.player.finished.done)
    client.player.destroy_node()
    client.player.controls.on_key('up')
    assert client.player.progress.endswith('paused')


def test_the_playback_continues_at_a_time_with_what_latched_topics_hold(
    play: Callable[..., Client],
) -> None:
    client = play(start_paused=True, clock=100.0)
    assert client.set('seek_to', 30.5) == ''
    client.until(lambda: client.maps == [20])
    client.until(lambda: START + 30.5 in client.clocks)
    assert client.trigger('play_next') == (True, 'paused at 31.000 s')
    client.until_played(31)

    # Back, where another map was current.
    assert client.set('seek_to', 5.0) == ''
    client.until(lambda: client.maps == [20, 0])
    assert client.trigger('play_next') == (True, 'paused at 5.000 s')
    client.until_played(31, 5)
    assert client.set('seek_to', 49.1).startswith('Parameter seek_to out of range')


def test_while_paused_the_playback_can_go_back_from_its_end(play: Callable[..., Client]) -> None:
    client = play(start_paused=True, start_offset=COUNT - 1.0)
    client.until(lambda: client.maps == [20])
    assert client.trigger('play_next') == (True, 'paused at 49.000 s')
    assert client.trigger('play_next') == (False, 'the playback is at its end')
    assert client.set('seek_to', 49.0) == ''
    assert client.trigger('play_next') == (True, 'paused at 49.000 s')
    client.until_played(49, 49)
    is_resumed, _ = client.trigger('resume')
    assert is_resumed
    client.until(client.player.finished.done)


@pytest.mark.slow  # the package of the types is built
@pytest.mark.timeout(900)
@pytest.mark.usefixtures('rosbag2_interfaces')
def test_a_client_of_ros2_bag_play_controls_the_playback(play: Callable[..., Client]) -> None:
    from rosbag2_interfaces import srv  # noqa: PLC0415 (not installed everywhere)

    client = play(start_paused=True, rate=2.0)

    def call(kind: Any, name: str, **fields: Any) -> Any:  # noqa: ANN401 (any service)
        return client.call(kind, f'/rosbag2_player/{name}', **fields)

    assert call(srv.IsPaused, 'is_paused').paused
    assert call(srv.PlayNext, 'play_next').success
    assert call(srv.Burst, 'burst', num_messages=3).actually_burst == 3
    client.until_played(0, 1, 2)

    assert call(srv.Seek, 'seek', time=Time(sec=START + 10)).success
    assert call(srv.PlayNext, 'play_next').success
    assert call(srv.Seek, 'seek', time=Time(sec=1)).success  # counts as the first message
    assert call(srv.Burst, 'burst', num_messages=2).actually_burst == 2
    assert not call(srv.Seek, 'seek', time=Time(sec=START + COUNT)).success
    client.until_played(0, 1, 2, 10, 0)

    assert call(srv.GetRate, 'get_rate').rate == 2.0
    assert not call(srv.SetRate, 'set_rate', rate=0.0).success
    assert call(srv.SetRate, 'set_rate', rate=0.001).success
    assert call(srv.GetRate, 'get_rate').rate == 0.001

    call(srv.Resume, 'resume')
    assert not call(srv.IsPaused, 'is_paused').paused
    assert not call(srv.PlayNext, 'play_next').success
    assert call(srv.Burst, 'burst').actually_burst == 0
    call(srv.TogglePaused, 'toggle_paused')
    assert call(srv.IsPaused, 'is_paused').paused
    assert call(srv.Burst, 'burst').actually_burst > COUNT - 3  # all
    call(srv.Resume, 'resume')
    call(srv.Pause, 'pause')
    client.player.controls.on_key('quit')
    client.until(client.player.finished.done)


@pytest.mark.slow  # the package of the types is built
@pytest.mark.timeout(900)
@pytest.mark.usefixtures('rosbag2_interfaces')
def test_a_client_of_ros2_bag_play_stops_the_playback(play: Callable[..., Client]) -> None:
    from rosbag2_interfaces import srv  # noqa: PLC0415 (not installed everywhere)

    client = play(start_paused=True)
    client.call(srv.Stop, '/rosbag2_player/stop')
    client.until(client.player.finished.done)
    assert client.player.played == 0
