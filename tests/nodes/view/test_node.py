"""The view node: what reaches a page, and what a page makes the other nodes do."""

from __future__ import annotations

import json
import time
from contextlib import contextmanager
from threading import Thread
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from barc_interfaces.msg import ECU, Environment, PidState, ZDynBkMdl
from geometry_msgs.msg import Twist
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterEvent, ParameterType, ParameterValue
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger
from websockets.sync.client import connect

from barc_sim.control.lqr import LQR
from barc_sim.errors import UserError
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator.node import VehicleSimulator
from barc_sim.nodes.view.node import ViewNode
from barc_sim.page.protocol import COLUMNS, Status, encode
from barc_sim.ros import names
from barc_sim.ros.conversions import to_header
from barc_sim.ros.executor.executor import QuickExecutor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.context import Context

DEADLINE = 20.0
START = 1_700_000_000_000_000_000
STEP = 20_000_000


class Peer(Node):
    """Publishes what a run does, notes `cmd_vel`, and offers reset and pause."""

    def __init__(self, context: Context) -> None:
        super().__init__('peer', context=context)
        self.twists: list[tuple[float, float]] = []
        self.done: list[object] = []
        self.refusal = ''
        self._steps = 0
        self._pubs = {
            topic: self.create_publisher(kind, topic, names.QOS)
            for topic, kind in {
                names.STATE: ZDynBkMdl,
                names.ENVIRONMENT: Environment,
                names.ECU: ECU,
                names.PID_STATE: PidState,
            }.items()
        }
        self.create_subscription(Twist, 'cmd_vel', self._on_twist, 100)
        self.create_service(Trigger, 'vehicle_simulator/reset', self._on_request)
        self.create_service(SetBool, 'vehicle_simulator/pause', self._on_request)

    def step(self, x: float) -> None:
        """Publish a state at `x`, and all that belongs to it."""
        header = to_header(START + self._steps * STEP)
        self._steps += 1
        self._pubs[names.ENVIRONMENT].publish(Environment(header=header, theta=10.0))
        self._pubs[names.STATE].publish(ZDynBkMdl(header=header, x=x, v_x=7.0))
        self._pubs[names.ECU].publish(ECU(header=header, motor=1.5, servo=0.1))
        self._pubs[names.PID_STATE].publish(PidState(header=header, reference=8.0))

    def _on_twist(self, twist: Twist) -> None:
        self.twists.append((twist.linear.x, twist.angular.z))
        self.braked = twist.linear.z == -1.0

    def _on_request(self, request: Any, response: Any) -> Any:  # noqa: ANN401 (two kinds)
        self.done.append(request.data if isinstance(request, SetBool.Request) else 'reset')
        response.success = not self.refusal
        response.message = self.refusal
        return response


class Client:
    """A page without a browser."""

    def __init__(self, socket: Any) -> None:  # noqa: ANN401 (websockets' own)
        self._socket = socket
        self.rows = np.empty((0, len(COLUMNS)))

    def ask(self, kind: str, **fields: object) -> None:
        """Send a request."""
        self._socket.send(encode(kind, **fields))

    def hear(self, kind: str) -> dict[str, Any]:
        """Return the next message of a type; keep the states that come before it."""
        end = time.monotonic() + DEADLINE
        while True:
            data = self._socket.recv(max(end - time.monotonic(), 0.0))
            if isinstance(data, bytes):
                rows = np.frombuffer(data, '<f8').reshape(-1, len(COLUMNS))
                self.rows = np.vstack([self.rows, rows])
            elif (message := json.loads(data)).pop('type') == kind:
                return dict(message)

    def column(self, name: str) -> Any:  # noqa: ANN401 (an array)
        """Return what was heard of a quantity."""
        return self.rows[:, COLUMNS.index(name)]


@contextmanager
def page(view: ViewNode) -> Iterator[Client]:
    address = urlsplit(view.url)
    with connect(
        f'ws://{address.netloc}{address.path}socket',
        origin=f'http://{address.netloc}',
        proxy=None,
        max_size=None,
    ) as socket:
        yield Client(socket)


@contextmanager
def spinning(context: Context, *nodes: Node) -> Iterator[None]:
    executor = QuickExecutor(2, context=context)
    for node in nodes:
        executor.add_node(node)
    thread = Thread(target=executor.spin)
    thread.start()
    try:
        yield
    finally:
        executor.shutdown()
        thread.join(DEADLINE)
        for node in nodes:
            node.destroy_node()


def until(condition: Any) -> None:  # noqa: ANN401 (a callable)
    end = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.fixture
def peer(ros: Context) -> Peer:
    return Peer(ros)


@pytest.fixture
def view(ros: Context, peer: Peer) -> Iterator[ViewNode]:
    view = ViewNode('teleop', context=ros, status=lambda: Status(missed=3, slipped=1, paused=None))
    with spinning(ros, view, peer):
        yield view


