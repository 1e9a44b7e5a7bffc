"""The controller alone: which state it answers, with which interval, and its parameters."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import pytest

pytest.importorskip('rclpy')

from barc_interfaces.msg import ECU, ControllerState, LaneState, PidState, ZDynBkMdl
from node_bench import NodeBench, overrides
from rcl_interfaces.srv import SetParameters
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from barc_sim.control.lane import LaneLQR
from barc_sim.control.pilots import Pilot
from barc_sim.control.speed import LQR, speed_controller
from barc_sim.interfaces import qos, topics
from barc_sim.interfaces.records import Command
from barc_sim.interfaces.stamps import to_nanoseconds
from barc_sim.nodes.controller import CruiseController
from barc_sim.ros.node_helpers import to_header

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.context import Context

    from barc_sim.control.situation import Situation

    Make = Callable[..., 'Bench']

MS = 1_000_000


class Bench(NodeBench):
    """A controller, and a node that sends it states and hears its answers."""

    def __init__(
        self,
        context: Context,
        spin_until: Callable[..., None],
        controller: object = None,
        lane: object = None,
        **parameters: float | str | bool,
    ) -> None:
        self.controller = CruiseController(
            controller=controller,
            lane=lane,
            context=context,
            parameter_overrides=overrides(**parameters),
        )
        super().__init__(context, spin_until, self.controller)
        self.commands: list[ECU] = []
        self.received: list[PidState] = []
        self.peer.create_subscription(ECU, 'ecu', self.commands.append, qos.DEFAULT)
        self.peer.create_subscription(PidState, 'pid_state', self.received.append, qos.DEFAULT)
        self.states = self.peer.create_publisher(ZDynBkMdl, 'z_vhcl', qos.DEFAULT)

    def send_state(self, stamp: int, v_x: float, **pose: float) -> None:
        """Send a state stamped `stamp` [ns]."""
        self.states.publish(ZDynBkMdl(header=to_header(stamp), v_x=v_x, **pose))

    def answers(self, samples: Sequence[tuple[int, float]]) -> list[float]:
        """Return the accelerations that answer states of these stamps [ns] and speeds [m/s]."""
        before = len(self.commands)
        for stamp, v_x in samples:
            self.send_state(stamp, v_x)
        self.until(lambda: len(self.commands) >= before + len(samples))
        return [command.motor for command in self.commands[before:]]

    def set(self, **values: float) -> list[Any]:
        """Set parameters through the controller's service; return its verdicts."""
        parameters = [parameter.to_parameter_msg() for parameter in overrides(**values)]
        response = self.call(SetParameters, 'controller/set_parameters', parameters=parameters)
        return list(response.results)


@pytest.fixture
def bench(benches: Make) -> Make:
    return partial(benches, Bench)


def expected(samples: Sequence[tuple[float, float]], reference: float = 8.0) -> list[float]:
    """Return what the PID answers to these intervals [s] and speeds [m/s]."""
    pid = speed_controller()
    return [pid.acc_calculate(reference, v_x, dt) for dt, v_x in samples]


def test_each_state_is_answered_once_with_its_own_stamp(bench: Make) -> None:
    one = bench()
    stamps = [10**18 + k * 20 * MS for k in range(5)]
    one.answers([(stamp, 7.9) for stamp in stamps])
    one.until(lambda: len(one.received) == 5)
    assert [to_nanoseconds(command.header.stamp) for command in one.commands] == stamps
    assert [to_nanoseconds(state.header.stamp) for state in one.received] == stamps


def test_the_interval_is_the_difference_of_stamps_also_after_missing_states(bench: Make) -> None:
    answers = bench().answers([(0, 7.9), (20 * MS, 7.91), (80 * MS, 7.95), (90 * MS, 7.96)])
    assert answers == expected([(0.0, 7.9), (0.02, 7.91), (0.06, 7.95), (0.01, 7.96)])


def test_each_command_is_published_with_the_terms_of_the_pid(bench: Make) -> None:
    one = bench(kp=2.0, ki=1.0, kd=0.5, speed_reference=5.0, acceleration_limit=3.0)
    one.answers([(0, 4.0), (100 * MS, 4.2), (200 * MS, 0.0)])
    one.until(lambda: len(one.received) == 3)
    received = one.received[1]

    assert (received.reference, received.measurement, received.error) == pytest.approx(
        (5.0, 4.2, 0.8)
    )
    assert (received.proportional, received.integral) == pytest.approx((1.6, 0.08))
    assert received.derivative == pytest.approx(-1.0)
    assert received.output == one.commands[1].motor == pytest.approx(0.68)
    assert [state.saturated for state in one.received] == [False, False, True]
    assert one.commands[2].motor == 3.0


# Parameters


def test_changed_gains_reference_and_limit_act_on_the_next_state(bench: Make) -> None:
    one = bench(kp=1.0, ki=0.0, kd=0.0)
    assert one.answers([(0, 7.0)]) == [1.0]
    assert all(result.successful for result in one.set(kp=2.0, speed_reference=8.5))
    assert one.answers([(20 * MS, 7.0)]) == [3.0]
    assert one.controller.values['speed_reference'] == 8.5
    assert all(result.successful for result in one.set(acceleration_limit=0.5))
    assert one.answers([(40 * MS, 7.0), (60 * MS, 10.0)]) == [0.5, -0.5]


