"""The private parts of rclpy that the executor uses, each with its reason.

No other file reads or writes a private attribute of rclpy's objects; ruff checks this (SLF001). The
methods of rclpy's handles, which are in a private module, are listed here, too. `support.py` checks
all names before a module that uses them is imported, so the import of this one relies on none.
"""

# ruff: noqa: SLF001 - rclpy's private names are the point.

from __future__ import annotations

import ctypes
from ctypes import PYFUNCTYPE, c_char_p, c_void_p, py_object
from importlib import import_module
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.event_handler import EventHandler
from rclpy.executors import MultiThreadedExecutor
from rclpy.task import Future

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
    from rclpy.context import Context
    from rclpy.guard_condition import GuardCondition
    from rclpy.task import Task
    from rclpy.timer import Timer

#: By module or class, the private names with the reason for each. A name is an attribute, or used
#: in a method.
PRIVATE_NAMES: dict[str, dict[str, str]] = {
    'rclpy.executors': {
        'await_or_execute': "calls a service's callback, which may be a coroutine function",
        'ShutdownException': 'ends a wait in a wait set at shutdown',
        'ExternalShutdownException': "ends a wait in a wait set at the context's end",
    },
    'rclpy.executors:Executor': {
        '_guard': 'nodes trigger it when an entity is created or destroyed',
        '_is_shutdown': "rclpy's methods that wait in a wait set read it",
        '_sigint_gc': 'would be destroyed twice: by shutdown, and at the end of the interpreter',
        '_executor_event': 'keeps an entity out of the wait set until it is taken',
        '_wait_for_ready_callbacks': 'waits for entities without listeners',
        '_tasks': "tasks that rclpy's own `wait_for_ready_callbacks` steps",
        '_tasks_lock': 'guards `_tasks`',
        '_cb_iter': 'the last wait in a wait set, which a spin makes out of date',
    },
    'rclpy.executors:MultiThreadedExecutor': {
        '_take_timer': 'makes the `TimerInfo` of newer versions',
        '_take_waitable': "takes an action's or another package's waitable",
    },
    'rclpy.callback_groups:MutuallyExclusiveCallbackGroup': {
        '_lock': 'to claim the group in one step, where its methods need two',
        '_active_entity': 'claims the group',
    },
    'rclpy.task:Future': {
        'remove_done_callback': 'a spin leaves no callback in its future',
        '_set_executor': "the executor of a response's future schedules its done callbacks",
        '__await__': 'to find the future that a coroutine awaits',
    },
    'rclpy.task:Task': {'_handler': "the task's coroutine, to find what it awaits"},
    'rclpy.client:Client': {'get_pending_request': 'the future of a response'},
    'rclpy.guard_condition:GuardCondition': {
        '_GuardCondition__gc': 'replaced, so that a trigger calls a function',
        '_executor_triggered': 'whether another executor has noted a trigger',
    },
    'rclpy.subscription:Subscription': {
        '_callback_type': "whether a callback takes a message's information, too",
    },
    'rclpy.subscription:Subscription.CallbackType': {'MessageOnly': 'it takes the message alone'},
    'rclpy.event_handler:EventHandler': {'_EventHandler__event': 'its handle'},
    'rclpy._rclpy_pybind11': {'RCLError': 'a timer was cancelled while it was taken'},
    'rclpy._rclpy_pybind11:Subscription': {
        'take_message': 'takes a message',
        'pointer': 'for its listener, and to take a message with rcl',
    },
    'rclpy._rclpy_pybind11:Timer': {
        'is_timer_ready': 'whether it was reset or cancelled meanwhile',
        'call_timer': 'takes a timer',
        'time_until_next_call': 'when it is due',
        'pointer': 'for its listener',
    },
    'rclpy._rclpy_pybind11:Service': {
        'service_take_request': 'takes a request',
        'pointer': 'for its listener',
    },
    'rclpy._rclpy_pybind11:Client': {
        'take_response': 'takes a response',
        'pointer': 'for its listener',
    },
    'rclpy._rclpy_pybind11:EventHandle': {
        'take_event': 'takes a QoS event',
        'pointer': 'for its listener',
    },
    'rclpy._rclpy_pybind11:GuardCondition': {
        'trigger_guard_condition': 'replaced, so that a trigger calls a function',
    },
    'rclpy._rclpy_pybind11:WaitSet': {
        'clear_entities': 'makes a wait set ready for use',
        'add_guard_condition': 'to look for an early trigger',
        'wait': 'looks, without a wait',
        'get_ready_entities': 'what it has found',
    },
    'builtin_interfaces.msg._time:Metaclass_Time': {
        '_CREATE_ROS_MESSAGE': 'makes the C struct of a message',
        '_DESTROY_ROS_MESSAGE': 'destroys it',
        '_CONVERT_TO_PY': 'makes a message of Python from it',
    },
    'os': {
        'eventfd': 'counts arrivals; only Linux has it',
        'EFD_NONBLOCK': 'to read a count of 0 without a wait',
        'EFD_CLOEXEC': 'child processes do not inherit it',
    },
    'select': {'epoll': 'waits for many descriptors; only Linux has it'},
}

