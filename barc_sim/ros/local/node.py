"""Nodes: publishers, subscriptions, services, clients, guard conditions, timers, the graph."""

from __future__ import annotations

import inspect
import threading
from collections import deque
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.ros.local.clocks import SECOND, Clock, Duration, Rate, ROSClock, Time, Timer
from barc_sim.ros.local.context import (
    QOS_ROSOUT,
    Context,
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidServiceNameException,
    InvalidTopicNameException,
    Logger,
    NotInitializedException,
    QoSProfile,
    as_profile,
    check_name,
    get_default_context,
    qos_profile_parameter_events,
    qos_profile_sensor_data,
)
from barc_sim.ros.local.executor import (
    Executor,
    Future,
    MutuallyExclusiveCallbackGroup,
    SingleThreadedExecutor,
)
from barc_sim.ros.local.messages import deserialize_message, message_type, serialize_message
from barc_sim.ros.local.parameters import Parameter, Parameters

if TYPE_CHECKING:
    from collections.abc import Callable


class _Entity:
    """What a node has: a full name on the graph, and a queue of what has arrived."""

    def __init__(self, node: Node, full_name: str, kind: Any, qos: QoSProfile, group: Any) -> None:
        self.node, self.full_name, self.qos_profile = node, full_name, qos
        self.kind, self.callback_group = kind, group or node.default_callback_group
        self.queue: deque[Any] = deque(maxlen=qos.length)

    @property
    def type_name(self) -> str:
        module = self.kind.__module__.split('.')
        return f'{module[0]}/{module[1]}/{self.kind.__name__}'

    def offer(self, arrived: Any) -> None:
        """Take what has arrived; a full queue drops its oldest."""
        queue = self.queue
        full = len(queue) == queue.maxlen
        queue.append(arrived)
        executor = self.node.executor
        if executor is not None and not full:
            executor.push(self)

    def destroy(self) -> None:
        self.queue.clear()


class Publisher(_Entity):
    def __init__(self, *of: Any) -> None:
        super().__init__(*of)
        self.msg_type = self.kind
        self.topic = self.topic_name = self.full_name
        self.subscriptions: tuple[Subscription, ...] = ()
        self._numbers = count(1)
        self.number = 0

    def publish(self, msg: Any) -> None:
        if msg.__class__ is not self.kind:
            if not isinstance(msg, bytes):
                raise TypeError(f'Expected {self.kind}, got {type(msg)}')
            msg = deserialize_message(msg, self.kind)
        self.number += 1
        if self.qos_profile.latched:
            self.queue.append((self.kind.__copy__(msg), self.number))
        for subscription in self.subscriptions:
            subscription.receive(msg, self.number)

    def get_subscription_count(self) -> int:
        return len(self.subscriptions)

    def wait_for_all_acked(self, timeout: Duration | None = None) -> bool:
        return timeout is None or True

    def assert_liveliness(self) -> None:
        """Nothing is late."""

    def match(self) -> None:
        """Find the subscriptions that get this publisher's messages."""
        graph = self.node.context.graph
        same = [s for s in graph.all('subscriptions', self.full_name) if s.kind is self.kind]
        matched = []
        for subscription in same:
            if policy := subscription.qos_profile.refuses(self.qos_profile):
                subscription.warn(policy)
            else:
                matched.append(subscription)
        self.subscriptions = tuple(matched)

    def destroy(self) -> None:
        super().destroy()
        self.subscriptions = ()


class Subscription(_Entity):
    def __init__(self, callback: Any, raw: bool, *of: Any) -> None:
        super().__init__(*of)
        self.callback, self.raw, self.msg_type = callback, raw, self.kind
        self.topic = self.topic_name = self.full_name
        self._copy = self.kind.__copy__
        try:
            inspect.signature(callback).bind(None)
            self.informed = False
        except (TypeError, ValueError):
            self.informed = True
        self._warned = False
        self._received = count(1)

    def receive(self, msg: Any, number: int) -> None:
        """Keep a message of a publisher until the executor calls back."""
        kept = serialize_message(msg) if self.raw else self._copy(msg)
        if self.informed:
            now = self.node.context.world.date()
            info = {'source_timestamp': now, 'received_timestamp': now}
            info |= {'publication_sequence_number': number}
            info |= {'reception_sequence_number': next(self._received)}
            kept = (kept, info)
        self.offer(kept)

    def run(self) -> Any:
        if not self.queue:
            return None
        arrived = self.queue.popleft()
        return self.callback(*arrived) if self.informed else self.callback(arrived)

    def get_publisher_count(self) -> int:
        return len(self.node.context.graph.all('publishers', self.full_name))

    def warn(self, policy: str) -> None:
        if not self._warned:
            self._warned = True
            self.node.get_logger().warning(
                f"New publisher discovered on topic '{self.full_name}', offering incompatible QoS. "
                f'No messages will be received from it. Last incompatible policy: {policy}'
            )


