"""The entities that an executor executes, and how what has arrived for each kind is taken."""

# ruff: noqa: SLF001 - `rclpy_private` checks rclpy's private names.

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from traceback import walk_tb
from typing import TYPE_CHECKING, Any, TypeAlias

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.executors import await_or_execute
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from barc_sim.ros.executor.rclpy_private import handle_of, message_taker

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
_OURS = ('rclpy.', 'barc_sim.ros.executor.')  # modules
_MESSAGE_ONLY = Subscription.CallbackType.MessageOnly


@dataclass(eq=False, slots=True)
class Entry:
    """An entity of a node, and how much has arrived for it."""

    entity: Entity
    kind: str  #: of KINDS
    node: Node
    handle: Any
    take: Take  #: returns the call that is due, or None for nothing
    begin: Callable[[], bool]  #: claims its callback group, where that allows another callback
    end: Callable[[], None]  #: gives the group back
    pending: int = 0  #: takes that may find something
    ahead: int = 0  #: those that were tried before their arrival was counted
    queued: bool = False
    found: float = 0.0  #: [s] when it was queued
    executed: float = 0.0  #: [s] when it was taken last
    lasting: bool = False  #: whether its last callback lasted
    descriptor: int = -1  #: the eventfd in which arrivals are counted
    idle_uses: int = 0  #: while it shares its descriptor: so often it may be used until it does not
    on_taken: Callable[[Entry], None] | None = None
    kept: Any = None  #: a timer's watch on jumps; what stands in the wait set; an event's counts
    take_message: Callable[[], Any] | None = None
    end_use: Callable[[], None] | None = None  #: of the handle by `take_message`

    def warns_of(self, error: BaseException, *, taking: bool = False) -> bool:
        """Warn where rclpy itself cannot handle what has arrived; return False for other errors.

        That is what a take raises, or rclpy's own callback; and no other code has called it.
        """
        module = str(getattr(getattr(self.entity, 'callback', None), '__module__', None))
        frames = [frame.f_globals for frame, _ in walk_tb(error.__traceback__)]
        ours = all(str(each.get('__name__')).startswith(_OURS) for each in frames)
        if not (ours and (taking or module.startswith(_OURS)) and isinstance(error, Exception)):
            return False
        name = getattr(self.entity, 'topic', type(self.entity).__name__)
        self.node.get_logger().warning(
            f'what has arrived for {name!r} was dropped: {type(error).__name__}: {error}',
            throttle_duration_sec=1.0,
        )
        return True


def entry_of(entity: Entity, kind: str, node: Node) -> Entry:
    """Return the entry of a node's entity."""
    group = entity.callback_group
    claim = partial(group.beginning_execution, entity)
    known = type(group) in (MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup)
    begin = claim if known else lambda: group.can_execute(entity) and claim()
    end = partial(group.ending_execution, entity)
    take = next((take for each, take in _TAKES.items() if isinstance(entity, each)), _take_waitable)
    return Entry(entity, kind, node, handle_of(entity), take, begin, end)


def _take_subscription(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take a message, the fast way if its callback wants nothing else."""
    subscription = entry.entity
    if subscription.raw or subscription._callback_type is not _MESSAGE_ONLY:
        taken = entry.handle.take_message(subscription.msg_type, subscription.raw)
        if taken and subscription._callback_type is _MESSAGE_ONLY:
            taken = taken[:1]
    else:
        if not entry.take_message:
            entry.take_message, entry.end_use = message_taker(subscription)
        taken = None if (message := entry.take_message()) is None else (message,)
    if taken is None:
        # Of a full queue, older messages are gone: so many at most can wait behind this one.
        most = 0 if entry.idle_uses else subscription.qos_profile.depth or entry.pending
        entry.pending = min(entry.pending, most)
        return None
    return subscription.callback, taken


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


def _take_client(entry: Entry, executor: MultiThreadedExecutor) -> Call | None:
    """Take a response; unlike rclpy's way, this returns whether there was one."""
    client = entry.entity
    with entry.handle:
        header, response = entry.handle.take_response(client.srv_type.Response)
    if header is None:
        entry.pending = 0
        return None

    def execute() -> None:
        with suppress(KeyError):  # the request was cancelled
            future = client.get_pending_request(header.request_id.sequence_number)
            future._set_executor(executor)
            future.set_result(response)

    return execute, ()


def _take_timer(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take a timer, unless it was cancelled or reset meanwhile; faster than rclpy's way."""
    with suppress(_rclpy.RCLError), entry.handle:  # cancelled meanwhile
        if entry.handle.is_timer_ready():
            entry.handle.call_timer()
            return entry.entity.callback, ()
    return None


def _take_event(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take the status of a QoS event, unless another one was meant that shares the descriptor."""
    entry.pending = 0  # one status covers all
    with entry.handle:
        taken = entry.handle.take_event()
    counts = {name: getattr(taken, name) for name in dir(taken) if name.endswith('_count')}
    if counts == (entry.kept or dict.fromkeys(counts, 0)):
        return None
    entry.kept = counts
    return entry.entity.execute, (taken,)


def _take_waitable(entry: Entry, executor: MultiThreadedExecutor) -> Call | None:
    """Take a waitable's data."""
    return executor._take_waitable(entry.entity), ()


_TAKES: dict[type[Any], Take] = {
    Subscription: _take_subscription,
    Timer: _take_timer,
    GuardCondition: lambda entry, _: (entry.entity.callback, ()),
    Service: _take_service,
    Client: _take_client,
    EventHandler: _take_event,
}
