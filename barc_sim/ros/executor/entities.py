"""The entities that an executor executes, and how the arrivals for each kind are taken."""

# ruff: noqa: SLF001 - `rclpy_private` checks rclpy's private names.

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
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

    #: A function to call, and its arguments.
    Call = tuple[Callable[..., Any], tuple[Any, ...]]
    Take = Callable[['Entry', MultiThreadedExecutor], 'Call | None']

#: The names of a node's lists of entities, in the order in which rclpy executes ready entities.
KINDS = ('waitables', 'timers', 'subscriptions', 'guards', 'clients', 'services')
_OURS = ('rclpy.', 'barc_sim.ros.executor.')  # modules
#: Whether a timer's callback can take a `TimerInfo`, which rclpy's own way to take it makes.
_TIMERS_GIVE_INFO = hasattr(_rclpy.Timer, 'call_timer_with_info')
_MESSAGE_ONLY = Subscription.CallbackType.MessageOnly


@dataclass(eq=False, slots=True)
class Entry:
    """An entity of a node, and the number of arrivals for it that wait to be taken."""

    entity: Any  #: a timer, subscription, …: rclpy's have no type in common
    kind: str  #: of KINDS
    node: Node
    handle: Any
    take: Take  #: returns the call that is due, or None for nothing
    begin: Callable[[], bool]  #: claims its callback group; False: the group is busy
    end: Callable[[], None]  #: releases the group
    pending: int = 0  #: arrivals that wait to be taken; there may be fewer messages
    reported: dict[str, int] = field(default_factory=dict)  #: the counts of the last QoS event
    is_slow: bool = False  #: whether its last callback took longer than `LASTING`
    descriptor: int = -1  #: the eventfd in which arrivals are counted
    in_memory: Any = None  #: the counter in memory that replaces it while no thread waits
    idle_uses: int = 0  #: uses until it gets a descriptor of its own; 0: it has one
    on_taken: Callable[[Entry], None] | None = None
    kept: Any = None  #: a timer's jump handle; the stand-in for an entity in the wait set
    take_message: Any = None  #: a subscription's faster take

    def warns_of(self, error: BaseException, *, while_taking: bool = False) -> bool:
        """Warn of an error of rclpy's own code; return False for other errors.

        Such an error is raised by a take or by rclpy's own callback, without other code in between.
        """
        module = str(getattr(getattr(self.entity, 'callback', None), '__module__', None))
        scopes = [frame.f_globals for frame, _ in walk_tb(error.__traceback__)]
        is_ours = all(str(scope.get('__name__')).startswith(_OURS) for scope in scopes)
        is_ours = is_ours and (while_taking or module.startswith(_OURS))
        if not (is_ours and isinstance(error, Exception)):
            return False

        name = getattr(self.entity, 'topic', type(self.entity).__name__)
        self.node.get_logger().warning(
            f'dropped data for {name!r} that rclpy cannot handle: {type(error).__name__}: {error}',
            throttle_duration_sec=1.0,
        )
        return True


def entry_of(entity: Any, kind: str, node: Node) -> Entry:  # noqa: ANN401 (see `Entry`)
    """Return the entry of a node's entity."""
    group = entity.callback_group
    begin = lambda: group.can_execute(entity) and group.beginning_execution(entity)  # noqa: E731
    end = partial(group.ending_execution, entity)
    if type(group) is MutuallyExclusiveCallbackGroup:  # faster than its own methods
        begin = partial(_claim, group, entity)
        end = partial(setattr, group, '_active_entity', None)
    take = next(take for kind_of, take in _TAKES.items() if isinstance(entity, kind_of))
    handle = '_EventHandler__event' if isinstance(entity, EventHandler) else 'handle'
    return Entry(entity, kind, node, getattr(entity, handle, entity), take, begin, end)


def _claim(group: MutuallyExclusiveCallbackGroup, entity: object) -> bool:
    with group._lock:
        is_free = group._active_entity is None
        if is_free:
            group._active_entity = entity
        return is_free


def _take_subscription(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take a message, the fast way if the callback takes nothing else."""
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
    """Take a request or a response; rclpy's own way does not return whether there was one."""
    entity = entry.entity
    handle = entry.handle
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


def _take_timer(entry: Entry, executor: MultiThreadedExecutor) -> Call | None:
    """Take a timer, unless it was cancelled or reset meanwhile; faster than rclpy's way."""
    with suppress(_rclpy.RCLError), entry.handle:  # cancelled meanwhile
        if entry.handle.is_timer_ready():
            if _TIMERS_GIVE_INFO:
                call = executor._take_timer(entry.entity)
                return call and (call, ())
            entry.handle.call_timer()
            return entry.entity.callback, ()
    return None


def _take_event(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take a QoS event; None: it was taken, or the arrival was for another entity."""
    with entry.handle:
        status = entry.handle.take_event()
    counts = _counts(status)
    changes = _changes(status)

    # The middleware sets the changes to 0 when a listener is set, but never the counts.
    for name in counts.keys() & entry.reported.keys():
        changes[f'{name}_change'] = counts[name] - entry.reported[name]
    entry.reported = counts
    if not any(changes.values()):
        return None
    if changes != _changes(status):
        status = _with_changes(status, changes)
    return entry.entity.execute, (status,)


def note_reported(entry: Entry) -> bool:
    """Note which QoS events other executors have taken; return whether one is left.

    It must be called before the entity has a listener.
    """
    with entry.handle:
        status = entry.handle.take_event()
    changes = _changes(status)
    entry.reported = {
        name: count - changes.get(f'{name}_change', 0) for name, count in _counts(status).items()
    }
    return any(changes.values())


def _counts(status: object) -> dict[str, int]:
    """Return the total and current counts of a QoS event's status."""
    return {name: getattr(status, name) for name in dir(status) if name.endswith('_count')}


def _changes(status: object) -> dict[str, int]:
    """Return by how much each count has changed since the status was last taken."""
    return {name: getattr(status, name) for name in dir(status) if name.endswith('_count_change')}


def _with_changes(status: object, changes: dict[str, int]) -> object:
    """Return a status with other changes: rclpy's own cannot be written."""
    kind = type(status)
    names = [name for name in dir(status) if not name.startswith('_')]
    values = {name: getattr(status, name) for name in names} | changes
    return type(kind.__name__, (kind,), values)()


_TAKES: dict[type[Any], Take] = {
    Subscription: _take_subscription,
    Timer: _take_timer,
    GuardCondition: lambda entry, _: (entry.entity.callback, ()),
    Service: _take_service,
    Client: _take_service,
    EventHandler: _take_event,
    object: lambda entry, executor: (executor._take_waitable(entry.entity), ()),  # waitables
}
