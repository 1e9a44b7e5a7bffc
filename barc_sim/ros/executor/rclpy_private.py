"""The private parts of rclpy, rcl and Linux that the executor uses, and whether they are there.

`missing` is asked before any other module of the executor is imported, so that nothing here but
`missing` may rely on what it checks.
"""

# ruff: noqa: SLF001 - rclpy's private names are the point.

from __future__ import annotations

import ctypes
import os
import select
from ctypes import c_char_p, c_void_p, py_object
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any
from weakref import finalize

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

#: What rcl's functions return that take a message.
TAKEN, NOTHING_THERE = 0, 401
_name_of = ctypes.PYFUNCTYPE(c_char_p, py_object)(('PyCapsule_GetName', ctypes.pythonapi))
_pointer_in = ctypes.PYFUNCTYPE(c_void_p, py_object, c_char_p)(
    ('PyCapsule_GetPointer', ctypes.pythonapi)
)

#: By module and class, its private names: those that it has, or that its methods use.
_NAMES = """
rclpy.executors: TimeoutObject await_or_execute ShutdownException ExternalShutdownException
rclpy.executors:Executor _guard _is_shutdown _tasks _tasks_lock _sigint_gc can_execute
rclpy.executors:Executor _wait_for_ready_callbacks
rclpy.executors:MultiThreadedExecutor _executor _take_guard_condition _take_client _take_waitable
rclpy.callback_groups:MutuallyExclusiveCallbackGroup _lock _active_entity
concurrent.futures:ThreadPoolExecutor _max_workers _threads
rclpy.task:Future remove_done_callback
rclpy.guard_condition:GuardCondition _GuardCondition__gc _executor_triggered _executor_event
rclpy.subscription:Subscription _callback_type _executor_event
rclpy.subscription:Subscription.CallbackType MessageOnly
rclpy.timer:Timer _executor_event
rclpy.client:Client _executor_event
rclpy.service:Service _executor_event
rclpy.waitable:Waitable _executor_event
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
    checks = {
        'eventfd, epoll or timerfd': _counts,
        'listeners': _listens,
        '_take_guard_condition': _takes,
        '_CONVERT_TO_PY': _converts,
    }
    return lacking or [f'{name} as in Jazzy' for name, check in checks.items() if not _holds(check)]


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


def _holds(check: Callable[[], bool]) -> bool:
    try:
        return check()
    except Exception:  # noqa: BLE001 - any error is another behaviour
        return False


def handle_of(entity: Any) -> Any:  # noqa: ANN401 (a class of pybind11)
    """Return the handle of an entity: the entity itself for other packages' waitables."""
    kind = next((each for each in LISTENERS if isinstance(entity, each)), None)
    if isinstance(entity, GuardCondition):
        return getattr(entity.handle, 'instead_of', entity.handle)
    if kind is None:
        return entity
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
    pointer, set_ = handle_of(entity).pointer, _setter(LISTENERS[kind][1])
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


def note_destruction(entity: Any, note: Callable[[], None] | None) -> None:  # noqa: ANN401
    """Call `note` before one entity is destroyed; with None, no longer."""
    vars(entity).pop('destroy', None)
    if note:
        destroy = entity.destroy
        entity.destroy = lambda: (note(), destroy())


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
    names = []
    step = error.__traceback__
    while step:
        names.append(str(step.tb_frame.f_globals.get('__name__')))
        step = step.tb_next
    return all(name.startswith(('rclpy.', 'barc_sim.ros.executor.')) for name in names)


def counting_listener() -> c_void_p:
    """Return libc's `eventfd_write(descriptor, number)`.

    It has the signature of a listener of DDS, `(user_data, number_of_events)`: as a listener it
    counts arrivals without any code of ours.
    """
    return ctypes.cast(ctypes.CDLL(None).eventfd_write, c_void_p)


def _counts() -> bool:
    """Return whether a listener counts in an eventfd, and epoll and timerfd are there."""
    listener = ctypes.CFUNCTYPE(None, c_void_p, ctypes.c_size_t)(counting_listener().value or 0)
    counter = os.eventfd(0, os.EFD_NONBLOCK)
    os.close(ctypes.CDLL(None).timerfd_create(1, 0))
    try:
        with select.epoll() as poll:
            poll.register(counter, select.EPOLLIN)
            listener(counter, 3)
            return poll.poll(0) == [(counter, 1)] and os.eventfd_read(counter) == 3  # noqa: PLR2004
    finally:
        os.close(counter)


def _listens() -> bool:
    """Return whether rcl has all functions that set listeners."""
    return all(_setter(name) for _, name in LISTENERS.values())


def _takes() -> bool:
    """Return whether a take gives a function whose coroutine calls the callback."""
    called: list[bool] = []
    guard: Any = GuardCondition.__new__(GuardCondition)
    guard.callback = lambda: called.append(True)
    executor = import_module('rclpy.executors').MultiThreadedExecutor
    try:
        executor._take_guard_condition(None, guard)().send(None)
    except StopIteration:
        return called == [True]
    return False


def _converts() -> bool:
    """Return whether a message of C can be made and converted."""
    time = import_module('builtin_interfaces.msg').Time
    import_module('rclpy.type_support').check_is_valid_msg_type(time)  # loads what converts it
    kept, convert = _kept_message(time)
    return bool(convert(kept) == time())