def test_a_message_on_speed_reference_changes_the_reference(bench: Make) -> None:
    one = bench(kp=1.0, ki=0.0, kd=0.0)
    outer = one.peer.create_publisher(Float64, 'speed_reference', 1)
    one.until(lambda: outer.get_subscription_count() == 1)
    outer.publish(Float64(data=5.0))
    one.until(lambda: one.controller.values['speed_reference'] == 5.0)
    assert one.answers([(0, 4.0)]) == [1.0]
    assert all(result.successful for result in one.set(speed_reference=6.0))
    assert one.answers([(20 * MS, 4.0)]) == [2.0]


def test_after_a_reset_the_controller_answers_as_at_its_start(bench: Make) -> None:
    one = bench()
    samples = [(0, 1.0), (20 * MS, 1.5), (40 * MS, 3.0)]
    first = one.answers(samples)
    one.call(Trigger, 'controller/reset')
    assert one.answers([(stamp + 60 * MS, v_x) for stamp, v_x in samples]) == first


def test_a_controller_that_is_no_pid_has_its_own_gains_and_terms(bench: Make) -> None:
    one = bench(controller_type='lqr', speed_weight=100.0, acceleration_limit=3.0)
    received: list[ControllerState] = []
    one.peer.create_subscription(
        ControllerState, topics.CONTROLLER_STATE, received.append, qos.DEFAULT
    )
    one.until(lambda: one.controller.count_subscribers(topics.CONTROLLER_STATE) == 1)
    lqr = LQR(speed_weight=100.0, output_min=-3.0, output_max=3.0)
    samples = [(0, 7.9), (20 * MS, 7.95), (40 * MS, 4.0)]
    assert one.answers(samples) == [lqr.acc_calculate(8.0, v_x, 0.02) for _, v_x in samples]

    one.until(lambda: len(received) == 3)
    assert one.received == []
    assert received[2].names == ['feedback', 'compensation']
    assert received[2].values.tolist() == [lqr.feedback, lqr.compensation]
    assert (received[2].reference, received[2].measurement, received[2].error) == (8.0, 4.0, 4.0)
    assert [state.saturated for state in received] == [False, False, True]
    assert [result.successful for result in one.set(observer_gain=1.0)] == [True]
    assert [result.successful for result in one.set(observer_gain=1.1, kp=1.0)] == [False, False]


class Whole(Pilot):
    """A pilot whose command and term are whole numbers, which no message takes."""

    terms: ClassVar = {'one': 'a whole number'}

    def command(self, situation: Situation) -> Command:  # noqa: ARG002
        """Return the command."""
        return Command(1, 0)

    def term(self, _: str) -> float:
        """Return the term."""
        return 1


def test_whole_numbers_of_a_users_pilot_are_published(bench: Make) -> None:
    one = bench(controller=Whole())
    received: list[ControllerState] = []
    one.peer.create_subscription(
        ControllerState, topics.CONTROLLER_STATE, received.append, qos.DEFAULT
    )
    one.until(lambda: one.controller.count_subscribers(topics.CONTROLLER_STATE) == 1)
    assert one.answers([(0, 7.0)]) == [1.0]

    one.until(lambda: len(received) == 1)
    assert (received[0].output, received[0].error) == (1.0, 1.0)
    assert (received[0].names, received[0].values.tolist()) == (['one'], [1.0])


def test_on_a_track_both_commands_answer_and_gains_can_be_changed(bench: Make) -> None:
    one = bench(track='oval')
    received: list[LaneState] = []
    one.peer.create_subscription(LaneState, topics.LANE_STATE, received.append, qos.DEFAULT)
    one.until(lambda: one.controller.count_subscribers(topics.LANE_STATE) == 1)
    one.send_state(0, 7.9, x=10.0, y=0.5, psi=0.1)
    one.until(lambda: len(one.commands) == len(received) == 1)
    k1, k2 = LaneLQR().feedback()
    assert one.commands[0].servo == pytest.approx(-0.5 * k1 - 0.1 * k2)
    assert one.commands[0].motor == expected([(0.0, 7.9)])[0]
    assert (received[0].e_y, received[0].e_psi, received[0].saturated) == (0.5, 0.1, False)
    assert (received[0].of_e_y, received[0].of_e_psi) == pytest.approx((-0.5 * k1, -0.1 * k2))
    assert received[0].output == one.commands[0].servo

    changes = {'lane.q_e_y': 0.2, 'lane.q_e_psi': 0.0, 'lane.preview': 99.0, 'lane_type': 'stanley'}
    verdicts = [one.set(**{name: value})[0].successful for name, value in changes.items()]
    assert verdicts == [True, True, False, False]
    one.send_state(20 * MS, 7.9, x=10.0, y=0.5, psi=math.nan)
    one.send_state(40 * MS, 7.9, x=10.0, y=0.5)
    one.until(lambda: len(one.commands) == 2)
    assert one.controller.refused.count == 1
    k1, _ = LaneLQR(q_e_y=0.2, q_e_psi=0.0).feedback()
    assert one.commands[1].servo == pytest.approx(-0.5 * k1)