def test_every_state_reaches_the_page_with_what_belongs_to_it(view: ViewNode, peer: Peer) -> None:
    with page(view) as client:
        client.hear('status')
        for k in range(100):
            peer.step(float(k))
            until(lambda: view.seen == k + 1)  # noqa: B023 (called at once)
        view.end('over')
        client.hear('end')
    np.testing.assert_array_equal(client.column('x'), np.arange(100.0))
    np.testing.assert_allclose(client.column('t'), 0.02 * np.arange(100))
    np.testing.assert_array_equal(client.column('theta_deg'), 10.0)
    # A command is there a moment later than its state.
    assert np.all(client.column('motor')[1:] == 1.5)
    assert np.all(client.column('reference')[1:] == 8.0)


@pytest.mark.parametrize('x', [float('nan'), float('inf'), 1e308])
def test_states_that_are_none_are_left_out(view: ViewNode, peer: Peer, x: float) -> None:
    with page(view) as client:
        client.hear('status')
        for place in (1.0, x, 2.0):
            peer.step(place)
        until(lambda: view.seen == 2)
        view.end('over')
        client.hear('end')
    np.testing.assert_array_equal(client.column('x'), [1.0, 2.0])


def test_parameter_events_that_are_none_are_left_out(view: ViewNode, peer: Peer) -> None:
    events = peer.create_publisher(ParameterEvent, '/parameter_events', 10)
    until(events.get_subscription_count)
    odd = [
        ParameterValue(type=99),
        ParameterValue(type=ParameterType.PARAMETER_STRING, string_value='high'),
        ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=float('nan')),
        ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=7.0),
    ]
    with page(view) as client:
        client.hear('hello')
        for value in odd:
            changed = [ParameterMessage(name=name, value=value) for name in ('kp', 'other')]
            events.publish(ParameterEvent(node='/controller', changed_parameters=changed))
        tuned: dict[str, float] = {}
        while not tuned:
            tuned = client.hear('facts')['tuning']
    assert tuned == {'kp': 7.0}


def test_a_page_that_opens_late_sees_what_was(view: ViewNode, peer: Peer) -> None:
    peer.step(1.0)
    until(lambda: view.seen == 1)
    with page(view) as client:
        client.hear('status')
    np.testing.assert_array_equal(client.column('x'), [1.0])


def test_the_status_tells_what_the_composition_knows_from_the_first_state_on(
    view: ViewNode, peer: Peer
) -> None:
    with page(view) as client:
        assert client.hear('status')['missed'] is None
        peer.step(0.0)
        while (status := client.hear('status'))['missed'] is None:
            pass
    assert (status['missed'], status['paused'], status['driver']) == (3, False, None)


def test_what_a_page_holds_is_published_until_it_lets_go(view: ViewNode, peer: Peer) -> None:
    with page(view) as client:
        client.ask('drive', linear=1.0, angular=-0.5)
        until(lambda: len(peer.twists) >= 3)
        client.ask('drive', linear=0.0, angular=0.0)
        until(lambda: peer.twists[-1] == (0.0, 0.0))
        silent_since = len(peer.twists)
        client.hear('status')
        client.hear('status')
    assert set(peer.twists[:-1]) == {(1.0, -0.5)}
    assert len(peer.twists) == silent_since


def test_a_page_that_goes_while_it_holds_a_key_brakes(view: ViewNode, peer: Peer) -> None:
    with page(view) as client:
        client.ask('drive', linear=1.0, angular=0.0)
        until(lambda: (1.0, 0.0) in peer.twists)
    until(lambda: peer.twists[-1] == (0.0, 0.0))
    assert peer.braked


def test_one_page_drives_and_the_other_is_told(view: ViewNode, peer: Peer) -> None:
    with page(view) as driver, page(view) as watcher:
        driver.ask('drive', linear=1.0, angular=0.0)
        until(lambda: peer.twists)
        watcher.ask('drive', linear=-1.0, angular=0.0)
        assert watcher.hear('refused')['what'] == 'drive'
        assert watcher.hear('status')['driver'] == 'other'
        assert (-1.0, 0.0) not in peer.twists


def test_reset_and_pause_ask_the_simulator(view: ViewNode, peer: Peer) -> None:
    with page(view) as client:
        client.ask('reset')
        until(lambda: peer.done == ['reset'])
        client.ask('pause', on=True)
        until(lambda: peer.done == ['reset', True])
        while not client.hear('status')['paused']:
            pass
        client.ask('pause', on=False)
        while client.hear('status')['paused']:
            pass
    assert peer.done == ['reset', True, False]


@pytest.mark.parametrize('what', ['reset', 'pause'])
def test_a_refusal_is_told_in_words(view: ViewNode, peer: Peer, what: str) -> None:
    peer.refusal = 'not now'
    with page(view) as client:
        client.ask(what, **({'on': True} if what == 'pause' else {}))
        assert client.hear('refused') == {'what': what, 'why': 'not now'}


