"""Nodes: names, entities, parameters and the graph."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from barc_sim.errors import UserError
from barc_sim.ros.local.clock import Clock, ClockType
from barc_sim.ros.local.entities import (
    Client,
    Entity,
    GuardCondition,
    Publisher,
    Subscription,
    complete_request,
)
from barc_sim.ros.local.executor import CallbackGroup, Executor, Future, Timer, not_async
from barc_sim.ros.local.logger import Logger
from barc_sim.ros.local.messages import LACKS, message_type
from barc_sim.ros.local.parameters import NodeParameters, Parameter
from barc_sim.ros.local.qos import LATCHED, QoSProfile, as_profile, qos_profile_system_default
from barc_sim.ros.local.world import SECOND, World, current

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_DOCUMENTED = '(create|destroy|get|set|add|remove|count|declare|undeclare|describe|wait)_'
#: The names of a node's lists of entities.
_KINDS = ('publishers', 'subscriptions', 'services', 'clients', 'timers', 'guards')


class NotInitializedException(Exception):
    """rclpy is not initialised."""


class InvalidTopicNameException(Exception):
    """A topic, service, node or namespace has a name that ROS does not allow."""


def _checked(name: str) -> str:
    """Return `name` if it has words between slashes, perhaps after a `~`; otherwise raise."""
    if not re.fullmatch(r'(/|~/?)?([A-Za-z_]\w*/)*[A-Za-z_]\w*|~', name, re.ASCII):
        raise InvalidTopicNameException(
            f"Invalid name {name!r}: expected letters, digits and '_' between single slashes"
        )
    return name


class Node(NodeParameters):
    """A node.

    Parameters
    ----------
    node_name, namespace
        Its name, which a remapping can replace.
    enable_rosout
        Whether its log is published on `/rosout`.
    start_parameter_services
        Whether it has the service `~/set_parameters`.
    parameter_overrides
        Values that replace those of the command line, and the defaults.

    Attributes
    ----------
    executor
        The one that calls its callbacks; None: none does.

    Raises
    ------
    NotInitializedException
        rclpy is not initialised.
    InvalidTopicNameException
        ROS does not allow the name.
    UserError
        The parameter `use_sim_time` is true.
    """

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
        self.services: list[Entity] = []
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
        """Return the name, without the namespace."""
        return self._name

    def get_namespace(self) -> str:
        """Return the namespace, which begins with a slash."""
        return self._namespace

    def get_fully_qualified_name(self) -> str:
        """Return namespace and name."""
        return f'{self._namespace.rstrip("/")}/{self._name}'

    def get_clock(self) -> Clock:
        """Return the clock of the node."""
        return self._clock

    def get_logger(self) -> Logger:
        """Return the logger of the node."""
        return self._logger

    def waiting(self) -> Iterator[Entity]:
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
        """Create a publisher.

        Parameters
        ----------
        msg_type, topic
            The class of the messages, and the name of the topic.
        qos_profile
            A `QoSProfile`, or the depth of one.
        callback_group
            As in rclpy, but without effect.

        Returns
        -------
        Publisher
            The publisher.
        """
        del callback_group
        name = self.resolve_topic_name(topic)
        publisher = Publisher(self, name, msg_type, as_profile(qos_profile))
        self.publishers.append(publisher)
        publisher.match()
        return publisher

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
        """Create a subscription.

        Parameters
        ----------
        msg_type, topic
            The class of the messages, and the name of the topic.
        callback
            Called with each message.
        qos_profile
            A `QoSProfile`, or the depth of one.
        callback_group
            As in rclpy, but without effect.
        raw
            Whether the callback gets the messages serialized.

        Returns
        -------
        Subscription
            The subscription.
        """
        del callback_group
        name = self.resolve_topic_name(topic)
        qos = as_profile(qos_profile)
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

    def create_service(self, srv_type: Any, srv_name: str, callback: Any, **_: Any) -> Entity:
        """Create a service.

        Parameters
        ----------
        srv_type, srv_name
            The class of the service, and its name.
        callback
            Called with a request and an empty response; returns the response.
        **_
            As in rclpy, but without effect.

        Returns
        -------
        Entity
            The service.
        """
        name = self.resolve_service_name(srv_name)
        qos = qos_profile_system_default
        answer = not_async(callback)

        def on_request(arrival: tuple[Any, Client, Future]) -> None:
            request, client, future = arrival
            client.offer((future, answer(request, srv_type.Response()).__copy__()))

        service = Entity(self, name, srv_type, qos, on_request)
        self.services.append(service)
        return service

    def create_client(self, srv_type: Any, srv_name: str, **_: Any) -> Client:
        """Create a client of a service.

        Parameters
        ----------
        srv_type, srv_name
            The class of the service, and its name.
        **_
            As in rclpy, but without effect.

        Returns
        -------
        Client
            The client.
        """
        name = self.resolve_service_name(srv_name)
        qos = qos_profile_system_default
        client = Client(self, name, srv_type, qos, complete_request)
        self.clients.append(client)
        return client

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[[], Any],
        callback_group: Any = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Create a timer.

        Parameters
        ----------
        timer_period_sec
            The time [s] from one call to the next.
        callback
            Called without arguments.
        callback_group, clock
            As in rclpy, but without effect: the world has one clock, real or simulated.
        autostart
            Whether it runs from now on.

        Returns
        -------
        Timer
            The timer.
        """
        del callback_group, clock
        timer = Timer(self, int(float(timer_period_sec) * SECOND), callback)
        self.timers.append(timer)
        if autostart:
            timer.reset()
        return timer

    def create_guard_condition(self, callback: Any, callback_group: Any = None) -> GuardCondition:
        """Create a guard condition.

        Parameters
        ----------
        callback
            Called after each trigger, once for several that come before.
        callback_group
            As in rclpy, but without effect.

        Returns
        -------
        GuardCondition
            The guard condition.
        """
        del callback_group
        newest = QoSProfile(depth=1)

        def on_trigger(_: None) -> None:
            callback()

        guard = GuardCondition(self, '', GuardCondition, newest, on_trigger)
        self.guards.append(guard)
        return guard

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

    def destroy_publisher(self, publisher: Publisher) -> bool:
        """Destroy a publisher; return False if the node has it no more."""
        return self._destroy('publishers', publisher)

    def destroy_subscription(self, subscription: Subscription) -> bool:
        """Destroy a subscription; return False if the node has it no more."""
        return self._destroy('subscriptions', subscription)

    def destroy_service(self, service: Entity) -> bool:
        """Destroy a service; return False if the node has it no more."""
        return self._destroy('services', service)

    def destroy_client(self, client: Client) -> bool:
        """Destroy a client; return False if the node has it no more."""
        return self._destroy('clients', client)

    def destroy_timer(self, timer: Timer) -> bool:
        """Destroy a timer; return False if the node has it no more."""
        return self._destroy('timers', timer)

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        """Destroy a guard condition; return False if the node has it no more."""
        return self._destroy('guards', guard)

    def destroy_node(self) -> None:
        """Destroy all that the node has, and take it from the graph and its executor."""
        nodes = self.context.nodes
        if self in nodes:
            for kind in _KINDS:
                for entity in [*getattr(self, kind)]:
                    self._destroy(kind, entity)
            nodes.remove(self)
            if self.executor is not None:
                self.executor.remove_node(self)

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        """Return name and namespace of each node."""
        return [(each.get_name(), each.get_namespace()) for each in self.context.nodes]

    def get_node_names(self) -> list[str]:
        """Return the name of each node, without its namespace."""
        return [name for name, _ in self.get_node_names_and_namespaces()]

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        """Return the full name of each topic, and the names of its types."""
        return _names_and_types(self.context.nodes, 'publishers', 'subscriptions')

    def get_publisher_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> list[tuple[str, list[str]]]:
        """Return the topics of the publishers of a node.

        Parameters
        ----------
        node_name, node_namespace
            The node.

        Returns
        -------
        list of tuple
            The full name of each topic, and the names of its types.
        """
        return _names_and_types(self._nodes_called(node_name, node_namespace), 'publishers')

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> list[tuple[str, list[str]]]:
        """Return the topics of the subscriptions of a node.

        Parameters
        ----------
        node_name, node_namespace
            The node.

        Returns
        -------
        list of tuple
            The full name of each topic, and the names of its types.
        """
        return _names_and_types(self._nodes_called(node_name, node_namespace), 'subscriptions')

    def _nodes_called(self, name: str, namespace: str) -> list[Node]:
        return [
            node
            for node in self.context.nodes
            if (node.get_name(), node.get_namespace()) == (name, namespace)
        ]

    def count_publishers(self, topic_name: str) -> int:
        """Return the number of publishers of a topic."""
        return len(self.context.all('publishers', self._expanded(topic_name)))

    def count_subscribers(self, topic_name: str) -> int:
        """Return the number of subscriptions to a topic."""
        return len(self.context.all('subscriptions', self._expanded(topic_name)))

    def count_services(self, service_name: str) -> int:
        """Return the number of nodes that have a service."""
        return len(self.context.all('services', self._expanded(service_name)))

    def get_publishers_info_by_topic(self, topic_name: str) -> list[Any]:
        """Return the publishers with a name.

        Parameters
        ----------
        topic_name
            The topic, relative to the node or in full.

        Returns
        -------
        list of Entity
            The publishers, of all nodes.
        """
        return self.context.all('publishers', self.resolve_topic_name(topic_name))

    def get_subscriptions_info_by_topic(self, topic_name: str) -> list[Any]:
        """Return the subscriptions with a name.

        Parameters
        ----------
        topic_name
            The topic, relative to the node or in full.

        Returns
        -------
        list of Entity
            The subscriptions, of all nodes.
        """
        return self.context.all('subscriptions', self.resolve_topic_name(topic_name))


def _names_and_types(nodes: list[Node], *kinds: str) -> list[tuple[str, list[str]]]:
    """Return the topics of the nodes' publishers, subscriptions or both, with their types."""
    topics: dict[str, set[str]] = {}
    for node in nodes:
        for kind in kinds:
            for entity in getattr(node, kind):
                topics.setdefault(entity.topic_name, set()).add(entity.topic_type)
    return [(name, sorted(types)) for name, types in sorted(topics.items())]
