"""The private parts of rclpy and rcl that the executor uses, and whether they are as in Jazzy."""

# ruff: noqa: SLF001 - rclpy's private names are the point.

from __future__ import annotations

import ctypes
import os
from ctypes import c_char_p, c_void_p, py_object
from functools import cache
from typing import TYPE_CHECKING, Any
from weakref import finalize

from builtin_interfaces.msg import Time
from rclpy.action import ActionClient, ActionServer
from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.executors import Executor, MultiThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.type_support import check_is_valid_msg_type

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context

#: libc's `eventfd_write(descriptor, number)` has the signature of a listener of DDS,
#: `(user_data, number_of_events)`: as a listener it counts arrivals without any code of ours.
_COUNT = ctypes.cast(ctypes.CDLL(None).eventfd_write, c_void_p)

#: By type of entity, the attribute with its handle and the functions of rcl that set listeners.
LISTENERS: dict[type[Any], tuple[str, tuple[str, ...]]] = {
    Subscription: ('handle', ('subscription_set_on_new_message',)),
    Client: ('handle', ('client_set_on_new_response',)),
    Service: ('handle', ('service_set_on_new_request',)),
    Timer: ('handle', ('timer_set_on_reset',)),
    EventHandler: ('_EventHandler__event', ('event_set',)),
    ActionClient: (
        '_client_handle',
        (
            *(f'action_client_set_{part}_client' for part in ('goal', 'cancel', 'result')),
            *(f'action_client_set_{part}_subscription' for part in ('feedback', 'status')),
        ),
    ),
    ActionServer: (
        '_handle',
        tuple(f'action_server_set_{part}_service' for part in ('goal', 'cancel', 'result')),
    ),
}

#: What rcl's functions return that take a message.
TAKEN, NOTHING_THERE = 0, 401
_name_of = ctypes.PYFUNCTYPE(c_char_p, py_object)(('PyCapsule_GetName', ctypes.pythonapi))
_pointer_in = ctypes.PYFUNCTYPE(c_void_p, py_object, c_char_p)(
    ('PyCapsule_GetPointer', ctypes.pythonapi)
)

_TAKES = ('guard_condition', 'client', 'service', 'waitable')

#: Methods, and attributes that are set by a class's `__init__`.
_NAMES: tuple[tuple[Any, tuple[str, ...]], ...] = (
    (Executor, ('_guard', '_is_shutdown', '_tasks', '_tasks_lock', '_sigint_gc')),
    (MultiThreadedExecutor, ('_executor', *(f'_take_{kind}' for kind in _TAKES))),
    (GuardCondition, ('trigger', '_executor_triggered')),
    (_rclpy.Subscription, ('take_message', 'pointer')),
    (_rclpy.Timer, ('is_timer_ready', 'call_timer', 'time_until_next_call', 'pointer')),
    (_rclpy.EventHandle, ('take_event', 'pointer')),
    (_rclpy.WaitSet, ('clear_entities', 'wait', 'get_ready_entities', 'is_ready')),
)


def differing() -> list[str]:
    """Return the private names that this rclpy or rcl lacks, or that behave differently in it."""
    names = [
        f'{owner.__name__}.{name}'
        for owner, names in (*_NAMES, *((each, (LISTENERS[each][0],)) for each in LISTENERS))
        for name in names
        if not hasattr(owner, name) and name not in owner.__init__.__code__.co_names
    ]
    try:
        for name in (name for _, names in LISTENERS.values() for name in names):
            _setter(name)
    except (OSError, AttributeError) as error:
        names.append(str(error))
    checks = {
        'eventfd_write': _counts,
        '_take_guard_condition': _takes,
        '_CONVERT_TO_PY': _converts,
    }
    return names or [f'{name} as in Jazzy' for name, check in checks.items() if not check()]


def handle_of(entity: Any) -> Any:  # noqa: ANN401 (a class of pybind11)
    """Return the handle of an entity: the entity itself for other packages' waitables."""
    kind = next((each for each in LISTENERS if isinstance(entity, each)), None)
    if kind is None:
        return entity.handle if isinstance(entity, GuardCondition) else entity
    return getattr(entity, LISTENERS[kind][0])


def set_listener(entity: Any, descriptor: int | None) -> bool:  # noqa: ANN401
    """Have arrivals at an entity counted in an eventfd; with None, no longer.

    Returns False where there is no listener. The handle must be in use. Once a listener is taken
    back, no thread is left in it. It is set twice, as what arrives during the first call may be
    missed: the second counts it.
    """
    kind = next((each for each in LISTENERS if isinstance(entity, each)), None)
    if kind is None:
        return False
    pointer = handle_of(entity).pointer
    for name in LISTENERS[kind][1]:
        if descriptor is None:
            _setter(name)(pointer, None, None)
        elif any(_setter(name)(pointer, _COUNT, descriptor) for _ in range(2)):
            ctypes.PyDLL('librcutils.so').rcutils_reset_error()
            return False
    return True


