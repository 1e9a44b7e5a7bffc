"""The simulator node alone: its topics, services, warnings and parameters."""

from __future__ import annotations

import math
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from barc_interfaces.msg import ECU, AppliedCommand, Environment, EZDynBkMdl, TrackState, ZDynBkMdl
from geometry_msgs.msg import Point, Pose, PoseWithCovarianceStamped, Quaternion
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger

from barc_sim.errors import UserError
from barc_sim.interfaces import qos
from barc_sim.interfaces.stamps import to_nanoseconds
from barc_sim.nodes.simulator import VehicleSimulator

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.context import Context
    from rclpy.publisher import Publisher

    Capture = pytest.CaptureFixture[str]

LOCK_STEP = 0.0
#: As rclpy's and rclcpp's time sources subscribe.
CLOCK_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
OFTEN = 0.02  #: [s] between two checks of the peers


class World:
    """An executor with a simulator, and with the nodes that drive it."""

    def __init__(self, context: Context, spin_until: Callable[..., None]) -> None:
        self.context = context
        self.executor = SingleThreadedExecutor(context=context)
        self.until = partial(spin_until, self.executor)
        self.nodes: list[Node] = []
        self.states: list[ZDynBkMdl] = []

    def add(self, node: Any) -> Any:  # noqa: ANN401 (as it came)
        """Have `node` spun, and destroyed at the end."""
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def simulator(self, *, namespace: str = '', **parameters: Any) -> VehicleSimulator:  # noqa: ANN401
        """Return a simulator with these parameters."""
        options = {
            name: parameters.pop(name) for name in ('on_step', 'check_period') if name in parameters
        }
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        return self.add(
            VehicleSimulator(
                **options,
                context=self.context,
                namespace=namespace,
                parameter_overrides=overrides,
            )
        )

    def driver(self, answer: Callable[[ZDynBkMdl], ECU] | None = None) -> Publisher:
        """Return a publisher of commands; each state is kept, and answered by `answer`."""
        node = self.add(Node('driver', context=self.context))
        commands = node.create_publisher(ECU, 'ecu', qos.DEFAULT)

        def on_state(state: ZDynBkMdl) -> None:
            self.states.append(state)
            if answer:
                commands.publish(answer(state))

        node.create_subscription(ZDynBkMdl, 'z_vhcl', on_state, qos.DEFAULT)
        return commands

    def received(self, message_type: type[Any], topic: str, qos: Any = qos.DEFAULT) -> list[Any]:  # noqa: ANN401
        """Return a list that grows by each message."""
        messages: list[Any] = []
        node = self.add(Node('listener', context=self.context))
        node.create_subscription(message_type, topic, messages.append, qos)
        return messages

    def call(self, kind: Any, service: str, **request: Any) -> None:  # noqa: ANN401
        """Call a service, which succeeds."""
        client = self.add(Node('caller', context=self.context)).create_client(kind, service)
        self.until(client.service_is_ready)
        future = client.call_async(kind.Request(**request))
        self.until(future.done)
        assert future.result().success


@pytest.fixture
def world(ros: Context, spin_until: Callable[..., None]) -> Iterator[World]:
    world = World(ros, spin_until)
    yield world
    world.executor.shutdown()
    for node in world.nodes:
        node.destroy_node()


def command(motor: float, stamp_of: ZDynBkMdl) -> ECU:
    """Return a command that answers a state."""
    return ECU(header=stamp_of.header, motor=motor)


def stamps(messages: list[Any]) -> list[int]:
    return [to_nanoseconds(message.header.stamp) for message in messages]


# Time


@pytest.mark.parametrize('rate', [50.0, 100.0, 30.0])
def test_states_are_stamped_a_period_apart_on_all_topics(world: World, rate: float) -> None:
    errors = world.received(EZDynBkMdl, 'ez_vhcl')
    environments = world.received(Environment, 'environment')
    world.driver(partial(command, 1.0))
    simulator = world.simulator(realtime_factor=LOCK_STEP, rate=rate)
    world.until(lambda: len(world.states) >= 20)
    world.until(lambda: min(len(errors), len(environments)) >= 20)
    begin = stamps(world.states)[0]
    expected = [begin + k * round(1e9 / rate) for k in range(20)]

    assert stamps(world.states)[:20] == expected
    assert stamps(errors)[:20] == stamps(environments)[:20] == expected
    assert abs(begin - time.time_ns()) < 3600e9
    assert simulator.stepper.missed == 0


