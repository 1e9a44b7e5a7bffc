"""Subscriptions that no executor waits for: their owner polls them, and takes what has arrived."""

from __future__ import annotations

import ctypes
import os
import select
import weakref
from ctypes import c_size_t, c_void_p
from struct import Struct
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks

from barc_sim.ros.executor.rclpy_private import set_listener
from barc_sim.ros.executor.waiting import counter, retire

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription


class PolledCallbackGroup(CallbackGroup):
    """Keeps its subscriptions out of every executor's wait set.

    Waking up for each message would cost 4 % of a core at 50 Hz with 7 topics; polling all of them
    every 50 ms costs about 1 %, and nothing runs between a state and the command that answers it.
    DDS stamps the time of reception, so polling late loses nothing.
    """

    polled = True  #: QuickExecutor leaves them out, too

    def can_execute(self, entity: object) -> bool:  # noqa: ARG002 (rclpy's)
        """Never."""
        return False


def polled(node: Node, message_type: type[Any], topic: str, qos: QoSProfile) -> Subscription:
    """Return a subscription that keeps messages, serialized, until a `Taker` takes them."""
    return node.create_subscription(
        message_type,
        topic,
        lambda _: None,
        qos,
        callback_group=PolledCallbackGroup(),
        event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        raw=True,
    )


class Arrivals:
    """Counts what arrives at polled subscriptions in one descriptor, to sleep until then."""

    def __init__(self) -> None:
        """Listen to nothing yet."""
        self._descriptor = counter()
        weakref.finalize(self, retire, self._descriptor)
        self._subscriptions: list[Subscription] = []

    def listen(self, subscriptions: Iterable[Subscription]) -> None:
        """Count what arrives at these subscriptions, and at no others."""
        for subscription in self._subscriptions:
            set_listener(subscription, None)
        self._subscriptions = [*subscriptions]
        for subscription in self._subscriptions:
            if not set_listener(subscription, self._descriptor):
                self.wake()  # the middleware has no listeners: no sleep

    def wait(self, timeout_sec: float) -> None:
        """Sleep until something has arrived, `wake` is called or the time is over."""
        poll = select.poll()
        poll.register(self._descriptor, select.POLLIN)
        if poll.poll(timeout_sec * 1e3):
            os.eventfd_read(self._descriptor)

    def wake(self) -> None:
        """End a `wait`, from any thread."""
        os.eventfd_write(self._descriptor, 1)


class _Allocator(ctypes.Structure):  # rcutils_allocator_t: four functions, and their state
    _fields_ = (('pointers', c_void_p * 5),)


class _Array(ctypes.Structure):  # rcutils_uint8_array_t
    _fields_ = (
        ('buffer', c_void_p),
        ('length', c_size_t),
        ('capacity', c_size_t),
        ('allocator', _Allocator),
    )


#: Of rmw_message_info_t: times of publication and reception, number, and the publisher's GID, which
#: rclpy's own take leaves out.
_INFO = Struct('=qqQ16x16s')
_MOST_INFO = 256  # bytes, as much as another rmw may write
_NOTHING_THERE = 401  # RCL_RET_SUBSCRIPTION_TAKE_FAILED


class Taker:
    """Takes messages through one buffer, which rcl makes larger; for one thread at a time."""

    def __init__(self) -> None:
        rcutils = ctypes.PyDLL('librcutils.so')
        rcutils.rcutils_get_default_allocator.restype = _Allocator
        self._array = _Array(allocator=rcutils.rcutils_get_default_allocator())
        self._info = ctypes.create_string_buffer(_MOST_INFO)
        # PyDLL keeps the interpreter's lock: to give it up for 2 us would cost more than that.
        self._take = ctypes.PyDLL('librcl.so').rcl_take_serialized_message
        self._free = rcutils.rcutils_uint8_array_fini

    def take(
        self, subscription: Subscription, most: int
    ) -> list[tuple[bytes, int, int, int, bytes]]:
        """Return what waits in `subscription`, `most` messages.

        Of each, the message in CDR; the times of publication and reception [ns]; the publisher's
        count of its messages, and its GID.

        Raises
        ------
        RuntimeError
            rcl has failed.
        """
        take, array, info, unpack = self._take, self._array, self._info, _INFO.unpack_from
        arguments = ctypes.byref(array), ctypes.byref(info), None
        buffer = (ctypes.c_char * 0)()
        taken: list[Any] = []
        result = 0
        with subscription.handle:
            pointer = c_void_p(subscription.handle.pointer)
            while len(taken) < most and (result := take(pointer, *arguments)) == 0:
                if array.capacity != len(buffer):
                    buffer = (ctypes.c_char * array.capacity).from_address(array.buffer)
                taken.append((buffer[: array.length], *unpack(info)))
        if result not in (0, _NOTHING_THERE):
            raise RuntimeError(
                f'rcl_take_serialized_message returned {result} on {subscription.topic_name}'
            )
        return taken

    def close(self) -> None:
        """Free the buffer."""
        self._free(ctypes.byref(self._array))
