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
from barc_sim.ros.conversions import to_header

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.context import Context

    from barc_sim.control.situation import Situation

    Make = Callable[..., 'Bench']

MS = 1_000_000


class Bench(NodeBench):
    """A controller, and a node that sends it states and receives its answers."""

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
        self.pid_states: list[PidState] = []
        self.peer.create_subscription(ECU, 'ecu', self.commands.append, qos.DEFAULT)
        self.peer.create_subscription(PidState, 'pid_state', self.pid_states.append, qos.DEFAULT)
        self.states = self.peer.create_publisher(ZDynBkMdl, 'z_vhcl', qos.DEFAULT)

    def send_state(self, stamp: int, v_x: float, **pose: float) -> None:
        """Send a state stamped `stamp` [ns]."""
        self.states.publish(ZDynBkMdl(header=to_header(stamp), v_x=v_x, **pose))

    def controller_states(self) -> list[ControllerState]:
        """Return a list that grows by each state of a controller that is no PID."""
        return self.grow(ControllerState, topics.CONTROLLER_STATE)

    def lane_states(self) -> list[LaneState]:
        """Return a list that grows by each state of the steering law."""
        return self.grow(LaneState, topics.LANE_STATE)

    def grow(self, kind: type[Any], topic: str) -> list[Any]:
        """Return a list that grows by each message of a topic."""
        messages: list[Any] = []
        self.peer.create_subscription(kind, topic, messages.append, qos.DEFAULT)
        self.until(lambda: self.controller.count_subscribers(topic) == 1)
        return messages

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
def make_bench(benches: Make) -> Make:
    return partial(benches, Bench)


def answers_of_pid(samples: Sequence[tuple[float, float]], reference: float = 8.0) -> list[float]:
    """Return what the PID answers to these intervals [s] and speeds [m/s]."""
    pid = speed_controller()
    return [pid.acc_calculate(reference, v_x, dt) for dt, v_x in samples]


def test_each_state_is_answered_once_with_its_own_stamp(make_bench: Make) -> None:
    bench = make_bench()
    stamps = [10**18 + k * 20 * MS for k in range(5)]

    bench.answers([(stamp, 7.9) for stamp in stamps])
    bench.until(lambda: len(bench.pid_states) == 5)

    assert [to_nanoseconds(command.header.stamp) for command in bench.commands] == stamps
    assert [to_nanoseconds(state.header.stamp) for state in bench.pid_states] == stamps


def test_the_interval_is_the_difference_of_stamps_also_after_missing_states(
    make_bench: Make,
) -> None:
    answers = make_bench().answers([(0, 7.9), (20 * MS, 7.91), (80 * MS, 7.95), (90 * MS, 7.96)])
    assert answers == answers_of_pid([(0.0, 7.9), (0.02, 7.91), (0.06, 7.95), (0.01, 7.96)])


def test_each_command_is_published_with_the_terms_of_the_pid(make_bench: Make) -> None:
    bench = make_bench(kp=2.0, ki=1.0, kd=0.5, speed_reference=5.0, acceleration_limit=3.0)
    bench.answers([(0, 4.0), (100 * MS, 4.2), (200 * MS, 0.0)])
    bench.until(lambda: len(bench.pid_states) == 3)

    state = bench.pid_states[1]
    assert (state.reference, state.measurement, state.error) == pytest.approx((5.0, 4.2, 0.8))
    assert (state.proportional, state.integral) == pytest.approx((1.6, 0.08))
    assert state.derivative == pytest.approx(-1.0)
    assert state.output == bench.commands[1].motor == pytest.approx(0.68)
    assert [state.saturated for state in bench.pid_states] == [False, False, True]
    assert bench.commands[2].motor == 3.0


# Parameters


def test_changed_gains_reference_and_limit_act_on_the_next_state(make_bench: Make) -> None:
    bench = make_bench(kp=1.0, ki=0.0, kd=0.0)
    assert bench.answers([(0, 7.0)]) == [1.0]

    assert all(result.successful for result in bench.set(kp=2.0, speed_reference=8.5))
    assert bench.answers([(20 * MS, 7.0)]) == [3.0]
    assert bench.controller.values['speed_reference'] == 8.5

    assert all(result.successful for result in bench.set(acceleration_limit=0.5))
    assert bench.answers([(40 * MS, 7.0), (60 * MS, 10.0)]) == [0.5, -0.5]


def test_a_message_on_speed_reference_changes_the_reference(make_bench: Make) -> None:
    bench = make_bench(kp=1.0, ki=0.0, kd=0.0)
    references = bench.peer.create_publisher(Float64, 'speed_reference', 1)
    bench.until(lambda: references.get_subscription_count() == 1)

    references.publish(Float64(data=5.0))
    bench.until(lambda: bench.controller.values['speed_reference'] == 5.0)
    assert bench.answers([(0, 4.0)]) == [1.0]

    assert all(result.successful for result in bench.set(speed_reference=6.0))
    assert bench.answers([(20 * MS, 4.0)]) == [2.0]


