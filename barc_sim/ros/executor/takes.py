"""How an arrival for an entity is taken, by kind of entity: each take returns the call that is due.

rclpy's own takes (`Executor._take_…`) are used where they are as good. Those here are faster, or
return None where there was nothing to take.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.executors import await_or_execute
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

import barc_sim.ros.executor.rclpy_private as private
from barc_sim.ros.executor.entities import Entry, claim_of
from barc_sim.ros.executor.rcl import message_taker

if TYPE_CHECKING:
    from rclpy.executors import MultiThreadedExecutor
    from rclpy.node import Node

    from barc_sim.ros.executor.entities import Call, Take

_MESSAGE_ONLY = Subscription.CallbackType.MessageOnly


def entry_of(entity: Any, kind: str, node: Node) -> Entry:  # noqa: ANN401 (see `Entry`)
    """Return the entry of a node's entity."""
    return Entry(
        entity=entity,
        kind=kind,
        node=node,
        handle=private.handle_of(entity),
        claim=claim_of(entity),
        take=_take_of(entity),
    )


def _take_of(entity: object) -> Take:
    """Return the function that takes an arrival for an entity."""
    for kind, take in _TAKES.items():
        if isinstance(entity, kind):
            return take
    return _take_waitable


def _take_subscription(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take a message, the fast way if the callback takes nothing else."""
    subscription = entry.entity
    takes_message_only = private.callback_type_of(subscription) is _MESSAGE_ONLY
    if takes_message_only and not subscription.raw:
        if entry.take_message is None:
            entry.take_message = message_taker(subscription)
        arguments = entry.take_message()
    else:
        with entry.handle:
            arguments = entry.handle.take_message(subscription.msg_type, subscription.raw)
        if arguments and takes_message_only:
            arguments = arguments[:1]
    return (subscription.callback, arguments) if arguments else None


def _take_timer(entry: Entry, executor: MultiThreadedExecutor) -> Call | None:
    """Take a timer, unless it was cancelled or reset meanwhile."""
    timer = entry.entity
    with suppress(_rclpy.RCLError), entry.handle:  # cancelled meanwhile
        if not entry.handle.is_timer_ready():
            return None
        if private.TIMERS_GIVE_INFO:
            call = private.take_timer(executor, timer)
            return (call, ()) if call else None
        entry.handle.call_timer()
        return timer.callback, ()
    return None


def _take_request(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take a request; the call sends the response."""
    service = entry.entity
    with entry.handle:
        request, header = entry.handle.service_take_request(service.srv_type.Request)
    if not header:
        return None

    async def respond() -> None:
        response = service.srv_type.Response()
        response = await await_or_execute(service.callback, request, response)
        service.send_response(response, header)

    return respond, ()


def _take_response(entry: Entry, executor: MultiThreadedExecutor) -> Call | None:
    """Take a response; the call completes the request's future."""
    client = entry.entity
    with entry.handle:
        header, response = entry.handle.take_response(client.srv_type.Response)
    if not header:
        return None

    def complete() -> None:
        with suppress(KeyError):  # the request was cancelled
            future = client.get_pending_request(header.request_id.sequence_number)
            private.set_executor(future, executor)
            future.set_result(response)

    return complete, ()


def _take_trigger(entry: Entry, _: MultiThreadedExecutor) -> Call:
    return entry.entity.callback, ()


def _take_waitable(entry: Entry, executor: MultiThreadedExecutor) -> Call:
    return private.take_waitable(executor, entry.entity), ()


def _take_event(entry: Entry, _: MultiThreadedExecutor) -> Call | None:
    """Take a QoS event; None: it was taken, or the arrival was for another entity.

    The middleware sets the changes to 0 when a listener is set, but never the counts. So the
    changes since the last report follow from the counts.
    """
    with entry.handle:
        status = entry.handle.take_event()
    counts = _counts(status)
    changes = _changes(status)

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
    GuardCondition: _take_trigger,
    Service: _take_request,
    Client: _take_response,
    EventHandler: _take_event,
}
