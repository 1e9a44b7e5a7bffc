"""rcl's functions in C, through ctypes: its listeners, and its way to take a message.

rclpy offers no listeners in Python. One would also have to take the interpreter's lock for each
message. So rcl calls functions of libc and libstdc++ that count, without any code of ours.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress
from ctypes import PYFUNCTYPE, c_int32, c_void_p, py_object
from functools import cache
from typing import TYPE_CHECKING, Any
from weakref import finalize

from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from barc_sim.ros.executor.rclpy_private import message_functions

if TYPE_CHECKING:
    from collections.abc import Callable

#: By type of entity, the function of rcl that sets its listener.
LISTENERS: dict[type[Any], str] = {
    Subscription: 'subscription_set_on_new_message',
    Client: 'client_set_on_new_response',
    Service: 'service_set_on_new_request',
    Timer: 'timer_set_on_reset',
    EventHandler: 'event_set',
}
_OK = 0
_TAKE_FAILED = 401  # RCL_RET_SUBSCRIPTION_TAKE_FAILED: there is no message


# PyDLL keeps the interpreter's lock, which guards rcl's timers. No listener needs the lock.
@cache
def _library(name: str | None) -> ctypes.PyDLL:
    return ctypes.PyDLL(name)


@cache
def _type_returning(result: Any) -> Any:  # noqa: ANN401 (a type of ctypes)
    """Return the type of C functions with this result; ctypes would make one for each call."""
    return PYFUNCTYPE(result)


def check_functions() -> None:
    """Raise AttributeError or OSError if a library lacks a function."""
    for name in LISTENERS.values():
        _setter(name)
    _eventfd_write()
    _atomic_add()
    _ = _library('librcl.so').rcl_take


def set_listener(entry: Any, counter: int | c_int32 | None) -> bool:  # noqa: ANN401 (an Entry)
    """Count arrivals for an entity in an eventfd or in memory; None stops it.

    Returns False for a kind of entity without listeners; a destroyed entity needs none. After a
    listener was removed, no thread is in it any more. It is set twice: an arrival during the first
    call may be missed, and the second call counts it.
    """
    name = _listener_of(entry.entity)
    if name is None:
        return False

    listener = None
    target: Any = None
    if isinstance(counter, int):
        listener = _eventfd_write()
        target = counter
    elif counter is not None:
        listener = _atomic_add()
        target = ctypes.byref(counter)

    set_callback = _setter(name)
    with suppress(InvalidHandle), entry.handle:  # destroyed
        for _ in range(2):
            if set_callback(entry.handle.pointer, listener, target) != _OK:
                _reset_error()
                return False
    return True


def message_taker(subscription: Subscription) -> Callable[[], tuple[Any] | None]:
    """Return a function that takes the next message; InvalidHandle: the subscription is destroyed.

    rcl writes all messages into the same C struct; rclpy makes a new struct for each take, and a
    dictionary of the message's times.
    """
    functions = message_functions(subscription.msg_type)
    create = _type_returning(c_void_p)(functions.create)
    destroy = _type_returning(None)(functions.destroy)
    to_python = _type_returning(py_object)(functions.to_python)
    struct = c_void_p(create())
    finalize(struct, destroy, c_void_p(struct.value)).atexit = False  # daemons use it until then

    handle = subscription.handle
    pointer = c_void_p(handle.pointer)
    take = _library('librcl.so').rcl_take

    def take_message() -> tuple[Any] | None:
        # No other thread runs after the check of the handle. `argtypes` would cost 0.3 us.
        result = take(pointer if handle.pointer else None, struct, None, None)
        if result == _OK:
            return (to_python(struct),)
        if result == _TAKE_FAILED:
            return None
        _reset_error()
        if handle.pointer:
            raise RuntimeError(f'rcl_take returned {result}')
        raise InvalidHandle

    return take_message


# Two listeners for DDS, both with the signature `(user_data, number_of_events)`.


def _eventfd_write() -> Any:  # noqa: ANN401 (a function of ctypes)
    """Return libc's function that adds to an eventfd."""
    return _library(None).eventfd_write


def _atomic_add() -> Any:  # noqa: ANN401 (a function of ctypes)
    """Return the function of libstdc++, which DDS links too, that adds to a number in memory."""
    return _library('libstdc++.so.6')._ZN9__gnu_cxx12__atomic_addEPVii  # noqa: SLF001 (its name)


def _listener_of(entity: object) -> str | None:
    for kind, name in LISTENERS.items():
        if isinstance(entity, kind):
            return name
    return None


@cache
def _setter(name: str) -> Any:  # noqa: ANN401 (a function of ctypes)
    function = getattr(_library('librcl.so'), f'rcl_{name}_callback')
    function.argtypes = (c_void_p, c_void_p, c_void_p)
    return function


def _reset_error() -> None:
    """Clear rcl's error, which it would print with its next one."""
    _library('librcutils.so').rcutils_reset_error()
