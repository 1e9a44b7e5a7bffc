"""The entities that an executor executes, and how what has arrived for each kind is taken."""

# ruff: noqa: SLF001 - `rclpy_private` checks rclpy's private names.

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from traceback import walk_tb
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.executors import await_or_execute
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from barc_sim.ros.executor.rclpy_private import message_taker

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.executors import MultiThreadedExecutor
    from rclpy.node import Node

    #: What is to be called, with what.
    Call = tuple[Callable[..., Any], tuple[Any, ...]]
    Take = Callable[['Entry', MultiThreadedExecutor], 'Call | None']

#: The names of a node's lists of entities, in the order in which rclpy executes what is ready.
KINDS = ('waitables', 'timers', 'subscriptions', 'guards', 'clients', 'services')
_OURS = ('rclpy.', 'barc_sim.ros.executor.')  # modules
_MESSAGE_ONLY = Subscription.CallbackType.MessageOnly


@dataclass(eq=False, slots=True)
class Entry:
    """An entity of a node, and how much has arrived for it."""

    entity: Any  #: a timer, subscription, …: rclpy's have no type in common
    kind: str  #: of KINDS
    node: Node
    handle: Any
    take: Take  #: returns the call that is due, or None for nothing
    begin: Callable[[], bool]  #: claims its callback group, where that allows another callback
    end: Callable[[], None]  #: gives the group back
    pending: int = 0  #: takes that may find something
    queued: bool = False
    lasting: bool = False  #: whether its last callback lasted
    descriptor: int = -1  #: the eventfd in which arrivals are counted
    in_memory: Any = None  #: the counter of arrivals there, while none waits for them
    counted: int = 0  #: arrivals in memory that were seen
    idle_uses: int = 0  #: while it shares its descriptor: so often it may be used until it does not
    on_taken: Callable[[Entry], None] | None = None
    kept: Any = None  #: a timer's watch on jumps; what stands in the wait set
    take_message: Any = None  #: a subscription's faster way

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


def entry_of(entity: Any, kind: str, node: Node) -> Entry:  # noqa: ANN401 (see `Entry`)
    """Return the entry of a node's entity."""
    group = entity.callback_group
    begin = lambda: group.can_execute(entity) and group.beginning_execution(entity)  # noqa: E731
    end = partial(group.ending_execution, entity)
    if type(group) is MutuallyExclusiveCallbackGroup:  # its own methods take longer
        begin, end = partial(_claim, group, entity), partial(setattr, group, '_active_entity', None)
    take = next(take for each, take in _TAKES.items() if isinstance(entity, each))
    handle = '_EventHandler__event' if isinstance(entity, EventHandler) else 'handle'
    return Entry(entity, kind, node, getattr(entity, handle, entity), take, begin, end)


def _claim(group: MutuallyExclusiveCallbackGroup, entity: object) -> bool:
    with group._lock:
        if free := group._active_entity is None:
            group._active_entity = entity
        return free


def _take_subscription(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take a message, the fast way if its callback wants nothing else."""
    subscription = entry.entity
    message_only = subscription._callback_type is _MESSAGE_ONLY
    if message_only and not subscription.raw:
        take = entry.take_message = entry.take_message or message_taker(subscription)
        taken = take()
    else:
        with entry.handle:
            taken = entry.handle.take_message(subscription.msg_type, subscription.raw)
        taken = taken and taken[:1] if message_only else taken
    return taken and (subscription.callback, taken)


def _take_service(entry: Entry, executor: MultiThreadedExecutor) -> Call | None:
    """Take a request or a response; unlike rclpy's way, this returns whether there was one."""
    entity, handle = entry.entity, entry.handle
    with handle:
        if entry.kind == 'services':
            message, header = handle.service_take_request(entity.srv_type.Request)
        else:
            header, message = handle.take_response(entity.srv_type.Response)

    async def answer() -> None:
        response = await await_or_execute(entity.callback, message, entity.srv_type.Response())
        entity.send_response(response, header)

    def complete() -> None:
        with suppress(KeyError):  # the request was cancelled
            future = entity.get_pending_request(header.request_id.sequence_number)
            future._set_executor(executor)
            future.set_result(message)

    return header and (answer if entry.kind == 'services' else complete, ())


def _take_timer(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take a timer, unless it was cancelled or reset meanwhile; faster than rclpy's way."""
    with suppress(_rclpy.RCLError), entry.handle:  # cancelled meanwhile
        if entry.handle.is_timer_ready():
            entry.handle.call_timer()
            return entry.entity.callback, ()
    return None


def _take_event(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take the status of a QoS event, unless another one was meant that shares the descriptor."""
    with entry.handle:
        taken = entry.handle.take_event()
    changes = [getattr(taken, name) for name in dir(taken) if name.endswith('_count_change')]
    return (entry.entity.execute, (taken,)) if any(changes) else None


_TAKES: dict[type[Any], Take] = {
    Subscription: _take_subscription,
    Timer: _take_timer,
    GuardCondition: lambda entry, _: (entry.entity.callback, ()),
    Service: _take_service,
    Client: _take_service,
    EventHandler: _take_event,
    object: lambda entry, executor: (executor._take_waitable(entry.entity), ()),  # waitables
}