def test_who_is_not_there_is_named(view: ViewNode) -> None:
    with page(view) as client:
        client.ask('tune', name='kp', value=1.0)
        refusal = client.hear('refused')
    assert refusal == {'what': 'kp', 'why': 'nobody offers /controller/set_parameters'}


def test_the_end_is_told_to_those_who_are_there_and_those_who_come(view: ViewNode) -> None:
    with page(view) as client:
        client.hear('status')
        view.end('the distance was reached')
        assert client.hear('end') == {'reason': 'the distance was reached'}
    with page(view) as client:
        assert client.hear('end') == {'reason': 'the distance was reached'}


def test_road_axles_and_gains_come_from_the_nodes(ros: Context) -> None:
    view = ViewNode(context=ros)
    overrides = [Parameter('l_r', value=1.25), Parameter('wait_for_controller', value=False)]
    simulator = VehicleSimulator(context=ros, parameter_overrides=overrides)
    controller = CruiseController(context=ros)
    with spinning(ros, view, simulator, controller), page(view) as client:
        facts = client.hear('hello')
        while not (facts['tuning'] and facts['road']):
            facts = client.hear('facts')
    assert facts['mode'] == 'acc'
    assert facts['axles'] == [-1.25, 1.5]
    assert facts['road']['grades_deg'][:3] == [0.0, 10.0, 0.0]
    assert facts['tuning'] == {'kp': 30.0, 'ki': 200.0, 'kd': 0.1, 'speed_reference': 8.0}


def test_another_controllers_sliders_and_terms_are_shown(ros: Context) -> None:
    view = ViewNode(context=ros)
    simulator = VehicleSimulator(context=ros)
    overrides = [Parameter('controller_type', value='lqr')]
    controller = CruiseController(context=ros, parameter_overrides=overrides)
    with spinning(ros, view, simulator, controller), page(view) as client:
        facts = client.hear('hello')
        while not facts['tuning']:
            facts = client.hear('facts')
        client.ask('tune', name='observer_gain', value=1.0)
        until(lambda: controller.get_parameter('observer_gain').value == 1.0)
        while not np.isfinite(client.column('feedback')).any():
            client.hear('status')
    assert facts['terms'] == [*LQR.terms]
    assert facts['tuning'].keys() == facts['sliders'].keys() == {*LQR.gains, 'speed_reference'}
    shown = np.isfinite(client.column('feedback'))
    total = client.column('feedback')[shown] + client.column('compensation')[shown]
    np.testing.assert_array_equal(np.clip(total, -8.0, 8.0), client.column('motor')[shown])
    assert client.column('reference')[shown][-1] == 8.0
    assert np.isnan(client.column('proportional')).all()


def test_a_slider_sets_the_controllers_parameter_and_all_pages_see_it(ros: Context) -> None:
    view = ViewNode(context=ros)
    controller = CruiseController(context=ros)
    with spinning(ros, view, controller), page(view) as client, page(view) as other:
        known = client.hear('hello')['tuning']
        while not known:
            known = client.hear('facts')['tuning']
        client.ask('tune', name='speed_reference', value=5.5)
        until(lambda: controller.speed_reference == 5.5)
        while other.hear('facts')['tuning'].get('speed_reference') != 5.5:
            pass
        client.ask('tune', name='kp', value=-1.0)
        refusal = client.hear('refused')
    assert refusal['what'] == 'kp'
    assert '-1.0' in refusal['why']
    assert controller.get_parameter('kp').value == 30.0


def test_a_namespace_moves_it(ros: Context) -> None:
    view = ViewNode(context=ros, namespace='car2')
    controller = CruiseController(context=ros, namespace='car2')
    with spinning(ros, view, controller), page(view) as client:
        client.ask('tune', name='kp', value=2.0)
        while client.hear('facts')['tuning'].get('kp') != 2.0:
            pass


def test_the_realtime_factor_is_measured(ros: Context) -> None:
    view = ViewNode('teleop', context=ros)
    simulator = VehicleSimulator(
        context=ros,
        parameter_overrides=[
            Parameter('wait_for_controller', value=False),
            Parameter('realtime_factor', value=2.0),
        ],
    )
    with spinning(ros, view, simulator), page(view) as client:
        factor = None
        while factor is None:
            factor = client.hear('status')['factor']
    assert 0.0 < factor < 2.5  # a busy machine is slower


def test_a_mode_that_is_none_is_named(ros: Context) -> None:
    with pytest.raises(UserError, match="mode 'drift' of the view"):
        ViewNode('drift', context=ros)


def test_destroying_it_frees_the_port(ros: Context) -> None:
    first = ViewNode(context=ros)
    port = urlsplit(first.url).port
    first.destroy_node()
    again = ViewNode(context=ros, port=port or 0)
    again.destroy_node()
    assert urlsplit(again.url).port == port
