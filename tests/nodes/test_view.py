"""The view node: what a page receives, and what it makes other nodes do."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

import numpy as np
from command_line import spinning, wait_for
from geometry_msgs.msg import Point, Pose, PoseStamped
from nav_msgs.msg import Path
from node_bench import overrides
from page_client import PATIENCE, connect_page, rows, wait
from rclpy.node import Node

from barc_sim.control.cruise_control import TYPES
from barc_sim.control.speed import ACCELERATION_LIMIT
from barc_sim.errors import UserError
from barc_sim.interfaces import qos, topics
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.nodes.view import ViewNode
from barc_sim.page.protocol import RunFacts, Status, encode
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from rclpy.context import Context
    from websockets.sync.client import ClientConnection


@pytest.mark.parametrize(('kind', 'gain'), [('pid', 'kp'), ('lqr', 'observer_gain')])
def test_every_state_reaches_the_page_with_its_messages(ros: Context, kind: str, gain: str) -> None:
    law = TYPES[kind]()
    law.output_min, law.output_max = -ACCELERATION_LIMIT, ACCELERATION_LIMIT
    log = closed_loop(controller=law, distance=25.0)
    parameters = overrides(distance=25.0, realtime_factor=10.0)
    simulator = VehicleSimulator(context=ros, parameter_overrides=parameters)
    controller = CruiseController(context=ros, parameter_overrides=overrides(controller_type=kind))
    view = ViewNode(context=ros, run=RunFacts(lambda: simulator.values, controller.control))
    received: list[dict[str, float]] = []
    with spinning(ros, view, simulator, controller), connect_page(view.url) as socket:
        facts = wait(socket, 'hello')
        while len(received) < simulator.stepper.states or not simulator.finished.done():
            received += rows(socket.recv(timeout=100.0))
        socket.send(encode('tune', name=gain, value=1.0))
        wait_for(lambda: controller.get_parameter(gain).value == 1.0)
    table = {name: np.array([row[name] for row in received]) for name in received[0]}
    assert facts['terms'] == [*law.terms]
    # A command may miss its deadline here; a publisher may find the page later than another does.
    assert len(received) >= len(log)
    np.testing.assert_allclose(np.diff(table['t']), 0.02)
    np.testing.assert_array_equal(table['theta_deg'][1:], 10.0 * (table['x'][1:] >= 20.0))

    is_known = np.isfinite(table['motor']) & np.isfinite(sum(table[term] for term in law.terms))
    assert is_known[-1]

    total = sum(table[term][is_known] for term in law.terms)
    motor = table['motor'][is_known]
    differ = np.flatnonzero(~np.isclose(np.clip(total, -8.0, 8.0), motor))
    # On a busy machine one of a state's two messages can arrive after its row has been sent: then
    # the row has the one of the state before.
    assert all(total[i] == total[i - 1] or motor[i] == motor[i - 1] for i in differ)
    assert len(differ) < 0.1 * len(log)
    assert table['reference'][-1] == 8.0


def test_the_page_has_the_missed_deadlines_of_the_simulator_to_the_end(ros: Context) -> None:
    parameters = overrides(realtime_factor=50.0, wait_for_controller=False)
    simulator = VehicleSimulator(context=ros, parameter_overrides=parameters)
    stepper = simulator.stepper
    run = RunFacts(lambda: simulator.values, status=lambda: Status(stepper.missed, stepper.paused))
    view = ViewNode(context=ros, run=run)
    with spinning(ros, view, simulator), connect_page(view.url) as socket:
        wait(socket, lambda received: bool(received.get('missed')))
        count = stepper.missed
        wait_for(lambda: stepper.missed > count)  # perhaps after the last status
        stepper.pause(on=True)
        view.page.end('The run has ended.')
        missed = []
        while (message := json.loads(text_of(socket)))['type'] != 'end':
            missed += [message['missed']] if message['type'] == 'status' else []

    assert missed[-1] == stepper.missed > 0


def text_of(socket: ClientConnection) -> str:
    """Return the next message that is no row of states."""
    while not isinstance(message := socket.recv(timeout=PATIENCE), str):
        pass
    return message


def test_the_planned_path_of_the_steering_reaches_the_page(ros: Context) -> None:
    view, peer = ViewNode(context=ros), Node('peer', context=ros)
    plans = peer.create_publisher(Path, topics.PREDICTION, qos.DEFAULT)
    pose = Pose(position=Point(x=1.23456, y=-2.0))
    with spinning(ros, view, peer), connect_page(view.url) as socket:
        wait_for(plans.get_subscription_count)
        plans.publish(Path(poses=[PoseStamped(pose=pose)]))
        assert wait(socket, lambda message: bool(message.get('plan')))['plan'] == [[1.235, -2.0]]


def test_a_view_alone_takes_its_mode_and_address_as_parameters(ros: Context) -> None:
    parameters = overrides(mode='teleop', host='127.0.0.2')
    view = ViewNode(context=ros, parameter_overrides=parameters)
    with spinning(ros, view), connect_page(view.url) as socket:
        assert view.url.startswith('http://127.0.0.2:')
        assert wait(socket, 'hello')['mode'] == 'teleop'
    with pytest.raises(UserError, match="mode 'drive' of the view must be 'acc' or 'teleop'"):
        ViewNode(context=ros, parameter_overrides=overrides(mode='drive'))


def test_a_parameter_set_by_the_page_or_by_others_is_shown_in_a_namespace(ros: Context) -> None:
    controller = CruiseController(context=ros, namespace='car2')
    run = RunFacts(control=controller.control)
    view = ViewNode(context=ros, namespace='car2', run=run)

    with spinning(ros, view, controller), connect_page(view.url) as socket:
        wait(socket, 'hello')
        controller.set_parameters(overrides(kd=0.5))  # as `barc param set` does
        assert wait(socket, 'facts')['tuning']['kd'] == 0.5

        socket.send(encode('tune', name='kp', value=2.0))
        assert wait(socket, lambda message: message.get('tuning', {}).get('kp') == 2.0)