class Service(_Entity):
    def __init__(self, callback: Any, *of: Any) -> None:
        super().__init__(*of)
        self.callback, self.srv_type = callback, self.kind
        self.srv_name = self.service_name = self.full_name

    def run(self) -> Any:
        if not self.queue:
            return None
        request, respond = self.queue.popleft()
        response = self.callback(request, self.kind.Response())
        if inspect.iscoroutine(response):
            return self._answer(response, respond)
        respond(self._checked(response))
        return None

    async def _answer(self, response: Any, respond: Callable[[Any], object]) -> None:
        respond(self._checked(await response))

    def _checked(self, response: Any) -> Any:
        if not isinstance(response, self.kind.Response):
            raise TypeError(f'Expected {self.kind.Response}, got {type(response)}')
        return response


class Client(_Entity):
    def __init__(self, *of: Any) -> None:
        super().__init__(*of)
        self.srv_type = self.kind
        self.srv_name = self.service_name = self.full_name

    def call_async(self, request: Any) -> Future:
        if not isinstance(request, self.kind.Request):
            raise TypeError(f'Expected {self.kind.Request}, got {type(request)}')
        future = Future()
        servers = self.node.context.graph.all('services', self.full_name)
        if servers:
            servers[0].offer((self.kind.Request.__copy__(request), partial(self._respond, future)))
        return future

    def _respond(self, future: Future, response: Any) -> None:
        self.offer((future, self.kind.Response.__copy__(response)))

    def run(self) -> None:
        if self.queue:
            future, response = self.queue.popleft()
            future.executor = self.node.executor
            if not future.cancelled():
                future.set_result(response)

    def remove_pending_request(self, future: Future) -> None:
        future.cancel()

    def call(self, request: Any, timeout_sec: float | None = None) -> Any:
        """Wait for the response; in a callback, others are called meanwhile."""
        future, executor = self.call_async(request), self.node.executor
        if executor is not None and executor.thread in (0, threading.get_ident()):
            executor.spin_until_future_complete(future, timeout_sec)
        else:
            done = threading.Event()
            future.add_done_callback(lambda _: done.set())
            done.wait(timeout_sec)
        return future.result()

    def service_is_ready(self) -> bool:
        return bool(self.node.context.graph.all('services', self.full_name))

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        world = self.node.context.world
        end = float('inf') if timeout_sec is None else world.now() + timeout_sec * SECOND
        while not self.service_is_ready() and world.now() < end and self.node.context.ok():
            world.sleep(SECOND // 100)
        return self.service_is_ready()


class GuardCondition(_Entity):
    def __init__(self, callback: Any, *of: Any) -> None:
        super().__init__(*of)
        self.callback = callback

    def trigger(self) -> None:
        self.offer(None)

    def run(self) -> Any:
        if not self.queue:
            return None
        self.queue.pop()
        return self.callback()


class TopicEndpointInfo(NamedTuple):
    """A publisher or subscription of the graph."""

    node_name: str
    node_namespace: str
    topic_type: str
    endpoint_gid: list[int]
    qos_profile: QoSProfile


class Node(Parameters):
    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: list[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        enable_rosout: bool = True,
        start_parameter_services: bool = True,
        parameter_overrides: list[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        del enable_logger_service
        self.context = context or get_default_context()
        if not self.context.ok():
            raise NotInitializedException('cannot create node')
        self.executor: Executor | None = None
        arguments = [self.context.arguments] if use_global_arguments else []
        if cli_args:
            arguments.insert(0, type(arguments[0])(['--ros-args', *cli_args], self.context.world))
        self._arguments = arguments
        self._named(node_name, namespace or '')
        self.default_callback_group = MutuallyExclusiveCallbackGroup()
        self.publishers: list[Publisher] = []
        self.subscriptions: list[Subscription] = []
        self.services: list[Service] = []
        self.clients: list[Client] = []
        self.timers: list[Timer] = []
        self.guards: list[GuardCondition] = []
        self.context.graph.nodes.append(self)
        self._clock: Clock = ROSClock()
        self._logger = Logger(
            self.get_fully_qualified_name().strip('/').replace('/', '.'), self.context.world
        )
        if enable_rosout:
            log = message_type('rcl_interfaces/msg/Log')
            rosout = self.create_publisher(log, '/rosout', QOS_ROSOUT)
            self.context.world.rosout[self._logger.name] = rosout
        overrides: dict[str, Any] = {}
        for each in reversed(arguments):
            overrides |= each.of(self.get_fully_qualified_name())
        given = {name: Parameter(name, value=value) for name, value in overrides.items()}
        given |= {each.name: each for each in parameter_overrides or ()}
        event = message_type('rcl_interfaces/msg/ParameterEvent')
        events = self.create_publisher(event, '/parameter_events', qos_profile_parameter_events)
        Parameters.__init__(self, events, given, allow_undeclared_parameters)
        if automatically_declare_parameters_from_overrides:
            for name, parameter in given.items():
                self.declare_parameter(name, parameter.value, ignore_override=True)
        self._time_subscription: Subscription | None = None
        if not self.has_parameter('use_sim_time'):
            self.declare_parameter('use_sim_time', False)
        self.declare_parameter('start_type_description_service', True)
        self._follow_clock()
        if start_parameter_services:
            self.serve_parameters()

    def _named(self, name: str, namespace: str) -> None:
        check_name(name, InvalidNodeNameException)
        for each in self._arguments:
            name = each.remap(name, {'__node': '', '__name': ''}) or name
            namespace = each.remap(name, {'__ns': ''}) or namespace
        namespace = f'/{namespace.strip("/")}'
        if namespace != '/':
            check_name(namespace, InvalidNamespaceException, '/')
        self._name, self._namespace = name, namespace

    def get_name(self) -> str:
        return self._name

    def get_namespace(self) -> str:
        return self._namespace

    def get_fully_qualified_name(self) -> str:
        return f'{self._namespace.rstrip("/")}/{self._name}'

    def get_clock(self) -> Clock:
        return self._clock

    def get_logger(self) -> Logger:
        return self._logger

    def take_executor(self, executor: Executor | None) -> None:
        """Let `executor` call back, beginning with what has arrived already."""
        self.executor = executor
        if executor is None:
            return
        for entity in (*self.subscriptions, *self.services, *self.clients, *self.guards):
            for _ in entity.queue:
                executor.push(entity)
        for timer in self.timers:
            timer.schedule()

    def wake(self) -> None:
        """Let the executor look for what is due next."""
        if self.executor is not None and self.executor.waits:
            self.executor.wake()

    # Names

    def _expanded(self, name: str, error: Any) -> str:
        name = name.replace('{node}', self._name).replace('{ns}', self._namespace.strip('/'))
        name = name.replace('{namespace}', self._namespace.strip('/'))
        check_name(name.removeprefix('~'), error, '/') if name != '~' else None
        if name.startswith('~'):
            return self.get_fully_qualified_name() + ('/' + name[1:].strip('/')).rstrip('/')
        return name if name.startswith('/') else f'{self._namespace.rstrip("/")}/{name}'

    def resolve_topic_name(
        self, topic: str, *, only_expand: bool = False, error: Any = InvalidTopicNameException
    ) -> str:
        full = self._expanded(topic, error)
        if (last := full.rpartition('/')[2]) in self.context.world.flat_names:
            return f'/{last}'
        for each in () if only_expand else self._arguments:
            if new := each.remap(self._name, {topic: full, full: full}):
                return self._expanded(new, error)
        return full

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        return self.resolve_topic_name(
            service, only_expand=only_expand, error=InvalidServiceNameException
        )

    # What a node has

    def create_publisher(
        self,
        msg_type: Any,
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        callback_group: Any = None,
        **_: Any,
    ) -> Publisher:
        name = self.resolve_topic_name(topic)
        made = Publisher(self, name, msg_type, as_profile(qos_profile), callback_group)
        self.publishers.append(made)
        made.match()
        return made

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[..., Any],
        qos_profile: QoSProfile | int,
        *,
        callback_group: Any = None,
        raw: bool = False,
        **_: Any,
    ) -> Subscription:
        name = self.resolve_topic_name(topic)
        qos = as_profile(qos_profile)
        made = Subscription(callback, raw, self, name, msg_type, qos, callback_group)
        self.subscriptions.append(made)
        for publisher in self.context.graph.all('publishers', name):
            publisher.match()
            if qos.latched and made in publisher.subscriptions:
                for msg, number in [*publisher.queue]:
                    made.receive(msg, number)
        return made

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[..., Any],
        *,
        qos_profile: QoSProfile | None = None,
        callback_group: Any = None,
    ) -> Service:
        qos = qos_profile or QoSProfile(depth=10)
        name = self.resolve_service_name(srv_name)
        self.services.append(Service(callback, self, name, srv_type, qos, callback_group))
        self.services[-1].srv_name = srv_name
        return self.services[-1]

    def create_client(
        self,
        srv_type: Any,
        srv_name: str,
        *,
        qos_profile: QoSProfile | None = None,
        callback_group: Any = None,
    ) -> Client:
        qos = qos_profile or QoSProfile(depth=10)
        name = self.resolve_service_name(srv_name)
        self.clients.append(Client(self, name, srv_type, qos, callback_group))
        self.clients[-1].srv_name = srv_name
        return self.clients[-1]

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[[], Any],
        callback_group: Any = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        period = int(float(timer_period_sec) * SECOND)
        if period < 0:
            raise ValueError('timer period must be non-negative')
        timer = Timer(self, period, callback, clock or self._clock, callback_group)
        self.timers.append(timer)
        if autostart:
            timer.reset()
        return timer

    def create_guard_condition(
        self, callback: Callable[[], Any], callback_group: Any = None
    ) -> GuardCondition:
        guard = GuardCondition(callback, self, '', None, QoSProfile(depth=1), callback_group)
        self.guards.append(guard)
        return guard

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        if not frequency > 0:
            raise ValueError('frequency must be > 0')
        return Rate(1.0 / frequency, clock or self._clock, self.context)

    def _destroy(self, kind: list[Any], entity: Any) -> bool:
        if entity not in kind:
            return False
        kind.remove(entity)
        entity.destroy()
        return True

    def destroy_publisher(self, publisher: Publisher) -> bool:
        return self._destroy(self.publishers, publisher)

    def destroy_subscription(self, subscription: Subscription) -> bool:
        done = self._destroy(self.subscriptions, subscription)
        for publisher in self.context.graph.all('publishers', subscription.full_name):
            publisher.match()
        return done

    def destroy_service(self, service: Service) -> bool:
        return self._destroy(self.services, service)

    def destroy_client(self, client: Client) -> bool:
        return self._destroy(self.clients, client)

    def destroy_timer(self, timer: Timer) -> bool:
        return self._destroy(self.timers, timer)

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        return self._destroy(self.guards, guard)

    def destroy_rate(self, rate: Rate) -> bool:
        rate.destroy()
        return True

    def destroy_node(self) -> None:
        if self not in self.context.graph.nodes:
            return
        for subscription in [*self.subscriptions]:
            self.destroy_subscription(subscription)
        kinds: tuple[list[Any], ...] = (
            self.publishers,
            self.services,
            self.clients,
            self.timers,
            self.guards,
        )
        for kind in kinds:
            for entity in [*kind]:
                self._destroy(kind, entity)
        self.context.graph.nodes.remove(self)
        self.context.world.rosout.pop(self._logger.name, None)
        if self.executor is not None:
            self.executor.remove_node(self)

    # Time

    def _follow_clock(self) -> None:
        """Subscribe to `/clock`, or no longer, as `use_sim_time` has it."""
        follow = bool(self.get_parameter('use_sim_time').value)
        if follow and not self._time_subscription:
            kind = message_type('rosgraph_msgs/msg/Clock')
            self._clock.set_ros_time_override(Time(clock_type=self._clock.clock_type))
            self._time_subscription = self.create_subscription(
                kind,
                '/clock',
                lambda clock: self._clock.set_ros_time_override(Time.from_msg(clock.clock)),
                qos_profile_sensor_data,
            )
        elif not follow and self._time_subscription:
            self.destroy_subscription(self._time_subscription)
            self._time_subscription = None
            self._clock.set_ros_time_override(None)

    # The graph

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [(each.get_name(), each.get_namespace()) for each in self.context.graph.nodes]

    def get_node_names(self) -> list[str]:
        return [each.get_name() for each in self.context.graph.nodes]

    def get_fully_qualified_node_names(self) -> list[str]:
        return [each.get_fully_qualified_name() for each in self.context.graph.nodes]

    def _types(self, kinds: tuple[str, ...], nodes: list[Node]) -> list[tuple[str, list[str]]]:
        found: dict[str, set[str]] = {}
        for node in nodes:
            for kind in kinds:
                for each in getattr(node, kind):
                    found.setdefault(each.full_name, set()).add(each.type_name)
        return [(name, sorted(types)) for name, types in sorted(found.items())]

    def get_topic_names_and_types(self, no_demangle: bool = False) -> list[tuple[str, list[str]]]:
        del no_demangle
        return self._types(('publishers', 'subscriptions'), self.context.graph.nodes)

    def get_service_names_and_types(self) -> list[tuple[str, list[str]]]:
        return self._types(('services',), self.context.graph.nodes)

    def _by_node(self, kind: str, name: str, namespace: str) -> list[tuple[str, list[str]]]:
        full = f'{namespace.rstrip("/")}/{name}'
        nodes = [
            each for each in self.context.graph.nodes if each.get_fully_qualified_name() == full
        ]
        if not nodes:
            raise LookupError(f'cannot get the names of {kind}: there is no node {full}')
        return self._types((kind,), nodes)

    def get_publisher_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> list[tuple[str, list[str]]]:
        del no_demangle
        return self._by_node('publishers', node_name, node_namespace)

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> list[tuple[str, list[str]]]:
        del no_demangle
        return self._by_node('subscriptions', node_name, node_namespace)

    def get_service_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> list[tuple[str, list[str]]]:
        return self._by_node('services', node_name, node_namespace)

    def get_client_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> list[tuple[str, list[str]]]:
        return self._by_node('clients', node_name, node_namespace)

    def _count(self, kind: str, name: str) -> int:
        return len(self.context.graph.all(kind, self._expanded(name, InvalidTopicNameException)))

    def count_publishers(self, topic_name: str) -> int:
        return self._count('publishers', topic_name)

    def count_subscribers(self, topic_name: str) -> int:
        return self._count('subscriptions', topic_name)

    def count_services(self, service_name: str) -> int:
        return self._count('services', service_name)

    def count_clients(self, service_name: str) -> int:
        return self._count('clients', service_name)

    def _info(self, kind: str, topic: str) -> list[TopicEndpointInfo]:
        return [
            TopicEndpointInfo(
                each.node.get_name(),
                each.node.get_namespace(),
                each.type_name,
                [*id(each).to_bytes(16, 'little')],
                each.qos_profile,
            )
            for each in self.context.graph.all(kind, self.resolve_topic_name(topic))
        ]

    def get_publishers_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        del no_mangle
        return self._info('publishers', topic_name)

    def get_subscriptions_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        del no_mangle
        return self._info('subscriptions', topic_name)


def get_global_executor() -> Executor:
    context = get_default_context()
    if context.executor is None:
        context.executor = SingleThreadedExecutor(context=context)
    return context.executor  # type: ignore[no-any-return]


def create_node(node_name: str, **options: Any) -> Node:
    return Node(node_name, **options)


def spin_once(
    node: Node, *, executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    executor = executor or get_global_executor()
    added = executor.add_node(node)
    try:
        executor.spin_once(timeout_sec)
    finally:
        if added:
            executor.remove_node(node)


def spin(node: Node, executor: Executor | None = None) -> None:
    executor = executor or get_global_executor()
    executor.add_node(node)
    try:
        executor.spin()
    finally:
        executor.remove_node(node)


def spin_until_future_complete(
    node: Node, future: Future, executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    executor = executor or get_global_executor()
    added = executor.add_node(node)
    try:
        executor.spin_until_future_complete(future, timeout_sec)
    finally:
        if added:
            executor.remove_node(node)
