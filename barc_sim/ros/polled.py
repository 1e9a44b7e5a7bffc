"""Subscriptions that no executor waits for: their owner polls them, and takes what has arrived."""

from __future__ import annotations

import ctypes
import os
import select
import weakref
from contextlib import suppress
from ctypes import c_void_p
from struct import Struct
from typing import TYPE_CHECKING, Any, NamedTuple

from builtin_interfaces.msg import Time
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle

from barc_sim.ros.executor import PolledCallbackGroup
from barc_sim.ros.executor.rclpy_private import NOTHING_THERE, TAKEN, set_listener

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription


class Arrivals:
    """Counts what arrives at polled subscriptions in one descriptor, to sleep until then."""

    def __init__(self) -> None:
        """Listen to nothing yet."""
        self._descriptor = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._close = weakref.finalize(self, os.close, self._descriptor)
        self._subscriptions: list[Subscription] = []  # their handles are in use

    def listen(self, subscriptions: Iterable[Subscription]) -> None:
        """Count what arrives at these subscriptions, and at no others."""
        while self._subscriptions:
            subscription = self._subscriptions.pop()
            set_listener(subscription, None)
            subscription.handle.__exit__(None, None, None)
        for subscription in subscriptions:
            with suppress(InvalidHandle):
                subscription.handle.__enter__()
                self._subscriptions.append(subscription)
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


def polled(
    node: Node,
    message_type: type[Any],
    topic: str,
    qos: QoSProfile | int,
    group: PolledCallbackGroup,
    *,
    raw: bool = False,
) -> Subscription:
    """Return a subscription that keeps messages until `take` takes them.

    Where `qos` is a number, that is the length of the queue, which keeps the newest messages. With
    `raw`, messages stay serialized.
    """
    events = SubscriptionEventCallbacks(use_default_callbacks=False)
    return node.create_subscription(
        message_type,
        topic,
        lambda _: None,
        qos,
        callback_group=group,
        event_callbacks=events,
        raw=raw,
    )


def take(subscription: Subscription, limit: int) -> Iterator[tuple[Any, dict[str, int]]]:
    """Yield up to `limit` waiting messages, each with the middleware's information on it."""
    for _ in range(limit):
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, False)
        if taken is None:
            return
        yield taken


_SECOND = 1_000_000_000  # ns


class Taken(NamedTuple):
    """A message that was received."""

    data: bytes  #: in CDR, with its header
    published: int  #: [ns] since the epoch, by the publisher's clock
    received: int  #: [ns] since the epoch
    number: int  #: the publisher's count of its messages
    publisher: bytes  #: its GID


#: Those of `Taken`, which takes 0.4 us to make.
_Fields = tuple[bytes, int, int, int, bytes]


class _Allocator(ctypes.Structure):  # rcutils_allocator_t
    _fields_ = tuple(
        (name, c_void_p)
        for name in ('allocate', 'deallocate', 'reallocate', 'zero_allocate', 'state')
    )


#: rcutils_uint8_array_t: buffer, length, capacity; the allocator follows.
_ARRAY = Struct('PNN')
#: rmw_message_info_t, as far as needed: times of publication and reception, sequence numbers of
#: both; then rmw_gid_t: name of the middleware, GID.
_INFO = Struct('qqQQP16s')
_INFO_SIZE = 256  # with what follows, and room for what another rmw may have


class Taker:
    """Takes messages, through one buffer that grows with them; for one thread at a time.

    Parameters
    ----------
    node
        On whose topic `_layout`, which is hidden and gone at once, one message is sent to check.
    """

    def __init__(self, node: Node) -> None:
        rcutils = ctypes.PyDLL('librcutils.so')
        rcutils.rcutils_get_default_allocator.restype = _Allocator
        allocator = bytes(rcutils.rcutils_get_default_allocator())
        self._free = rcutils.rcutils_uint8_array_fini
        self._array = bytearray(_ARRAY.size) + allocator
        self._info = bytearray(_INFO_SIZE)
        self._addresses = [
            ctypes.addressof((ctypes.c_char * len(each)).from_buffer(each))
            for each in (self._array, self._info)
        ]
        # PyDLL keeps the interpreter's lock: to give it up for 2 us would cost more than that.
        self._take = ctypes.PyDLL('librcl.so').rcl_take_serialized_message
        self._take.argtypes = (c_void_p, c_void_p, c_void_p, c_void_p)
        self._fits = _fits(self, node)

    def take(self, subscription: Subscription) -> Iterator[_Fields]:
        """Return what waits in `subscription`, and what arrives meanwhile: the fields of `Taken`.

        Raises
        ------
        RuntimeError
            rcl has failed.
        """
        return self._take_all(subscription) if self._fits else _rclpys(subscription)

    def _take_all(self, subscription: Subscription) -> Iterator[_Fields]:
        take, info, array, string_at = self._take, self._info, self._array, ctypes.string_at
        unpack_info, unpack_array = _INFO.unpack_from, _ARRAY.unpack_from
        with subscription.handle:
            pointer = subscription.handle.pointer
            while (result := take(pointer, *self._addresses, None)) == TAKEN:
                published, received, number, _, _, publisher = unpack_info(info)
                buffer, length, _ = unpack_array(array)
                yield string_at(buffer, length), published, received, number, publisher
        if result != NOTHING_THERE:
            raise RuntimeError(
                f'rcl_take_serialized_message returned {result} on {subscription.topic_name}'
            )

    def close(self) -> None:
        """Free the buffer."""
        self._free(c_void_p(self._addresses[0]))


def _rclpys(subscription: Subscription) -> Iterator[_Fields]:
    """Yield the same as a `Taker`, but for the publisher, the way of rclpy."""
    while True:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, True)
        if taken is None:
            return
        data, about = taken
        number = about['publication_sequence_number']
        yield data, about['source_timestamp'], about['received_timestamp'], number or 0, b''


def _fits(taker: Taker, node: Node) -> bool:
    """Return whether a taker takes a message as rclpy does."""
    subscriptions = [
        node.create_subscription(
            Time, '_layout', lambda _: None, 1, callback_group=PolledCallbackGroup(), raw=True
        )
        for _ in range(2)
    ]
    publisher = node.create_publisher(Time, '_layout', 1)
    publisher.publish(Time(sec=1))
    try:
        ((data, published, received, number, _),) = taker._take_all(subscriptions[0])  # noqa: SLF001
        (theirs,) = _rclpys(subscriptions[1])
        # Each subscription notes its own time of reception.
        near = abs(received - theirs[2]) < _SECOND
        return near and theirs == (data, published, theirs[2], number, b'')
    except (ValueError, RuntimeError):  # not one message each
        return False
    finally:
        node.destroy_publisher(publisher)
        for subscription in subscriptions:
            node.destroy_subscription(subscription)