def test_every_command_that_acts_is_published_and_those_that_were_missed_are_marked(
    world: World,
) -> None:
    applied = world.received(AppliedCommand, 'applied_command')
    commands = world.driver()
    simulator = world.simulator(realtime_factor=1.0)
    world.until(lambda: world.states)
    first = world.states[0]
    commands.publish(command(1.5, first))
    world.until(lambda: simulator.stepper.missed >= 3)
    simulator.stepper.pause(on=True)
    world.until(lambda: len(world.states) == simulator.stepper.states == len(applied) + 1)

    assert stamps(applied) == stamps(world.states)[:-1]
    assert sum(each.missed for each in applied) == simulator.stepper.missed
    # The last command holds where none arrived.
    assert {each.motor for each in applied if each.missed} <= {0.0, 1.5}
    assert applied[-1].motor == 1.5


def test_the_place_on_the_track_arrives_before_its_state(world: World) -> None:
    places: list[TrackState] = []
    pairs: list[tuple[int, int]] = []  # stamps of the state, and of the newest place

    def on_state(state: ZDynBkMdl) -> None:
        pairs.append((stamps([state])[0], stamps(places)[-1]))
        commands.publish(command(1.0, state))

    node = world.add(Node('driver', context=world.context))
    commands = node.create_publisher(ECU, 'ecu', qos.DEFAULT)
    node.create_subscription(TrackState, 'track_vhcl', places.append, qos.DEFAULT)
    node.create_subscription(ZDynBkMdl, 'z_vhcl', on_state, qos.DEFAULT)
    simulator = world.simulator(realtime_factor=LOCK_STEP, track='oval', laps=2, noise_ey=0.5)

    world.until(lambda: len(pairs) >= 150)
    assert [state for state, _ in pairs] == [place for _, place in pairs]

    true_place = simulator.stepper._plant.on_track  # noqa: SLF001 (it is published)
    assert true_place
    last = places[-1]
    assert {name: getattr(last, name) for name in true_place._fields} == true_place._asdict()
    assert last.s > 3.0
    assert (last.e_y, last.header.frame_id) == (0.0, 'map')

    assert simulator.values['servo_lag'] == 0.1
    assert simulator.road.grades_deg == (0.0,)


@pytest.mark.parametrize(
    ('parameters', 'expected'),
    [
        ({}, 0),
        ({'clock': True}, 1),
        ({'realtime_factor': 5.0}, 1),
        ({'realtime_factor': 0.5}, 1),
        ({'realtime_factor': 0.0}, 1),
    ],
)
def test_the_clock_is_published_unless_the_run_is_in_real_time(
    world: World, parameters: dict[str, Any], expected: int
) -> None:
    assert world.simulator(**parameters).count_publishers('/clock') == expected


def test_the_clock_has_the_stamps_of_the_states_and_is_repeated_during_a_pause(
    world: World,
) -> None:
    times = world.received(Clock, '/clock')
    world.driver(partial(command, 1.0))
    world.simulator(realtime_factor=5.0, check_period=OFTEN)
    world.until(lambda: len(times) > 5)
    world.call(SetBool, 'vehicle_simulator/pause', data=True)
    late = world.received(Clock, '/clock', CLOCK_QOS)
    world.until(lambda: len(late) > 5)
    assert {to_nanoseconds(each.clock) for each in late} == {stamps(world.states)[-1]}

    world.call(SetBool, 'vehicle_simulator/pause', data=False)
    world.until(lambda: times[-1] != late[0])
    world.until(lambda: len({to_nanoseconds(each.clock) for each in times}) > 20)
    published = sorted({to_nanoseconds(each.clock) for each in times})
    assert published[:20] == stamps(world.states)[:20]


