"""Polled subscriptions: no executor calls back for them, a thread takes their raw messages."""

from __future__ import annotations

import ctypes
from ctypes import c_size_t, c_void_p
from struct import Struct
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import QoSSubscriptionEventType, SubscriptionEventCallbacks

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription

#: Fields of rmw_message_info_t in its order: times of publication and reception, number, and the
#: publisher's GID, which rclpy's own take omits.
_INFO = Struct('=qqQ16x16s')
_MAX_INFO = 256  # bytes: another rmw may write more than Fast DDS
_NO_MESSAGE = 401  # RCL_RET_SUBSCRIPTION_TAKE_FAILED


class PolledCallbackGroup(CallbackGroup):
    """Keeps its subscriptions out of every executor's wait set.

    A wake-up for each message would cost 4 % of a core at 50 Hz with 7 topics. Polling all of them
    costs about 1 % even every 50 ms, and `WriterThread` polls every 0.1 s; nothing runs between a
    state and the command that answers it. DDS stamps the time of reception, so a late poll loses
    nothing.
    """

    polled = True  #: QuickExecutor ignores them, too

    def can_execute(self, entity: object) -> bool:  # noqa: ARG002 (rclpy's)
        """Return False: no executor calls back for its subscriptions."""
        return False


def subscribe(node: Node, message_type: type[Any], name: str, qos: QoSProfile) -> Subscription:
    """Return a new subscription of `node` for a `Taker`."""
    events = SubscriptionEventCallbacks(
        message_lost=lambda _: None,  # for `undelivered`
        use_default_callbacks=False,
    )
    return node.create_subscription(
        message_type,
        name,
        lambda _: None,
        qos,
        callback_group=PolledCallbackGroup(),
        event_callbacks=events,
        raw=True,
    )


def undelivered(subscription: Subscription) -> int:
    """Return the number of messages that the middleware could not deliver, as it counts them."""
    for handler in subscription.event_handlers:
        if handler.event_type == QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST:
            # `handler.take_data` takes only what an executor has waited for.
            event = handler._EventHandler__event  # noqa: SLF001
            with event:
                return int(event.take_event().total_count)
    return 0


class _Allocator(ctypes.Structure):  # rcutils_allocator_t: four functions and their state
    _fields_ = (('pointers', c_void_p * 5),)


class _Uint8Array(ctypes.Structure):  # rcutils_uint8_array_t
    _fields_ = (
        ('buffer', c_void_p),
        ('length', c_size_t),
        ('capacity', c_size_t),
        ('allocator', _Allocator),
    )


class Taker:
    """Takes messages through one buffer, which rcl enlarges; for one thread at a time."""

    def __init__(self) -> None:
        rcutils = ctypes.PyDLL('librcutils.so')
        rcutils.rcutils_get_default_allocator.restype = _Allocator
        self._array = _Uint8Array(allocator=rcutils.rcutils_get_default_allocator())
        self._info = ctypes.create_string_buffer(_MAX_INFO)
        # PyDLL keeps the interpreter's lock: to release it for 2 us would cost more than that.
        self._take = ctypes.PyDLL('librcl.so').rcl_take_serialized_message
        self._free = rcutils.rcutils_uint8_array_fini

    def take(
        self, subscription: Subscription, maximum: int
    ) -> list[tuple[bytes, int, int, int, bytes]]:
        """Return at most `maximum` of the messages that wait in `subscription`.

        Each has its CDR, and then the fields of rmw_message_info_t in its order: the times of
        publication and reception [ns], the publisher's number for it, and the publisher's GID.
        RuntimeError: rcl has failed.
        """
        # Names of its own for each: attributes would be looked up again for each message.
        take = self._take
        array = self._array
        info = self._info
        array_reference = ctypes.byref(array)
        info_reference = ctypes.byref(info)

        buffer = (ctypes.c_char * 0)()
        messages: list[Any] = []
        result = 0
        with subscription.handle:
            pointer = c_void_p(subscription.handle.pointer)
            while len(messages) < maximum:
                result = take(pointer, array_reference, info_reference, None)
                if result != 0:
                    break
                if array.capacity != len(buffer):
                    buffer = (ctypes.c_char * array.capacity).from_address(array.buffer)
                messages.append((buffer[: array.length], *_INFO.unpack_from(info)))

        if result not in (0, _NO_MESSAGE):
            raise RuntimeError(
                f'rcl_take_serialized_message returned {result} on {subscription.topic_name}'
            )
        return messages

    def close(self) -> None:
        """Free the buffer."""
        self._free(ctypes.byref(self._array))
