"""The private parts of rclpy, rcl and Linux that the executor uses, and a check that they exist.

`unsupported` is called before any other module of the executor is imported. So the import of this
module may not rely on what it checks.
"""

# ruff: noqa: SLF001 - rclpy's private names are the point.

from __future__ import annotations

import ctypes
import os
import re
import select
from contextlib import suppress
from ctypes import PYFUNCTYPE, c_char_p, c_int32, c_void_p, py_object
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any
from weakref import finalize

from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context
    from rclpy.guard_condition import GuardCondition

#: By type of entity, the function of rcl that sets its listener.
LISTENERS: dict[type[Any], str] = {
    Subscription: 'subscription_set_on_new_message',
    Client: 'client_set_on_new_response',
    Service: 'service_set_on_new_request',
    Timer: 'timer_set_on_reset',
    EventHandler: 'event_set',
}

#: How many entities of each kind a wait set holds, in the order of its arguments.
_COUNTS = (
    'num_subscriptions',
    'num_guard_conditions',
    'num_timers',
    'num_clients',
    'num_services',
    'num_events',
)

# Each makes classes at a call: once is enough.
_library = cache(ctypes.PyDLL)
_returning = cache(PYFUNCTYPE)
_pointer_in = PYFUNCTYPE(c_void_p, py_object, c_char_p)(('PyCapsule_GetPointer', ctypes.pythonapi))

#: The private names that are needed, by module and class: each an attribute, or used in a method.
PRIVATE_NAMES = {
    'rclpy.executors': 'await_or_execute ShutdownException ExternalShutdownException',
    'rclpy.executors:Executor': '_guard _is_shutdown _sigint_gc _executor_event '
    '_wait_for_ready_callbacks _tasks _tasks_lock _cb_iter',
    'rclpy.executors:MultiThreadedExecutor': '_take_timer _take_waitable',
    'rclpy.callback_groups:MutuallyExclusiveCallbackGroup': '_lock _active_entity',
    'rclpy.task:Future': 'remove_done_callback _set_executor __await__',
    'rclpy.task:Task': '_handler',
    'rclpy.client:Client': 'get_pending_request',
    'rclpy.guard_condition:GuardCondition': '_GuardCondition__gc _executor_triggered',
    'rclpy.subscription:Subscription': '_callback_type',
    'rclpy.subscription:Subscription.CallbackType': 'MessageOnly',
    'rclpy.event_handler:EventHandler': '_EventHandler__event',
    'rclpy._rclpy_pybind11': 'RCLError',
    'rclpy._rclpy_pybind11:Subscription': 'take_message pointer',
    'rclpy._rclpy_pybind11:Timer': 'is_timer_ready call_timer time_until_next_call pointer',
    'rclpy._rclpy_pybind11:Service': 'service_take_request pointer',
    'rclpy._rclpy_pybind11:Client': 'take_response pointer',
    'rclpy._rclpy_pybind11:EventHandle': 'take_event pointer',
    'rclpy._rclpy_pybind11:GuardCondition': 'trigger_guard_condition',
    'rclpy._rclpy_pybind11:WaitSet': 'clear_entities wait get_ready_entities add_guard_condition',
    'builtin_interfaces.msg._time:Metaclass_Time': '_CREATE_ROS_MESSAGE '
    '_DESTROY_ROS_MESSAGE _CONVERT_TO_PY',
    'os': 'eventfd EFD_NONBLOCK EFD_CLOEXEC',
    'select': 'epoll',
}


#: The first version of rclpy that may mean something else by these names: Jazzy's are 7.1.x.
END_OF_VERSIONS = (7, 2)


def unsupported() -> str | None:
    """Return why this rclpy or machine cannot have a QuickExecutor; None: it can."""
    try:
        installed = version('rclpy')
    except PackageNotFoundError:  # built by hand: its names decide
        installed = ''
    numbers = tuple(int(number) for number in re.findall(r'\d+', installed)[:3])
    if numbers >= END_OF_VERSIONS:
        return f'rclpy {installed} is newer than this executor'
    lacking = missing()
    return f'this rclpy or machine has no {", ".join(lacking)}' if lacking else None


def missing() -> list[str]:
    """Return the names of what this rclpy, rcl or machine lacks."""
    lacking = [
        f'{path.rpartition(":")[2]}.{name}'
        for path, names in PRIVATE_NAMES.items()
        for name in names.split()
        if _lacks(path, name)
    ]
    if not lacking:
        try:
            for name in LISTENERS.values():
                _setter(name)
            _counting_functions()
            getattr(_library('librcl.so'), 'rcl_take')  # noqa: B009 (it is missing where it raises)
            for opened in (os.eventfd(0), ctypes.CDLL(None).timerfd_create(1, 0)):
                os.close(opened)
            select.epoll().close()
        except (AttributeError, OSError) as error:
            lacking = [f'eventfd, timerfd, epoll or listeners ({error})']
    return lacking