# Who drives


def test_a_simulator_without_a_controller_waits_and_warns_once(
    world: World, capfd: Capture
) -> None:
    sentence = 'waiting for a controller that publishes /car2/ecu'
    ticks = world.received(ZDynBkMdl, 'never')
    simulator = world.simulator(check_period=OFTEN, namespace='car2')
    log = ''

    def has_warned() -> bool:
        nonlocal log
        log += capfd.readouterr().err
        ticks.append(None)
        return len(ticks) > 10 and sentence in log

    world.until(has_warned)
    assert simulator.stepper.states == 0
    assert log.count(sentence) == 1


def test_no_warning_is_logged_where_a_controller_is_there(world: World, capfd: Capture) -> None:
    world.driver()
    world.simulator().peers.check()  # as where the nodes took a second to be made
    assert 'waiting' not in capfd.readouterr().err


def test_a_new_controller_receives_the_state_that_waits_for_an_answer(world: World) -> None:
    world.driver()
    simulator = world.simulator(check_period=OFTEN, realtime_factor=LOCK_STEP)
    world.until(lambda: simulator.stepper.states == 1)

    world.driver(partial(command, 1.0))
    world.until(lambda: simulator.stepper.states > 3)

    first_stamp = stamps(world.states)[0]
    world.until(lambda: stamps(world.states).count(first_stamp) >= 2)
    assert simulator.stepper.missed == 0


# Parameters, and the place of its own


def test_noise_and_actuators_can_be_changed_while_the_car_drives(world: World) -> None:
    observations: list[Any] = []
    simulator = world.simulator(
        realtime_factor=LOCK_STEP, on_step=lambda _, observation: observations.append(observation)
    )
    world.driver(partial(command, 1.0))
    world.until(lambda: len(observations) > 5)
    assert not any(observations[3].error)

    (result,) = simulator.set_parameters([Parameter('noise_v_x', value=0.5)])
    assert result.successful
    count = len(observations)
    world.until(lambda: len(observations) > count + 2)
    assert observations[count + 1].error.v_x != 0.0

    (refused,) = simulator.set_parameters([Parameter('noise_v_x', value=-1.0)])
    assert not refused.successful


def test_second_simulator_of_a_topic_is_refused_until_the_first_is_gone(world: World) -> None:
    first = world.simulator()
    with pytest.raises(UserError, match=r'another simulator publishes /z_vhcl .*__ns:=/car2'):
        world.simulator()
    world.simulator(namespace='car' * 50)  # as long as no socket's name can be
    first.destroy_node()
    world.simulator()


def test_another_publisher_of_states_is_refused_before_the_first_state(world: World) -> None:
    other = world.add(Node('other', context=world.context))
    other.create_publisher(ZDynBkMdl, 'z_vhcl', qos.DEFAULT)
    simulator = world.simulator(wait_for_controller=False)
    with pytest.raises(UserError, match='another simulator publishes /z_vhcl'):
        world.until(simulator.finished.done)
    assert simulator.stepper.states == 0


# Services


def test_a_reset_resets_the_controller_once_and_waits_for_its_answer(world: World) -> None:
    calls: list[int] = []

    def on_reset(_: Any, response: Any) -> Any:  # noqa: ANN401
        calls.append(simulator.stepper.states)
        return response

    world.driver(partial(command, 1.0))
    controller = world.add(Node('controller', context=world.context))
    controller.create_service(Trigger, '~/reset', on_reset)
    simulator = world.simulator(realtime_factor=LOCK_STEP)
    world.until(lambda: len(world.states) >= 10)
    world.call(Trigger, 'vehicle_simulator/reset')
    world.until(lambda: bool(calls))
    world.until(lambda: simulator.stepper.states > calls[0] + 5)
    world.until(lambda: len(world.states) == simulator.stepper.states)

    assert len(calls) == 1
    assert world.states[calls[0]].x == 0.0
    assert world.states[calls[0] - 1].x > 0.0


