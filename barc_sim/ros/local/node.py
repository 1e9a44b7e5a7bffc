"""Nodes with QoS, publishers, subscriptions, services, clients, guard conditions and the graph.

Also rclpy's `init` and `shutdown`.
"""

from __future__ import annotations

import re
import sys
from collections import deque
from dataclasses import dataclass
from enum import IntEnum
from functools import partial, partialmethod
from math import inf
from typing import TYPE_CHECKING, Any

from barc_sim.errors import UserError
from barc_sim.ros.local.executor import (
    SECOND,
    CallbackGroup,
    Clock,
    ClockType,
    Executor,
    Future,
    Logger,
    Timer,
    World,
    current,
    not_async,
)
from barc_sim.ros.local.messages import LACKS, message_type
from barc_sim.ros.local.parameters import Arguments, NodeParameters, Parameter

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

HistoryPolicy = IntEnum('HistoryPolicy', 'SYSTEM_DEFAULT KEEP_LAST KEEP_ALL UNKNOWN', start=0)
ReliabilityPolicy = IntEnum(
    'ReliabilityPolicy', 'SYSTEM_DEFAULT RELIABLE BEST_EFFORT UNKNOWN BEST_AVAILABLE', start=0
)
DurabilityPolicy = IntEnum(
    'DurabilityPolicy', 'SYSTEM_DEFAULT TRANSIENT_LOCAL VOLATILE UNKNOWN BEST_AVAILABLE', start=0
)


@dataclass(kw_only=True)
class QoSProfile:
    """The length of a queue, and whether a publisher keeps messages; delivery is reliable."""

    depth: int = 0
    history: Any = HistoryPolicy.KEEP_LAST
    reliability: Any = ReliabilityPolicy.RELIABLE
    durability: Any = DurabilityPolicy.VOLATILE

    def __post_init__(self) -> None:
        keeps_all = self.history == HistoryPolicy.KEEP_ALL
        self.length = None if keeps_all else max(self.depth, 1)
        self.is_latched = self.durability == DurabilityPolicy.TRANSIENT_LOCAL


qos_profile_system_default = QoSProfile(depth=10)
qos_profile_sensor_data = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)


_DOCUMENTED = '(create|destroy|get|set|add|remove|count|declare|undeclare|describe|wait)_'
#: The names of a node's lists of entities.
_KINDS = ('publishers', 'subscriptions', 'services', 'clients', 'timers', 'guards')
#: Of a publisher or subscription that gets the messages from before it began.
LATCHED = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class NotInitializedException(Exception):
    pass


class InvalidTopicNameException(Exception):
    """A topic, service, node or namespace has a name that ROS does not allow."""


def _checked(name: str) -> str:
    """Return `name` if it has words between slashes, perhaps after a `~`; otherwise raise."""
    if not re.fullmatch(r'(/|~/?)?([A-Za-z_]\w*/)*[A-Za-z_]\w*|~', name, re.ASCII):
        raise InvalidTopicNameException(
            f"Invalid name {name!r}: expected letters, digits and '_' between single slashes"
        )
    return name


def _as_profile(qos: QoSProfile | int) -> QoSProfile:
    """Return the profile `qos`, or the profile with this depth."""
    return QoSProfile(depth=qos) if isinstance(qos, int) else qos


class _Entity:
    """An entity of a node as the graph describes it, with a queue of its arrivals."""

    def __init__(
        self, node: Node, name: str, kind: Any, qos: QoSProfile, callback: Any = None
    ) -> None:
        self.node = node
        self.kind = kind
        self.qos_profile = qos
        self.callback = not_async(callback)
        self.topic_name = name
        self.service_name = name
        self.node_name = node.get_name()
        self.node_namespace = node.get_namespace()
        package, interface_kind = kind.__module__.split('.')[:2]
        self.topic_type = f'{package}/{interface_kind}/{kind.__name__}'
        self.endpoint_gid = [*id(self).to_bytes(16, 'little')]
        self.queue: deque[Any] = deque(maxlen=qos.length)

    def offer(self, arrival: Any, number: int = 0) -> None:
        """Queue an arrival, in any thread; a full queue drops its oldest one."""
        del number
        queue = self.queue
        executor = self.node.executor
        is_full = len(queue) == queue.maxlen
        queue.append(arrival)
        if executor is not None and not is_full:
            executor.ready.append(self)
            if executor.waits:
                executor.awake.set()

    def destroy(self) -> None:
        self.queue.clear()