#: Whether rclpy (7.1.9 and later) resumes a task itself, when the future that it awaits is done.
TASKS_RESUME_THEMSELVES = hasattr(MultiThreadedExecutor, '_call_task_in_next_spin')
#: Whether a timer's callback can take a `TimerInfo`, which rclpy's own way to take it makes.
TIMERS_GIVE_INFO = hasattr(
    getattr(import_module('rclpy._rclpy_pybind11'), 'Timer', None), 'call_timer_with_info'
)

#: How many entities of each kind a wait set holds, in the order of its arguments.
_COUNTS = (
    'num_subscriptions',
    'num_guard_conditions',
    'num_timers',
    'num_clients',
    'num_services',
    'num_events',
)
_pointer_in = PYFUNCTYPE(c_void_p, py_object, c_char_p)(('PyCapsule_GetPointer', ctypes.pythonapi))


# Groups


class ExclusiveClaim:
    """An entity's claim to rclpy's exclusive group, faster than the group's methods."""

    __slots__ = ('_entity', '_group', '_lock')

    def __init__(self, group: MutuallyExclusiveCallbackGroup, entity: object) -> None:
        self._group = group
        self._lock = group._lock
        self._entity = entity

    def begin(self) -> bool:
        """Claim the group; return False if it is busy."""
        with self._lock:
            if self._group._active_entity is not None:
                return False
            self._group._active_entity = self._entity
            return True

    def end(self) -> None:
        """Release the group."""
        self._group._active_entity = None


# Takes


class MessageFunctions(NamedTuple):
    """Addresses of the functions in C that make a message's struct, destroy and convert it."""

    create: int
    destroy: int
    to_python: int


def message_functions(message_type: Any) -> MessageFunctions:  # noqa: ANN401 (a generated class)
    """Return the functions of a type of message."""
    return MessageFunctions(
        create=_pointer_in(message_type._CREATE_ROS_MESSAGE, None),
        destroy=_pointer_in(message_type._DESTROY_ROS_MESSAGE, None),
        to_python=_pointer_in(message_type._CONVERT_TO_PY, None),
    )


#: Returns what a subscription's callback takes; faster than a function of Python.
callback_type_of = attrgetter('_callback_type')


def take_timer(executor: MultiThreadedExecutor, timer: Timer) -> Callable[[], Any] | None:
    """Take a timer as rclpy does; return the call that is due."""
    call: Callable[[], Any] | None = executor._take_timer(timer)
    return call


def take_waitable(executor: MultiThreadedExecutor, waitable: Any) -> Callable[[], Any]:  # noqa: ANN401
    """Take a waitable as rclpy does; return the call that is due."""
    call: Callable[[], Any] = executor._take_waitable(waitable)
    return call


def handle_of(entity: Any) -> Any:  # noqa: ANN401 (rclpy's entities have no type in common)
    """Return an entity's handle, which keeps it from being destroyed; a waitable is its own."""
    if isinstance(entity, EventHandler):
        return entity._EventHandler__event
    return getattr(entity, 'handle', entity)


# Futures and tasks


def set_executor(future: Future, executor: MultiThreadedExecutor) -> None:
    """Let an executor schedule a future's done callbacks."""
    future._set_executor(executor)


