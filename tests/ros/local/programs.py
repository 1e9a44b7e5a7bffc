"""Programs of rclpy's documented API: `programs.py ros|local` runs each and prints its results."""

from __future__ import annotations

import sys
import tempfile
import time
import traceback
from typing import Any

if sys.argv[1] == 'local':
    from barc_sim.ros import local

    local.install()

import rclpy
from barc_interfaces.msg import ECU, ControllerState
from geometry_msgs.msg import PoseWithCovariance, Twist, Vector3
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterEvent,
    SetParametersResult,
)
from rcl_interfaces.srv import SetParameters
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from rclpy.time import Time
from std_msgs.msg import Float64, Header, String
from std_srvs.srv import SetBool, Trigger

LATCHED = QoSProfile(depth=2, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def spin(node: Node, future: Future, seconds: float = 60.0) -> None:
    rclpy.spin_until_future_complete(node, future, timeout_sec=seconds)
    assert future.done()


def attempt(call: Any) -> None:
    """Print the kind of error that `call` raises, and its text."""
    try:
        print(call())
    except Exception as error:
        print(type(error).__name__, error)


def wait_for(node: Node, count: Any, *arguments: Any, number: int = 1) -> None:
    while count(*arguments) < number:
        rclpy.spin_once(node, timeout_sec=0.01)


def a_message_that_is_used_again_reaches_each_subscription_as_it_was(node: Node) -> None:
    got: list[Any] = []
    done = Future()

    def on_twist(twist: Twist) -> None:
        got.append(twist)
        twist.angular.z += 1.0
        if len(got) == 6:
            done.set_result(None)

    for _ in range(2):
        node.create_subscription(Twist, 'cmd_vel', on_twist, 10)
    publisher = node.create_publisher(Twist, 'cmd_vel', 10)
    wait_for(node, publisher.get_subscription_count, number=2)
    twist = Twist()
    for k in range(3):
        twist.linear.x = float(k)
        publisher.publish(twist)
    spin(node, done)
    print(sorted((each.linear.x, each.angular.z) for each in got), twist.angular.z)


def fields_of_many_kinds(node: Node) -> None:
    done = Future()
    node.create_subscription(ControllerState, 'state', done.set_result, 10)
    publisher = node.create_publisher(ControllerState, 'state', 10)
    wait_for(node, publisher.get_subscription_count)
    state = ControllerState(header=Header(frame_id='road'), names=['kp', 'ü'], values=[1.0, 2.5])
    publisher.publish(state)
    state.names.append('later')
    state.values.append(3.0)
    spin(node, done)
    print(done.result(), list(state.values), done.result() == state)
    pose = PoseWithCovariance()
    print(len(pose.covariance), pose.pose.orientation.w, float(sum(pose.covariance)))
    print(Twist(linear=Vector3(x=1.0)))
    try:
        publisher.publish(Twist())
    except TypeError as error:
        print(str(error).startswith('Expected'))
    attempt(lambda: ECU(1.0))
    attempt(lambda: setattr(ECU(), 'speed', 1.0))


def a_full_queue_drops_its_oldest(node: Node) -> None:
    got: list[float] = []
    node.create_subscription(Float64, 'speed', lambda message: got.append(message.data), 3)
    publisher = node.create_publisher(Float64, 'speed', 10)
    wait_for(node, publisher.get_subscription_count)
    for k in range(8):
        publisher.publish(Float64(data=float(k)))
    while len(got) < 3:
        rclpy.spin_once(node, timeout_sec=1.0)
    rclpy.spin_once(node, timeout_sec=0.05)
    print(got)


def raw_messages(node: Node) -> None:
    done = Future()
    node.create_subscription(String, 'note', done.set_result, 10, raw=True)
    publisher = node.create_publisher(String, 'note', 10)
    wait_for(node, publisher.get_subscription_count)
    publisher.publish(String(data='wet'))
    spin(node, done)
    print(done.result())


def latched_messages(node: Node) -> None:
    publisher = node.create_publisher(String, 'road', LATCHED)
    for text in ('a', 'b', 'c'):
        publisher.publish(String(data=text))
    got: list[str] = []
    later = rclpy.create_node('later')
    later.create_subscription(String, 'road', lambda message: got.append(message.data), LATCHED)
    while len(got) < 2:
        rclpy.spin_once(later, timeout_sec=1.0)
    others: list[Any] = []
    later.create_subscription(String, 'road', others.append, 10)
    rclpy.spin_once(later, timeout_sec=0.1)
    print(got, others)
    later.destroy_node()


def declared_parameters(node: Node) -> None:
    speeds = ParameterDescriptor(floating_point_range=[FloatingPointRange(to_value=10.0)])
    print(node.declare_parameter('speed', 8.0, speeds).value)
    laps = ParameterDescriptor(integer_range=[IntegerRange(from_value=1, to_value=9)])
    node.declare_parameter('laps', 3, laps)
    node.declare_parameter('road', 'lab', ParameterDescriptor(read_only=True))
    node.declare_parameters('gains', [('kp', 1.0), ('names', ['a', 'b']), ('all', [1, 2])])
    for name, value in (
        *(('speed', 9.5), ('speed', 11.0), ('speed', 'x'), ('speed', 3), ('laps', 4)),
        *(('road', 'flat'), ('gains.kp', 2.0), ('gains.names', ['c']), ('laps', 10)),
    ):
        (result,) = node.set_parameters([Parameter(name, value=value)])
        print(name, value, result.successful, result.reason)
    print([(each.name, each.value) for each in node.get_parameters(['speed', 'laps', 'gains.kp'])])
    print(node.has_parameter('gains.kp'), node.has_parameter('mass'))
    print(sorted(node.list_parameters([], 0).names)[:3], node.get_parameter('speed').type_)
    attempt(lambda: node.get_parameter('mass'))
    attempt(lambda: node.declare_parameter('speed', 1.0))
    attempt(lambda: node.declare_parameter('top', 12.0, speeds))
    attempt(lambda: Parameter('x', value={}))


def callbacks_of_parameters(node: Node) -> None:
    node.declare_parameter('kp', 1.0)
    said: list[str] = []

    def check(parameters: list[Parameter]) -> SetParametersResult:
        said.append('check')
        low = any(each.value < 0.0 for each in parameters)
        return SetParametersResult(successful=not low, reason='too low' if low else '')

    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(lambda p: said.append(f'after {p[0].value}'))
    for value in (2.0, -1.0):
        print(node.set_parameters([Parameter('kp', value=value)]))
    attempt(lambda: node.declare_parameter('ki', -5.0))
    print(said, node.get_parameter('kp').value, node.has_parameter('ki'))


def events_of_parameters(node: Node) -> None:
    got: list[Any] = []
    node.create_subscription(ParameterEvent, '/parameter_events', got.append, 10)
    wait_for(node, node.count_publishers, '/parameter_events')
    node.declare_parameter('kp', 1.0)
    node.set_parameters([Parameter('kp', value=2.0)])
    while len(got) < 2:
        rclpy.spin_once(node, timeout_sec=1.0)
    for event in got:
        event.stamp.sec = event.stamp.nanosec = 0
        print(event)


def parameters_over_services(node: Node) -> None:
    node.declare_parameter('kp', 1.0)
    executor = SingleThreadedExecutor()
    other = rclpy.create_node('other')
    for each in (node, other):
        executor.add_node(each)

    def call(kind: Any, name: str, request: Any) -> Any:
        client = other.create_client(kind, f'{node.get_fully_qualified_name()}/{name}')
        client.wait_for_service(5.0)
        future = client.call_async(request)
        executor.spin_until_future_complete(future, 5.0)
        return future.result()

    for value in (3.0, 'x'):
        message = Parameter('kp', value=value).to_parameter_msg()
        print(call(SetParameters, 'set_parameters', SetParameters.Request(parameters=[message])))
    node.declare_parameter('names', ['a'])
    message = Parameter('names', value=['b', 'c']).to_parameter_msg()
    call(SetParameters, 'set_parameters', SetParameters.Request(parameters=[message]))
    print(type(node.get_parameter('names').value), node.get_parameter('names').value)
    executor.shutdown()
    other.destroy_node()


def services_and_clients(node: Node) -> None:
    def on_pause(request: Any, response: Any) -> Any:
        response.success, response.message = request.data, 'paused'
        return response

    client = node.create_client(SetBool, 'pause')
    print(client.service_is_ready(), client.wait_for_service(timeout_sec=0.1))
    service = node.create_service(SetBool, 'pause', on_pause)
    print(client.wait_for_service(timeout_sec=5.0), client.service_name)
    answers = [client.call_async(SetBool.Request(data=on)) for on in (True, False)]
    heard: list[Any] = []
    answers[0].add_done_callback(lambda future: heard.append(future.result().success))
    for answer in answers:
        spin(node, answer)
    rclpy.spin_once(node, timeout_sec=0.1)
    print([answer.result() for answer in answers], heard)
    print(node.destroy_service(service), node.destroy_service(service))


def an_error_in_a_callback_ends_the_spin(node: Node) -> None:
    def on_timer() -> None:
        raise ValueError('no road')

    timer = node.create_timer(0.01, on_timer)
    attempt(lambda: rclpy.spin_once(node, timeout_sec=5.0))
    timer.cancel()
    print(timer.is_canceled())


def timers(node: Node) -> None:
    fired: list[int] = []
    done = Future()

    def on_timer() -> None:
        fired.append(1)
        if len(fired) == 3:
            timer.cancel()
            done.set_result(None)

    steady = Clock(clock_type=ClockType.STEADY_TIME)
    timer = node.create_timer(0.02, on_timer, clock=steady, autostart=False)
    rclpy.spin_once(node, timeout_sec=0.05)
    print(fired, timer.is_canceled(), timer.timer_period_ns)
    timer.reset()
    spin(node, done)
    rclpy.spin_once(node, timeout_sec=0.05)
    print(fired, timer.is_canceled(), node.destroy_timer(timer))
    late = node.create_timer(0.01, lambda: fired.append(2))
    time.sleep(0.055)
    rclpy.spin_once(node, timeout_sec=0.0)
    print(fired[3:], late.is_canceled())


def times_and_durations(_: Node) -> None:
    a, b = Time(seconds=5, nanoseconds=3), Time(seconds=2)
    print(a, repr(a - b), a > b, a == b, a + Duration(seconds=1.5), a.to_msg())
    print(Time.from_msg(a.to_msg()), [Duration(seconds=-1)], Duration(seconds=1) <= Duration())
    attempt(lambda: a < Time(clock_type=ClockType.STEADY_TIME))
    attempt(lambda: a == 3)
    print(Duration(nanoseconds=1_500_000_000).to_msg(), [b - a])


def guards_and_wakes(node: Node) -> None:
    import threading

    done = Future()
    guard = node.create_guard_condition(lambda: done.set_result('woken'))
    threading.Timer(0.05, guard.trigger).start()
    spin(node, done)
    print(done.result())
    other, publisher = Future(), node.create_publisher(String, 'note', 10)
    node.create_subscription(String, 'note', other.set_result, 10)
    wait_for(node, publisher.get_subscription_count)
    threading.Timer(0.05, lambda: publisher.publish(String(data='thread'))).start()
    spin(node, other)
    last = Future()
    threading.Timer(0.05, lambda: last.set_result('set')).start()
    spin(node, last)
    print(other.result(), last.result())


def names(_: Node) -> None:
    rclpy.shutdown()
    rclpy.init(args=[
        '--ros-args', '-r', 'ecu:=command', '-r', '__node:=truck', '-p', 'mass:=2000.0',
        '-p', 'truck:laps:=3', '-p', 'other:speed:=1.0', '-r', '/clock:=/time',
    ])  # fmt: skip
    node = rclpy.create_node('car', namespace='lab/east')
    for name in ('ecu', '~/ecu', '/ecu', 'a/b', '/clock'):
        print(name, node.resolve_topic_name(name), node.resolve_service_name(name))
    print(node.get_name(), node.get_namespace(), node.get_fully_qualified_name())
    print(node.declare_parameter('mass', 1.0).value, node.declare_parameter('laps', 1).value)
    print(node.declare_parameter('speed', 5.0).value)
    print(node.create_publisher(ECU, 'ecu', 1).topic_name, node.count_publishers('ecu'))
    for name in ('a b', '', 'a//b', '1a', 'a/'):
        for create in (rclpy.create_node, lambda name: node.create_publisher(ECU, name, 1)):
            try:
                create(name)
            except Exception as error:
                print(name, type(error).__name__.startswith('Invalid'))
    node.destroy_node()


def the_graph(node: Node) -> None:
    other = rclpy.create_node('other', namespace='/east')
    other.create_publisher(String, 'note', LATCHED)
    node.create_subscription(String, '/east/note', lambda _: None, 1)
    other.create_service(Trigger, 'reset', print)
    wait_for(node, node.count_publishers, '/east/note')
    wait_for(node, node.count_services, '/east/reset')
    wait_for(node, node.count_subscribers, '/east/note')
    print(sorted(node.get_node_names_and_namespaces()), node.count_publishers('note'))
    print(dict(node.get_topic_names_and_types())['/east/note'])
    print(node.get_publisher_names_and_types_by_node('other', '/east'))
    (info,) = node.get_publishers_info_by_topic('/east/note')
    print(info.node_name, info.node_namespace, info.topic_type, info.qos_profile.durability)
    other.destroy_node()
    while 'other' in node.get_node_names():
        rclpy.spin_once(node, timeout_sec=0.05)
    print(node.count_publishers('/east/note'))


def the_log(node: Node) -> None:
    from rcl_interfaces.msg import Log

    got: list[Any] = []
    qos = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    logger = node.get_logger()
    print(logger.name, logger.get_effective_level().name)
    for k in range(3):
        logger.info('throttled', throttle_duration_sec=100.0)
        logger.warning('once', once=True)
        logger.debug('nobody reads this')
        logger.fatal(f'{k}')
    node.create_subscription(Log, '/rosout', got.append, qos)
    while len(got) < 5:
        rclpy.spin_once(node, timeout_sec=1.0)
    print([(each.level, each.name, each.msg, each.function) for each in got])


def ends_and_begins(node: Node) -> None:
    attempt(lambda: rclpy.init(args=[]))
    rclpy.shutdown()
    try:
        Node('early')
    except Exception as error:
        print(type(error).__name__, node.context.ok())
    rclpy.init(args=['--ros-args', '-r', '__ns:=/lab'])
    own = Node('own')
    with MultiThreadedExecutor() as executor:
        print(executor.add_node(own), executor.add_node(own), own.get_fully_qualified_name())
        own.create_timer(0.01, rclpy.shutdown)
        executor.spin()
    print(rclpy.ok(), own.context.ok(), executor.shutdown())
    rclpy.try_shutdown()


def arguments(_: Node) -> None:
    def overrides(*words: str) -> None:
        rclpy.try_shutdown()
        rclpy.init(args=['--ros-args', *words])
        for space in ('/', '/car1', '/a/b'):
            own = Node('own', namespace=space)
            print(space, [own.declare_parameter(name, 0.5).value for name in ('kp', 'a.b')])
            own.destroy_node()

    for nodes in ('own', '/**', '/*', '/**/own', '/*/own', '/car1/*', '/car1/**', 'car1/own'):
        print(nodes)
        with tempfile.NamedTemporaryFile('w', encoding='utf-8', suffix='.yaml') as file:
            file.write(f'{nodes}:\n  ros__parameters:\n    kp: 1e3\n    a:\n      b: -.inf\n')
            file.flush()
            overrides('--params-file', file.name)
    for value in ('1.5', '.5', '+5.', '-1e+3', '.5e1', 'inf', '-inf'):
        overrides('-p', f'own:kp:={value}', '-p', 'a.b:=2.0', '-p', 'a.b:=3.0')
    for wrong in ('[1, 2.0]', '{a: 1}', '[1'):
        try:
            overrides('-p', f'kp:={wrong}')
        except RuntimeError:
            print('refused')


PROGRAMS = [
    value
    for name, value in list(globals().items())
    if callable(value) and getattr(value, '__module__', '') == __name__
    and name not in ('spin', 'attempt', 'wait_for')
]  # fmt: skip

if __name__ == '__main__':
    for program in PROGRAMS:
        rclpy.init(args=[])
        node = Node('car')
        print('==', program.__name__, flush=True)
        try:
            program(node)
        except Exception:
            traceback.print_exc(file=sys.stdout)
        node.destroy_node()
        rclpy.try_shutdown()
        sys.stdout.flush()