def initial_pose(
    x: float, y: float, z: float, w: float, frame: str = 'map'
) -> PoseWithCovarianceStamped:
    message = PoseWithCovarianceStamped(header=Header(frame_id=frame))
    message.pose.pose = Pose(position=Point(x=x, y=y), orientation=Quaternion(z=z, w=w))
    return message


def test_a_pose_on_initialpose_resets_car_and_controller_to_it(
    world: World, capfd: Capture
) -> None:
    resets: list[int] = []

    def on_reset(_: Any, response: Any) -> Any:  # noqa: ANN401
        resets.append(simulator.stepper.states)
        return response

    world.driver(partial(command, 1.0))
    controller = world.add(Node('controller', context=world.context))
    controller.create_service(Trigger, '~/reset', on_reset)
    simulator = world.simulator(realtime_factor=LOCK_STEP, road='flat')
    rviz = world.add(Node('rviz', context=world.context))
    poses = rviz.create_publisher(PoseWithCovarianceStamped, 'initialpose', 1)
    world.until(lambda: len(world.states) >= 10 and poses.get_subscription_count() == 1)
    before = len(resets)

    refused = (
        initial_pose(math.nan, 0.0, 0.0, 1.0),
        initial_pose(0.0, 0.0, 0.0, 0.0),  # no rotation
        initial_pose(0.0, 0.0, 0.0, 1.0, frame='base_link'),
    )
    for number, message in enumerate(refused, 1):
        poses.publish(message)
        world.until(lambda: simulator.refused.count == number)  # noqa: B023 (called at once)
    assert len(resets) == before
    assert capfd.readouterr().err.count('refused an initial pose') == 1

    poses.publish(initial_pose(-30.0, 5.0, 0.6, 0.8))
    world.until(lambda: any(state.x < -29.0 for state in world.states))
    assert len(resets) == before + 1
    placed = next(state for state in world.states if state.x < -29.0)
    assert (placed.x, placed.y, placed.v_x) == (-30.0, 5.0, 0.0)
    assert placed.psi == pytest.approx(2.0 * math.atan2(0.6, 0.8))
    world.until(lambda: world.states[-1].v_x > 0.1)
    assert stamps(world.states) == sorted(stamps(world.states))


def test_a_warning_names_two_nodes_that_publish_commands(world: World, capfd: Capture) -> None:
    world.simulator(check_period=OFTEN)
    for name in ('ours', 'theirs'):
        node = world.add(Node(name, context=world.context))
        commands = node.create_publisher(ECU, 'ecu', qos.DEFAULT)
        node.create_timer(0.005, partial(commands.publish, ECU()))
    warned: list[str] = []

    def are_named() -> bool:
        warned.append(capfd.readouterr().err)
        return '/ours and /theirs publish /ecu and drive together: end one' in ''.join(warned)

    world.until(are_named)


def test_a_warning_names_another_publisher_of_the_clock(world: World, capfd: Capture) -> None:
    world.simulator(check_period=OFTEN, realtime_factor=LOCK_STEP)
    player = world.add(Node('player', context=world.context))
    player.create_publisher(Clock, '/clock', 1)
    warned: list[str] = []

    def is_named() -> bool:
        warned.append(capfd.readouterr().err)
        return '/player and /vehicle_simulator publish /clock and time jumps' in ''.join(warned)

    world.until(is_named)


def test_a_reset_continues_where_the_controller_does_not_answer(
    world: World, capfd: Capture
) -> None:
    world.driver(partial(command, 1.0))
    silent = Node('controller', context=world.context)  # not spun
    silent.create_service(Trigger, '~/reset', lambda _, response: response)
    world.nodes.append(silent)
    simulator = world.simulator(realtime_factor=LOCK_STEP)
    world.until(lambda: len(world.states) >= 5)
    capfd.readouterr()  # it has not answered before the first state, either
    world.call(Trigger, 'vehicle_simulator/reset')
    before = simulator.stepper.states
    world.until(lambda: simulator.stepper.states > before + 3)

    assert capfd.readouterr().err.count('has not answered its reset') == 1