@cache
def _setter(name: str) -> Any:  # noqa: ANN401
    # PyDLL keeps the interpreter's lock, which guards rcl's timers. No listener needs it.
    library = ctypes.PyDLL('librcl_action.so' if name.startswith('action') else 'librcl.so')
    function = getattr(library, f'rcl_{name}_callback')
    function.argtypes = (c_void_p, c_void_p, c_void_p)
    return function


def message_taker(subscription: Subscription) -> Callable[[], Any]:
    """Return a function that takes the next message of a subscription, or returns None.

    rcl writes all messages into one message of C, which is kept. rclpy makes a new one for each,
    and a dictionary of its times. The function is for one thread at a time, while the handle of the
    subscription is in use. It raises RuntimeError where rcl fails.
    """
    pointer = c_void_p(subscription.handle.pointer)
    kept, convert = _kept_message(subscription.msg_type)
    take = ctypes.PyDLL('librcl.so').rcl_take  # without `argtypes`, which cost 0.3 us

    def take_message() -> Any:  # noqa: ANN401 - of the subscription's type
        result = take(pointer, kept, None, None)
        if result == TAKEN:
            return convert(kept)
        if result != NOTHING_THERE:
            ctypes.PyDLL('librcutils.so').rcutils_reset_error()
            raise RuntimeError(f'rcl_take returned {result}')
        return None

    return take_message


def _kept_message(message_type: Any) -> tuple[c_void_p, Callable[[c_void_p], Any]]:  # noqa: ANN401
    """Return a message of C, and the function that converts it to one of Python."""
    functions = [
        ctypes.PYFUNCTYPE(result, *arguments)(_pointer_in(capsule, _name_of(capsule)))
        for capsule, result, *arguments in (
            (message_type._CREATE_ROS_MESSAGE, c_void_p),
            (message_type._DESTROY_ROS_MESSAGE, None, c_void_p),
            (message_type._CONVERT_TO_PY, py_object, c_void_p),
        )
    ]
    create, destroy, convert = functions
    kept = c_void_p(create())
    finalize(kept, destroy, kept.value)
    return kept, convert


def notify_of_triggers(guard: GuardCondition, notify: Callable[[], None] | None) -> None:
    """Call `notify` at each trigger of a guard condition; with None, no longer."""
    guard._notify = notify


def reset_trigger(guard: GuardCondition, context: Context) -> bool:
    """Forget the triggers of a guard condition; return whether there were any."""
    if not context.ok():
        return False
    with guard.handle, context.handle:
        wait_set = _rclpy.WaitSet(0, 1, 0, 0, 0, 0, context.handle)
        wait_set.clear_entities()
        wait_set.add_guard_condition(guard.handle)
        wait_set.wait(0)
        return bool(wait_set.get_ready_entities('guard_condition'))


def raised_by_rclpy(error: BaseException) -> bool:
    """Return whether an exception comes from Python code of rclpy that no other code has called."""
    names = []
    step = error.__traceback__
    while step:
        names.append(str(step.tb_frame.f_globals.get('__name__')))
        step = step.tb_next
    return all(name.startswith(('rclpy.', 'barc_sim.ros.executor.')) for name in names)


def _counts() -> bool:
    descriptor = os.eventfd(0, os.EFD_NONBLOCK)
    try:
        ctypes.CFUNCTYPE(None, c_void_p, ctypes.c_size_t)(_COUNT.value or 0)(descriptor, 3)
        return os.eventfd_read(descriptor) == 3  # noqa: PLR2004
    finally:
        os.close(descriptor)


def _takes() -> bool:
    """Return whether a take gives a function whose coroutine calls the callback."""
    called: list[bool] = []
    guard: Any = GuardCondition.__new__(GuardCondition)
    guard.callback = lambda: called.append(True)
    try:
        MultiThreadedExecutor._take_guard_condition(None, guard)().send(None)
    except StopIteration:
        return called == [True]
    except Exception:  # noqa: BLE001 - any error is another behaviour
        return False
    return False


def _converts() -> bool:
    """Return whether a message of C can be made and converted."""
    try:
        check_is_valid_msg_type(Time)  # loads what converts it
        kept, convert = _kept_message(Time)
        return bool(convert(kept) == Time())
    except Exception:  # noqa: BLE001 - any error is another behaviour
        return False


_destroy = Subscription.destroy
_trigger = GuardCondition.trigger


def _destroy_and_note(subscription: Subscription) -> None:
    subscription._is_destroyed = True
    _destroy(subscription)


def _trigger_and_notify(guard: GuardCondition) -> None:
    _trigger(guard)
    notify = getattr(guard, '_notify', None)
    if notify:
        notify()


if not differing():
    Subscription._is_destroyed = False
    Subscription.destroy = _destroy_and_note
    GuardCondition.trigger = _trigger_and_notify