class Publisher(_Entity):
    subscriptions: tuple[Subscription, ...] = ()
    number = 0

    def publish(self, msg: Any) -> None:
        if not isinstance(msg, self.kind):
            raise TypeError(f'Expected {self.kind}, got {type(msg)}')
        self.number += 1
        if self.qos_profile.is_latched:
            self.queue.append((msg.__copy__(), self.number))
        for subscription in self.subscriptions:
            copy = msg.__serialize__() if subscription.raw else msg.__copy__()
            subscription.offer(copy, self.number)

    def get_subscription_count(self) -> int:
        return len(self.subscriptions)

    def wait_for_all_acked(self, _: Any = None) -> bool:
        return True

    def match(self) -> None:
        """Find the subscriptions that get this publisher's messages."""
        on_topic = self.node.context.all('subscriptions', self.topic_name)
        self.subscriptions = tuple(each for each in on_topic if each.kind is self.kind)

    def destroy(self) -> None:
        super().destroy()
        self.subscriptions = ()


class Subscription(_Entity):
    raw = False


class Client(_Entity):
    def call_async(self, request: Any) -> Future:
        if not isinstance(request, self.kind.Request):
            raise TypeError(f'Expected {self.kind.Request}, got {type(request)}')
        future = Future()
        for server in self.node.context.all('services', self.topic_name)[:1]:
            server.offer((request.__copy__(), self, future))
        return future

    def service_is_ready(self) -> bool:
        return bool(self.node.context.all('services', self.topic_name))

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        world = self.node.context
        end = inf if timeout_sec is None else world.now() + timeout_sec * SECOND
        while not self.service_is_ready() and world.now() < end and world.is_ok:
            world.sleep(SECOND // 100)
        return self.service_is_ready()


def _complete(arrival: tuple[Future, Any]) -> None:
    future, response = arrival
    future.set_result(response)


class GuardCondition(_Entity):
    def trigger(self) -> None:
        self.offer(None)


class Node(NodeParameters):
    executor: Executor | None = None

    def __init__(
        self,
        node_name: str,
        *,
        namespace: str | None = None,
        enable_rosout: bool = True,
        start_parameter_services: bool = True,
        parameter_overrides: list[Parameter] | None = None,
    ) -> None:
        self.context: World = current()
        if not self.context.is_ok:
            raise NotInitializedException('rclpy.init() has not been called: cannot create node')
        self.default_callback_group = CallbackGroup()

        remap = self.context.arguments.remap
        name = _checked(node_name)
        self._name = remap('', '__node', '__name') or name
        space = (remap(self._name, '__ns') or namespace or '').strip('/')
        self._namespace = f'/{_checked(space) if space else ""}'

        self.publishers: list[Publisher] = []
        self.subscriptions: list[Subscription] = []
        self.services: list[_Entity] = []
        self.clients: list[Client] = []
        self.timers: list[Timer] = []
        self.guards: list[GuardCondition] = []
        self.context.nodes.append(self)

        self._clock = Clock(clock_type=ClockType.ROS_TIME)
        name = self.get_fully_qualified_name()
        self._logger = Logger(name.strip('/').replace('/', '.'), self.context)
        if enable_rosout:
            log = message_type('rcl_interfaces/msg/Log')
            self._logger.rosout = self.create_publisher(log, '/rosout', LATCHED)

        event = message_type('rcl_interfaces/msg/ParameterEvent')
        events = self.create_publisher(event, '/parameter_events', 1000)
        overrides = self.context.arguments.of(name)
        overrides |= {each.name: each.value for each in parameter_overrides or ()}
        super().__init__(events, overrides)
        if self.declare_parameter('use_sim_time', False).value:
            raise UserError('use_sim_time needs ROS 2: without it there is no /clock; leave it out')
        self.declare_parameter('start_type_description_service', True)
        if start_parameter_services:
            self.serve()

    def __getattr__(self, name: str) -> Any:
        lacks = f': it {LACKS}' if re.match(_DOCUMENTED, name) else ''
        raise AttributeError(f'{type(self).__name__!r} object has no attribute {name!r}{lacks}')

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

    def waiting(self) -> Iterator[_Entity]:
        """Yield each entity once for each message, request or response in its queue."""
        for entity in (*self.subscriptions, *self.services, *self.clients, *self.guards):
            yield from [entity] * len(entity.queue)

    def _expanded(self, name: str) -> str:
        if _checked(name).startswith('~'):
            return f'{self.get_fully_qualified_name()}/{name[1:].strip("/")}'.rstrip('/')
        return name if name.startswith('/') else f'{self._namespace.rstrip("/")}/{name}'

    def resolve_topic_name(self, topic: str) -> str:
        full = self._expanded(topic)
        last = full.rpartition('/')[2]
        if last in self.context.flat_names:
            return f'/{last}'
        new = self.context.arguments.remap(self._name, topic, full)
        return self._expanded(new) if new else full

    resolve_service_name = resolve_topic_name

    def create_publisher(
        self, msg_type: Any, topic: str, qos_profile: Any, *, callback_group: Any = None
    ) -> Publisher:
        del callback_group
        name = self.resolve_topic_name(topic)
        self.publishers.append(Publisher(self, name, msg_type, _as_profile(qos_profile)))
        self.publishers[-1].match()
        return self.publishers[-1]

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[..., Any],
        qos_profile: Any,
        *,
        callback_group: Any = None,
        raw: bool = False,
    ) -> Subscription:
        del callback_group
        name = self.resolve_topic_name(topic)
        qos = _as_profile(qos_profile)
        new = Subscription(self, name, msg_type, qos, callback)
        new.raw = raw
        return self.connect(new)

    def connect(self, new: Subscription) -> Subscription:
        """Add a subscription; if it is latched, it gets the messages that publishers have kept."""
        self.subscriptions.append(new)
        for publisher in self.context.all('publishers', new.topic_name):
            publisher.match()
            if new in publisher.subscriptions and new.qos_profile.is_latched:
                for msg, number in [*publisher.queue]:
                    new.offer(msg.__serialize__() if new.raw else msg.__copy__(), number)
        return new

    def create_service(self, srv_type: Any, srv_name: str, callback: Any, **_: Any) -> _Entity:
        name = self.resolve_service_name(srv_name)
        qos = qos_profile_system_default
        answer = not_async(callback)

        def on_request(arrival: tuple[Any, Client, Future]) -> None:
            request, client, future = arrival
            client.offer((future, answer(request, srv_type.Response()).__copy__()))

        self.services.append(_Entity(self, name, srv_type, qos, on_request))
        return self.services[-1]

    def create_client(self, srv_type: Any, srv_name: str, **_: Any) -> Client:
        name = self.resolve_service_name(srv_name)
        qos = qos_profile_system_default
        self.clients.append(Client(self, name, srv_type, qos, _complete))
        return self.clients[-1]

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[[], Any],
        callback_group: Any = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        del callback_group, clock  # the world has one clock, real or simulated
        timer = Timer(self, int(float(timer_period_sec) * SECOND), callback)
        self.timers.append(timer)
        if autostart:
            timer.reset()
        return timer

    def create_guard_condition(self, callback: Any, callback_group: Any = None) -> GuardCondition:
        del callback_group
        newest = QoSProfile(depth=1)
        self.guards.append(GuardCondition(self, '', GuardCondition, newest, lambda _: callback()))
        return self.guards[-1]

    def _destroy(self, kind: str, entity: Any) -> bool:
        entities = getattr(self, kind)
        if entity not in entities:
            return False
        entities.remove(entity)
        entity.destroy()
        if kind == 'subscriptions':
            for publisher in self.context.all('publishers', entity.topic_name):
                publisher.match()
        return True

    destroy_publisher = partialmethod(_destroy, 'publishers')
    destroy_subscription = partialmethod(_destroy, 'subscriptions')
    destroy_service = partialmethod(_destroy, 'services')
    destroy_client = partialmethod(_destroy, 'clients')
    destroy_timer = partialmethod(_destroy, 'timers')
    destroy_guard_condition = partialmethod(_destroy, 'guards')

    def destroy_node(self) -> None:
        nodes = self.context.nodes
        if self in nodes:
            for kind in _KINDS:
                for entity in [*getattr(self, kind)]:
                    self._destroy(kind, entity)
            nodes.remove(self)
            if self.executor is not None:
                self.executor.remove_node(self)

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [(each.get_name(), each.get_namespace()) for each in self.context.nodes]

    def get_node_names(self) -> list[str]:
        return [name for name, _ in self.get_node_names_and_namespaces()]

    def _types(self, kinds: tuple[str, ...], *of: str) -> list[tuple[str, list[str]]]:
        """Return the topics with their types, of all nodes or `of` one name and namespace."""
        topics: dict[str, set[str]] = {}
        for node in self.context.nodes:
            if not of or (node.get_name(), node.get_namespace()) == of:
                for kind in kinds:
                    for entity in getattr(node, kind):
                        topics.setdefault(entity.topic_name, set()).add(entity.topic_type)
        return [(name, sorted(types)) for name, types in sorted(topics.items())]

    get_topic_names_and_types = partialmethod(_types, ('publishers', 'subscriptions'))
    get_publisher_names_and_types_by_node = partialmethod(_types, ('publishers',))
    get_subscriber_names_and_types_by_node = partialmethod(_types, ('subscriptions',))

    def _count(self, kind: str, name: str) -> int:
        return len(self.context.all(kind, self._expanded(name)))

    count_publishers = partialmethod(_count, 'publishers')
    count_subscribers = partialmethod(_count, 'subscriptions')
    count_services = partialmethod(_count, 'services')

    def _info(self, kind: str, topic: str) -> list[Any]:
        return self.context.all(kind, self.resolve_topic_name(topic))

    get_publishers_info_by_topic = partialmethod(_info, 'publishers')
    get_subscriptions_info_by_topic = partialmethod(_info, 'subscriptions')