def awaited_future(task: Task) -> Future | None:
    """Return the future that a task awaits; None if it awaits nothing, or something else."""
    awaited = task._handler
    while awaited is not None:
        if getattr(awaited, 'gi_code', None) is Future.__await__.__code__:
            frame = awaited.gi_frame
            return frame.f_locals.get('self') if frame else None  # no frame: it was cancelled
        awaited = _awaited_by(awaited)
    return None


def _awaited_by(awaiting: object) -> object | None:
    """Return what a coroutine, generator or asynchronous generator awaits."""
    for name in ('cr_await', 'gi_yieldfrom', 'ag_await'):
        awaited: object | None = getattr(awaiting, name, None)
        if awaited is not None:
            return awaited
    return None


# Guard conditions and waitables


class StandIn:
    """Wraps an object, and replaces some of its attributes."""

    def __init__(self, instead_of: Any, **attributes: object) -> None:  # noqa: ANN401
        vars(self).update(attributes, instead_of=instead_of)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401
        """Return an attribute of the object."""
        return getattr(self.instead_of, name)

    def __enter__(self) -> None:
        """Enter the object's context."""
        self.instead_of.__enter__()

    def __exit__(self, *error: object) -> None:
        """Leave the object's context."""
        self.instead_of.__exit__(*error)


class WaitedEntity(StandIn):
    """Stands for an entity in a wait set, in a callback group of its own."""

    _executor_event: bool

    def wait_again(self) -> None:
        """Wait for the entity; rclpy has left it out since it was ready."""
        self._executor_event = False


def notify_of_triggers(guard: GuardCondition, notify: Callable[[], None] | None) -> None:
    """Call `notify` at each trigger of a guard condition; None stops it.

    It replaces the handle, not the method `trigger`, to which others may have a reference.
    """
    handle = getattr(guard.handle, 'instead_of', guard.handle)
    if notify:
        handle = StandIn(handle, trigger_guard_condition=notify)
    guard._GuardCondition__gc = handle


def take_early_trigger(guard: GuardCondition, context: Context) -> bool:
    """Return whether a guard condition was triggered before `notify_of_triggers`, and clear it.

    Another executor of rclpy may have noted the trigger already, but not executed it.
    """
    was_triggered = _was_triggered(guard, context) or guard._executor_triggered
    if was_triggered:
        guard._executor_triggered = False
    return was_triggered


def _was_triggered(guard: GuardCondition, context: Context) -> bool:
    if not context.ok():
        return False
    handle = guard.handle.instead_of
    with handle, context.handle:
        wait_set = _wait_set(context, num_guard_conditions=1)
        wait_set.add_guard_condition(handle)
        wait_set.wait(0)
        return bool(wait_set.get_ready_entities('guard_condition'))


def is_ready(waitable: Any, context: Context) -> bool:  # noqa: ANN401
    """Return whether a waitable is ready, which then can be taken; does not wait."""
    if not context.ok():
        return False
    with waitable, context.handle:
        counts = waitable.get_num_entities()
        wait_set = _wait_set(context, **{name: getattr(counts, name) for name in _COUNTS})
        waitable.add_to_wait_set(wait_set)
        wait_set.wait(0)
        return bool(waitable.is_ready(wait_set))


def _wait_set(context: Context, **counts: int) -> Any:  # noqa: ANN401
    """Return an empty wait set for so many entities of each kind."""
    sizes = [counts.get(name, 0) for name in _COUNTS]
    wait_set = import_module('rclpy._rclpy_pybind11').WaitSet(*sizes, context.handle)
    wait_set.clear_entities()
    return wait_set


# What an executor leaves in an entity for the next one


class Leftover(NamedTuple):
    """The arrivals that an executor has counted but not taken, and the counts of QoS events."""

    arrivals: int
    reported: dict[str, int]


def leave(entity: Any, leftover: Leftover) -> None:  # noqa: ANN401
    """Leave arrivals in an entity; listeners are not called for them again."""
    entity._leftover_of_executor = leftover


def leftover_in(entity: object) -> Leftover:
    """Return what the entity's last executor has left."""
    return getattr(entity, '_leftover_of_executor', Leftover(0, {}))