def test_after_a_reset_the_controller_answers_as_at_its_start(make_bench: Make) -> None:
    bench = make_bench()
    samples = [(0, 1.0), (20 * MS, 1.5), (40 * MS, 3.0)]
    first = bench.answers(samples)

    bench.call(Trigger, 'controller/reset')

    assert bench.answers([(stamp + 60 * MS, v_x) for stamp, v_x in samples]) == first


def test_a_controller_that_is_no_pid_has_its_own_gains_and_terms(make_bench: Make) -> None:
    bench = make_bench(controller_type='lqr', speed_weight=100.0, acceleration_limit=3.0)
    states = bench.controller_states()
    lqr = LQR(speed_weight=100.0, output_min=-3.0, output_max=3.0)
    samples = [(0, 7.9), (20 * MS, 7.95), (40 * MS, 4.0)]
    assert bench.answers(samples) == [lqr.acc_calculate(8.0, v_x, 0.02) for _, v_x in samples]

    bench.until(lambda: len(states) == 3)
    assert bench.pid_states == []
    assert states[2].names == ['feedback', 'compensation']
    assert states[2].values.tolist() == [lqr.feedback, lqr.compensation]
    assert (states[2].reference, states[2].measurement, states[2].error) == (8.0, 4.0, 4.0)
    assert [state.saturated for state in states] == [False, False, True]

    assert [result.successful for result in bench.set(observer_gain=1.0)] == [True]
    assert [result.successful for result in bench.set(observer_gain=1.1, kp=1.0)] == [False, False]


class Whole(Pilot):
    """A pilot whose command and term are whole numbers, which no message takes."""

    terms: ClassVar = {'one': 'a whole number'}

    def command(self, situation: Situation) -> Command:  # noqa: ARG002
        """Return the command."""
        return Command(1, 0)

    def term(self, _: str) -> float:
        """Return the term."""
        return 1


def test_whole_numbers_of_a_users_pilot_are_published(make_bench: Make) -> None:
    bench = make_bench(controller=Whole())
    states = bench.controller_states()

    assert bench.answers([(0, 7.0)]) == [1.0]
    bench.until(lambda: len(states) == 1)

    (state,) = states
    assert (state.output, state.error) == (1.0, 1.0)
    assert (state.names, state.values.tolist()) == (['one'], [1.0])


def test_on_a_track_one_command_steers_and_holds_the_speed(make_bench: Make) -> None:
    bench = make_bench(track='oval')
    lane_states = bench.lane_states()

    bench.send_state(0, 7.9, x=10.0, y=0.5, psi=0.1)
    bench.until(lambda: len(bench.commands) == len(lane_states) == 1)

    k1, k2 = LaneLQR().feedback()
    (command,) = bench.commands
    assert command.servo == pytest.approx(-0.5 * k1 - 0.1 * k2)
    assert [command.motor] == answers_of_pid([(0.0, 7.9)])
    (lane,) = lane_states
    assert (lane.e_y, lane.e_psi, lane.saturated) == (0.5, 0.1, False)
    assert (lane.of_e_y, lane.of_e_psi) == pytest.approx((-0.5 * k1, -0.1 * k2))
    assert lane.output == command.servo


def test_changed_gains_of_the_steering_act_on_the_next_state(make_bench: Make) -> None:
    bench = make_bench(track='oval')

    changes = {'lane.q_e_y': 0.2, 'lane.q_e_psi': 0.0, 'lane.preview': 99.0, 'lane_type': 'stanley'}
    verdicts = [bench.set(**{name: value})[0].successful for name, value in changes.items()]
    assert verdicts == [True, True, False, False]

    bench.send_state(0, 7.9, x=10.0, y=0.5)
    bench.until(lambda: len(bench.commands) == 1)
    k1, _ = LaneLQR(q_e_y=0.2, q_e_psi=0.0).feedback()
    assert bench.commands[0].servo == pytest.approx(-0.5 * k1)


def test_on_a_track_a_state_without_a_heading_is_not_answered(make_bench: Make) -> None:
    bench = make_bench(track='oval')

    bench.send_state(0, 7.9, x=10.0, y=0.5, psi=math.nan)
    bench.send_state(20 * MS, 7.9, x=10.0, y=0.5)
    bench.until(lambda: len(bench.commands) == 1)

    assert bench.controller.refused.count == 1
    assert to_nanoseconds(bench.commands[0].header.stamp) == 20 * MS
