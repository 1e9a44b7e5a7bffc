"""The private parts of rclpy, rcl and Linux that the executor uses, and whether they are there.

`missing` is asked before any other module of the executor is imported, so that nothing here but
`missing` may rely on what it checks.
"""

# ruff: noqa: SLF001 - rclpy's private names are the point.

from __future__ import annotations

import ctypes
import os
import select
import traceback
from ctypes import c_void_p
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.guard_condition import GuardCondition
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context

#: By type of entity, the attribute with its handle and the function of rcl that sets its listener.
LISTENERS: dict[type[Any], tuple[str, str]] = {
    Subscription: ('handle', 'subscription_set_on_new_message'),
    Client: ('handle', 'client_set_on_new_response'),
    Service: ('handle', 'service_set_on_new_request'),
    Timer: ('handle', 'timer_set_on_reset'),
    EventHandler: ('_EventHandler__event', 'event_set'),
}

#: By module and class, its private names: those that it has, or that its methods use.
_NAMES = """
rclpy.executors: TimeoutObject await_or_execute ShutdownException ExternalShutdownException
rclpy.executors:Executor _guard _is_shutdown _tasks _tasks_lock _sigint_gc can_execute
rclpy.executors:Executor _wait_for_ready_callbacks _executor_event
rclpy.executors:MultiThreadedExecutor _executor _take_client _take_waitable
concurrent.futures:ThreadPoolExecutor _max_workers
rclpy.task:Future remove_done_callback
rclpy.guard_condition:GuardCondition _GuardCondition__gc
rclpy.subscription:Subscription _callback_type
rclpy.subscription:Subscription.CallbackType MessageOnly
rclpy.event_handler:EventHandler _EventHandler__event
rclpy._rclpy_pybind11: RCLError
rclpy._rclpy_pybind11:Subscription take_message pointer
rclpy._rclpy_pybind11:Timer is_timer_ready call_timer time_until_next_call pointer
rclpy._rclpy_pybind11:Service service_take_request pointer
rclpy._rclpy_pybind11:EventHandle take_event pointer
rclpy._rclpy_pybind11:GuardCondition trigger_guard_condition
rclpy._rclpy_pybind11:WaitSet clear_entities wait get_ready_entities is_ready add_guard_condition
os: eventfd EFD_NONBLOCK EFD_CLOEXEC
select: epoll
"""


def private_names() -> list[tuple[str, str]]:
    """Return each private name with its module and class, `'module:class'`."""
    lines = [line.split() for line in _NAMES.strip().splitlines()]
    return [(path, name) for path, *names in lines for name in names]


def missing() -> list[str]:
    """Return what this rclpy, rcl or machine lacks, or has with another behaviour."""
    lacking = [
        f'{path.partition(":")[2] or path.rstrip(":")}.{name}'
        for path, name in private_names()
        if _lacks(path, name)
    ]
    if not lacking:
        try:
            for _, name in LISTENERS.values():
                _setter(name)
            counting_listener()
            for opened in (os.eventfd(0), ctypes.CDLL(None).timerfd_create(1, 0)):
                os.close(opened)
            select.epoll().close()
        except (AttributeError, OSError) as error:
            lacking = [f'eventfd, timerfd, epoll or listeners ({error})']
    return lacking


def _lacks(path: str, name: str) -> bool:
    """Return whether a module or class lacks a name, and its methods do not use it either."""
    module, _, qualified = path.partition(':')
    try:
        owner: Any = import_module(module)
        for part in filter(None, qualified.split('.')):
            owner = getattr(owner, part)
    except (ImportError, AttributeError):
        return True
    methods = [getattr(each, 'fset', each) for each in vars(owner).values()]
    codes = [each.__code__ for each in methods if hasattr(each, '__code__')]
    return not (hasattr(owner, name) or any(name in code.co_names for code in codes))