SignalHandlerOptions = IntEnum('SignalHandlerOptions', 'NO SIGINT SIGTERM ALL', start=0)


def init(*, args: list[str] | None = None, signal_handler_options: Any = None) -> None:
    """Initialise rclpy; Ctrl-C is a KeyboardInterrupt with any options."""
    del signal_handler_options
    world = current()
    if world.is_ok:
        raise RuntimeError('Context.init() must only be called once')
    words = [] if world.simulated else sys.argv
    world.arguments = Arguments(words if args is None else args)
    world.log_levels |= world.arguments.log_levels
    world.is_ok = True


def shutdown() -> None:
    if not current().is_ok:
        raise RuntimeError('failed to shutdown: the context is not initialized')
    try_shutdown()


def try_shutdown() -> None:
    current().is_ok = False


def ok() -> bool:
    world = current()
    if world.simulated:
        world.sleep(SECOND // 1000)  # so that a loop `while rclpy.ok()` ends
    return world.is_ok


create_node = Node


def _spin(method: str, node: Node, *args: Any, executor: Any = None, **options: Any) -> None:
    executor = executor or Executor()
    before = node.executor
    executor.add_node(node)
    try:
        getattr(executor, method)(*args, **options)
    finally:
        if before is not executor:
            executor.remove_node(node)


spin = partial(_spin, 'spin')
spin_once = partial(_spin, 'spin_once')
spin_until_future_complete = partial(_spin, 'spin_until_future_complete')
