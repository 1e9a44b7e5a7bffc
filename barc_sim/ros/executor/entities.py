"""The entities that an executor executes, and how what has arrived for each kind is taken."""

# ruff: noqa: SLF001 - `rclpy_private` checks rclpy's private names.

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.executors import await_or_execute
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from barc_sim.ros.executor.rclpy_private import handle_of, message_taker, raised_by_rclpy

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.executors import MultiThreadedExecutor
    from rclpy.node import Node

    #: What is to be called, with what.
    Call = tuple[Callable[..., Any], tuple[Any, ...]]
    Take = Callable[['Entry', MultiThreadedExecutor], 'Call | None']

#: A timer, subscription, …: rclpy's have no type in common.
Entity: TypeAlias = Any

#: The names of a node's lists of entities, in the order in which rclpy executes what is ready.
KINDS = ('waitables', 'timers', 'subscriptions', 'guards', 'clients', 'services')
_WITH_MESSAGES = ('subscriptions', 'clients', 'services')
_MESSAGE_ONLY = Subscription.CallbackType.MessageOnly


@dataclass(eq=False, slots=True)
class Entry:
    """An entity of a node, and how much has arrived for it."""

    entity: Entity
    kind: str  #: of KINDS
    node: Node
    handle: Any  #: in use for as long as the entry is kept
    take: Take  #: returns the call that is due, or None for nothing
    begin: Callable[[], bool]  #: claims its callback group, where that allows another callback
    end: Callable[[], None]  #: gives the group back
    pending: int = 0  #: takes that may find something
    ahead: int = 0  #: those that were tried before their arrival was counted
    tries: int = 0  #: so often it is tried before epoll is asked
    queued: bool = False
    found: float = 0.0  #: [s] when it was queued
    executed: float = 0.0  #: [s] when it was taken last
    lasting: bool = False  #: whether its last callback lasted
    descriptor: int = -1  #: the eventfd in which arrivals are counted
    idle_uses: int = 0  #: while it shares its descriptor: so often it may be used until it does not
    destroyed: bool = False  #: by its user: nothing is taken any longer
    on_taken: Callable[[Entry], None] | None = None
    #: By its take: a QoS event's last status, a subscription's message taker.
    kept: Any = None

    def warns_of(self, error: BaseException, *, taking: bool = False) -> bool:
        """Warn where rclpy itself cannot handle what has arrived; return False for other errors.

        That is a message that cannot be taken, and what its own callback and all below raises.
        """
        module = getattr(getattr(self.entity, 'callback', None), '__module__', None) or ''
        of_rclpy = module.startswith('rclpy.') and raised_by_rclpy(error)
        if not (
            isinstance(error, Exception) and (self.kind in _WITH_MESSAGES if taking else of_rclpy)
        ):
            return False
        name = getattr(self.entity, 'topic', type(self.entity).__name__)
        self.node.get_logger().warning(
            f'what has arrived for {name!r} was dropped: {type(error).__name__}: {error}',
            throttle_duration_sec=1.0,
        )
        return True


def entry_of(entity: Entity, kind: str, node: Node) -> Entry:
    """Return the entry of a node's entity."""
    take = next((take for each, take in _TAKES.items() if isinstance(entity, each)), take_waitable)
    return Entry(entity, kind, node, handle_of(entity), take, *_claiming(entity))


def _claiming(entity: Entity) -> tuple[Callable[[], bool], Callable[[], None]]:
    """Return what claims the entity's group, where that allows it, and what gives it back.

    For rclpy's own groups the same as theirs, without their checks, which take 2 us.
    """
    group = entity.callback_group
    if type(group) is ReentrantCallbackGroup:
        return lambda: True, lambda: None
    if type(group) is not MutuallyExclusiveCallbackGroup:
        begin = partial(group.beginning_execution, entity)
        return (
            lambda: group.can_execute(entity) and begin(),
            partial(group.ending_execution, entity),
        )
    lock = group._lock

    def claim() -> bool:
        with lock:
            if group._active_entity is None:
                group._active_entity = entity
                return True
        return False

    def give_back() -> None:
        group._active_entity = None

    return claim, give_back


def _take_subscription(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take a message; faster than rclpy's way, as the entry keeps the handle in use."""
    subscription = entry.entity
    if entry.destroyed:
        raise InvalidHandle
    message_only = subscription._callback_type is _MESSAGE_ONLY
    if message_only and (entry.kept or not subscription.raw):
        take_message = entry.kept or message_taker(subscription)
        entry.kept = take_message
        if (message := take_message()) is not None:
            return subscription.callback, (message,)
    elif taken := entry.handle.take_message(subscription.msg_type, subscription.raw):
        return subscription.callback, taken[:1] if message_only else taken
    # Of a full queue, older messages are gone: so many at most can wait behind this one.
    most = 0 if entry.idle_uses else subscription.qos_profile.depth or entry.pending
    entry.pending = min(entry.pending, most)
    return None


def _take_service(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take a request; unlike rclpy's way, this returns whether there was one."""
    service = entry.entity
    with entry.handle:
        request, header = entry.handle.service_take_request(service.srv_type.Request)
    if header is None:
        entry.pending = 0
        return None

    async def execute() -> None:
        response = await await_or_execute(service.callback, request, service.srv_type.Response())
        service.send_response(response, header)

    return execute, ()


def _take_timer(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take a timer, unless it was cancelled or reset meanwhile; faster than rclpy's way."""
    timer, handle = entry.entity, entry.handle
    try:
        with handle:
            if not handle.is_timer_ready():
                return None
            handle.call_timer()
    except _rclpy.RCLError:
        if not timer.is_canceled():
            raise
        return None
    return timer.callback, ()


def _take_event(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take the status of a QoS event, unless it is as it was."""
    entry.pending = 0  # one status covers all
    with entry.handle:
        taken = entry.handle.take_event()
    names = (name for name in dir(taken) if not name.startswith('_'))
    status = {name: getattr(taken, name) for name in names if not name.endswith('_change')}
    if entry.kept is None and not any(status[name] for name in status if name.endswith('_count')):
        return None  # another one was meant that shares the descriptor
    if status == entry.kept:
        return None
    entry.kept = status
    return entry.entity.execute, (taken,)


def _rclpys(kind: str) -> Take:
    """Return rclpy's own way to take an entity."""

    def take(entry: Entry, executor: MultiThreadedExecutor) -> Call | None:
        execute = getattr(executor, f'_take_{kind}')(entry.entity)
        return (execute, ()) if execute else None

    return take


take_waitable = _rclpys('waitable')
_TAKES: dict[type[Any], Take] = {
    Subscription: _take_subscription,
    Timer: _take_timer,
    GuardCondition: _rclpys('guard_condition'),
    Service: _take_service,
    Client: _rclpys('client'),
    EventHandler: _take_event,
}