def counting_listener() -> c_void_p:
    """Return libc's `eventfd_write(descriptor, number)`.

    It has the signature of a listener of DDS, `(user_data, number_of_events)`: as a listener it
    counts arrivals without any code of ours.
    """
    return ctypes.cast(ctypes.CDLL(None).eventfd_write, c_void_p)


def handle_of(entity: Any) -> Any:  # noqa: ANN401 (a class of pybind11)
    """Return the handle of an entity: the entity itself for other packages' waitables."""
    if isinstance(entity, GuardCondition):
        return getattr(entity.handle, 'instead_of', entity.handle)
    attribute = next(
        (name for each, (name, _) in LISTENERS.items() if isinstance(entity, each)), ''
    )
    return getattr(entity, attribute) if attribute else entity


def set_listener(entity: Any, descriptor: int | None) -> bool:  # noqa: ANN401
    """Have arrivals at an entity counted in an eventfd; with None, no longer.

    Returns False where there is no listener. Raises InvalidHandle where the entity was destroyed:
    then it has none any longer. Once a listener is taken back, no thread is left in it. It is set
    twice, as what arrives during the first call may be missed: the second counts it.
    """
    name = next((name for each, (_, name) in LISTENERS.items() if isinstance(entity, each)), '')
    if not name:
        return False
    handle, set_ = handle_of(entity), _setter(name)
    with handle:
        pointer = handle.pointer
        if descriptor is None:
            set_(pointer, None, None)
        elif any(set_(pointer, counting_listener(), descriptor) for _ in range(2)):
            ctypes.PyDLL('librcutils.so').rcutils_reset_error()
            return False
    return True


@cache
def _setter(name: str) -> Any:  # noqa: ANN401
    # PyDLL keeps the interpreter's lock, which guards rcl's timers. No listener needs it.
    function = getattr(ctypes.PyDLL('librcl.so'), f'rcl_{name}_callback')
    function.argtypes = (c_void_p, c_void_p, c_void_p)
    return function


class StandIn:
    """Stands for an object, and has the given attributes in place of the object's own."""

    def __init__(self, instead_of: Any, **attributes: object) -> None:  # noqa: ANN401
        vars(self).update(attributes, instead_of=instead_of)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401
        """Return an attribute of the object."""
        return getattr(self.instead_of, name)

    def __enter__(self) -> None:
        """Have the object in use."""
        self.instead_of.__enter__()

    def __exit__(self, *error: object) -> None:
        """Have it in use no longer."""
        self.instead_of.__exit__(*error)


def notify_of_triggers(guard: GuardCondition, notify: Callable[[], None] | None) -> None:
    """Call `notify` at each trigger of one guard condition; with None, no longer.

    Its handle is replaced and not its `trigger`, which others may have kept.
    """
    former, handle = guard.handle, handle_of(guard)
    if former is not handle:
        former.trigger_guard_condition = handle.trigger_guard_condition  # others may have kept it
    listening = notify and StandIn(handle, trigger_guard_condition=notify)
    guard._GuardCondition__gc = listening or handle


def was_triggered(guard: GuardCondition, context: Context) -> bool:
    """Forget the triggers of a guard condition; return whether there were any."""
    handle = handle_of(guard)
    if not context.ok():
        return False
    with handle, context.handle:
        wait_set = import_module('rclpy._rclpy_pybind11').WaitSet(0, 1, 0, 0, 0, 0, context.handle)
        wait_set.clear_entities()
        wait_set.add_guard_condition(handle)
        wait_set.wait(0)
        return bool(wait_set.get_ready_entities('guard_condition'))


def raised_by_rclpy(error: BaseException) -> bool:
    """Return whether an exception comes from Python code of rclpy that no other code has called."""
    names = [
        str(frame.f_globals.get('__name__')) for frame, _ in traceback.walk_tb(error.__traceback__)
    ]
    called = [name for name in names if not name.startswith('barc_sim.ros.executor.')]
    by_rclpy = called and all(name.startswith('rclpy.') for name in called)
    return bool(by_rclpy) and isinstance(error, Exception)