def _lacks(path: str, name: str) -> bool:
    """Return whether a module or class neither has a name nor uses it in a method."""
    try:
        owner = resolve_name(path)
    except (ImportError, AttributeError):
        return True
    methods = [getattr(member, 'fset', member) for member in vars(owner).values()]
    codes = [method.__code__ for method in methods if hasattr(method, '__code__')]
    return not (hasattr(owner, name) or any(name in code.co_names for code in codes))


def _counting_functions() -> tuple[Any, Any]:
    """Return two listeners for DDS, which count arrivals without any code of ours.

    Both have the signature `(user_data, number_of_events)`. libc's `eventfd_write` adds to an
    eventfd; libstdc++'s `__gnu_cxx::__atomic_add`, which DDS itself links, adds to memory without
    a system call.
    """
    libstdcxx = _library('libstdc++.so.6')
    return _library(None).eventfd_write, libstdcxx._ZN9__gnu_cxx12__atomic_addEPVii


def set_listener(entry: Any, counter: int | c_int32 | None) -> bool:  # noqa: ANN401 (an Entry)
    """Count arrivals for an entity in an eventfd or in memory; None stops it.

    Returns False for a kind of entity without listeners; a destroyed entity needs none. After a
    listener was removed, no thread is in it any more. It is set twice: an arrival during the first
    call may be missed, and the second call counts it.
    """
    names = (name for kind, name in LISTENERS.items() if isinstance(entry.entity, kind))
    name = next(names, '')
    if not name:
        return False

    listener: tuple[Any, Any] = None, None
    to_descriptor, to_memory = _counting_functions()
    if isinstance(counter, int):
        listener = to_descriptor, counter
    elif counter is not None:
        listener = to_memory, ctypes.byref(counter)

    with suppress(InvalidHandle), entry.handle:  # destroyed
        if any(_setter(name)(entry.handle.pointer, *listener) for _ in range(2)):
            _library('librcutils.so').rcutils_reset_error()
            return False
    return True


@cache
def _setter(name: str) -> Any:  # noqa: ANN401
    # PyDLL keeps the interpreter's lock, which guards rcl's timers. No listener needs it.
    function = getattr(_library('librcl.so'), f'rcl_{name}_callback')
    function.argtypes = (c_void_p, c_void_p, c_void_p)
    return function


def message_taker(subscription: Subscription) -> Callable[[], tuple[Any] | None]:
    """Return a function that takes the next message; InvalidHandle: the subscription is destroyed.

    rcl writes all messages into the same C struct; rclpy makes a new struct for each take, and a
    dictionary of the message's times.
    """
    kind = subscription.msg_type
    create = _returning(c_void_p)(_pointer_in(kind._CREATE_ROS_MESSAGE, None))
    destroy = _returning(None)(_pointer_in(kind._DESTROY_ROS_MESSAGE, None))
    convert = _returning(py_object)(_pointer_in(kind._CONVERT_TO_PY, None))
    struct = c_void_p(create())
    finalize(struct, destroy, c_void_p(struct.value)).atexit = False  # daemons use it until then

    take = _library('librcl.so').rcl_take
    handle = subscription.handle
    pointer = c_void_p(handle.pointer)

    def take_message() -> tuple[Any] | None:
        # No other thread runs after the check of the handle. `argtypes` would cost 0.3 us.
        result = take(pointer if handle.pointer else None, struct, None, None)
        if result not in (0, 401):  # 401: no message
            _library('librcutils.so').rcutils_reset_error()
            raise RuntimeError(f'rcl_take returned {result}') if handle.pointer else InvalidHandle
        return None if result else (convert(struct),)

    return take_message


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


def notify_of_triggers(guard: GuardCondition, notify: Callable[[], None] | None) -> None:
    """Call `notify` at each trigger of a guard condition; None stops it.

    It replaces the handle, not the method `trigger`, to which others may have a reference.
    """
    own = getattr(guard.handle, 'instead_of', guard.handle)
    guard._GuardCondition__gc = StandIn(own, trigger_guard_condition=notify) if notify else own


def was_triggered(guard: GuardCondition, context: Context) -> bool:
    """Return whether a guard condition was triggered before `notify_of_triggers`, and clear it."""
    handle = guard.handle.instead_of
    if not context.ok():
        return False
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
