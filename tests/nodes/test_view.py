"""The view node: what a page receives, and what it makes other nodes do."""

from __future__ import annotations

import json
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

import numpy as np
from barc_interfaces.msg import ECU, Environment, PidState, ZDynBkMdl
from command_line import spinning
from geometry_msgs.msg import Point, Pose, PoseStamped
from nav_msgs.msg import Path
from page_client import connect_page
from rclpy.node import Node
from rclpy.parameter import Parameter

from barc_sim.bags import names
from barc_sim.control.speed import LQR
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.nodes.view import ViewNode
from barc_sim.page.protocol import CAR, COLUMNS, OTHERS, RunFacts, encode
from barc_sim.ros.node_helpers import to_header

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.context import Context

DEADLINE = 20.0
START = 1_700_000_000_000_000_000
STEP = 20_000_000


class Peer(Node):
    """Publishes a run."""

    def __init__(self, context: Context) -> None:
        super().__init__('peer', context=context)
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

    def step(self, x: float) -> None:
        """Publish a state at `x` with its other messages."""
        header = to_header(START + self._steps * STEP)
        self._steps += 1
        self._pubs[names.ENVIRONMENT].publish(Environment(header=header, theta=10.0))
        self._pubs[names.STATE].publish(ZDynBkMdl(header=header, x=x, v_x=7.0))
        self._pubs[names.ECU].publish(ECU(header=header, motor=1.5, servo=0.1))
        self._pubs[names.PID_STATE].publish(PidState(header=header, reference=8.0))


class Client:
    """A page without a browser."""

    def __init__(self, socket: Any) -> None:  # noqa: ANN401 (websockets' own)
        self._socket = socket
        self.rows = np.empty((0, len(COLUMNS)))

    def request(self, kind: str, **fields: object) -> None:
        """Send a request."""
        self._socket.send(encode(kind, **fields))

    def receive(self, kind: str) -> dict[str, Any]:
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
        """Return the received values of a column."""
        return self.rows[:, COLUMNS.index(name)]


@contextmanager
def page(view: ViewNode) -> Iterator[Client]:
    with connect_page(view.url) as socket:
        yield Client(socket)


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
    view = ViewNode('teleop', context=ros)
    with spinning(ros, view, peer):
        yield view


def test_every_state_reaches_the_page_with_its_messages(view: ViewNode, peer: Peer) -> None:
    with page(view) as client:
        client.receive('status')
        for k in range(100):
            peer.step(float(k))
            until(lambda: view.page.feed.seen == k + 1)  # noqa: B023 (called at once)
        view.page.end('over')
        client.receive('end')
    np.testing.assert_array_equal(client.column('x'), np.arange(100.0))
    np.testing.assert_allclose(client.column('t'), 0.02 * np.arange(100))
    # A publisher may find the page's node a moment later than that of the states does.
    np.testing.assert_array_equal(client.column('theta_deg')[1:], 10.0)
    assert np.all(client.column('motor')[1:] == 1.5)
    assert np.all(client.column('reference')[1:] == 8.0)


def test_plan_of_the_steering_reaches_the_page(view: ViewNode, peer: Peer) -> None:
    plans = peer.create_publisher(Path, names.PREDICTION, names.QOS)
    until(plans.get_subscription_count)
    pose = Pose(position=Point(x=1.23456, y=-2.0))
    with page(view) as client:
        plans.publish(Path(poses=[PoseStamped(pose=pose)]))
        while not (plan := client.receive('status')['plan']):
            pass
    assert plan == [[1.235, -2.0]]


def test_road_axles_and_gains_come_from_the_nodes(ros: Context) -> None:
    overrides = [Parameter('l_r', value=1.25), Parameter('wait_for_controller', value=False)]
    simulator = VehicleSimulator(context=ros, parameter_overrides=overrides)
    controller = CruiseController(context=ros)
    run = RunFacts(simulator.values, controller.control, simulator.road)
    view = ViewNode(context=ros, run=run)
    with spinning(ros, view, simulator, controller), page(view) as client:
        facts = client.receive('hello')
        controller.set_parameters([Parameter('kp', value=7.0)])  # as `barc param set` does
        assert client.receive('facts')['tuning'] == facts['tuning'] | {'kp': 7.0}
    assert facts['mode'] == 'acc'
    assert facts['axles'] == [-1.25, 1.5]
    assert facts['road']['grades_deg'][:3] == [0.0, 10.0, 0.0]
    others = {'speed_reference': 8.0, 'acceleration_limit': 8.0}
    car = dict.fromkeys(CAR, 0.0)
    assert facts['tuning'] == {'kp': 30.0, 'ki': 200.0, 'kd': 0.1, **others, **car}
    assert facts['run'] == {'road': 'lab', 'distance': 0.0, 'laps': 1}


def test_another_controllers_sliders_and_terms_are_shown(ros: Context) -> None:
    simulator = VehicleSimulator(context=ros)
    overrides = [Parameter('controller_type', value='lqr')]
    controller = CruiseController(context=ros, parameter_overrides=overrides)
    run = RunFacts(simulator.values, controller.control)
    view = ViewNode(context=ros, run=run)
    with spinning(ros, view, simulator, controller), page(view) as client:
        facts = client.receive('hello')
        client.request('tune', name='observer_gain', value=1.0)
        until(lambda: controller.get_parameter('observer_gain').value == 1.0)
        while not np.isfinite(client.column('feedback')).any():
            client.receive('status')
    assert facts['terms'] == [*LQR.terms]
    assert facts['tuning'].keys() == {*LQR.gains, *OTHERS, *CAR}
    shown = np.isfinite(client.column('feedback'))
    total = client.column('feedback')[shown] + client.column('compensation')[shown]
    np.testing.assert_array_equal(np.clip(total, -8.0, 8.0), client.column('motor')[shown])
    assert client.column('reference')[shown][-1] == 8.0
    assert np.isnan(client.column('proportional')).all()


def test_namespace_applies_to_its_clients(ros: Context) -> None:
    controller = CruiseController(context=ros, namespace='car2')
    run = RunFacts(control=controller.control)
    view = ViewNode(context=ros, namespace='car2', run=run)
    with spinning(ros, view, controller), page(view) as client:
        client.request('tune', name='kp', value=2.0)
        while client.receive('facts')['tuning'].get('kp') != 2.0:
            pass
