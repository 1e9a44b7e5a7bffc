"""The messages that wait in memory: in order, up to a size, and counted beyond it."""

from __future__ import annotations

from dataclasses import replace

from made_bags import VALUE

from barc_sim.bags.cache import OVERHEAD, MessageQueue, MessageRing
from barc_sim.bags.messages import BagMessage

SIZE = OVERHEAD + 100  # [B] of a message
OTHER = replace(VALUE, name='/other')


def message(number: int, size: int = 100) -> BagMessage:
    return BagMessage((VALUE, OTHER)[number % 2], bytes(size), number, number, number)


def numbers(messages: list[tuple[object, bytes, int, int, int]]) -> list[int]:
    return [number for _, _, _, _, number in messages]


def test_what_a_full_queue_does_not_take_is_lost_by_topic() -> None:
    queue = MessageQueue(3 * SIZE)
    queue.put(message(number) for number in range(3))
    queue.put(message(number) for number in range(3, 6))
    assert queue.lost == {'/value': 1, '/other': 2}
    assert numbers(queue.take()) == [0, 1, 2]
    queue.put([message(6)])
    assert numbers(queue.take()) == [6]


def test_messages_are_taken_in_order_and_in_parts() -> None:
    queue = MessageQueue(100 * SIZE)
    queue.put(message(number) for number in range(5))
    assert [numbers(queue.take(2 * SIZE)) for _ in range(3)] == [[0, 1], [2, 3], [4]]
    assert queue.take(SIZE) == []


def test_a_queue_with_room_takes_all_messages_of_a_call() -> None:
    queue = MessageQueue(SIZE)
    queue.put([message(1, 10_000), message(2)])
    queue.put([message(3)])
    assert numbers(queue.take()) == [1, 2]
    assert queue.lost == {'/other': 1}


def test_a_queue_without_a_size_takes_all() -> None:
    queue = MessageQueue(0)
    queue.put(message(number) for number in range(10_000))
    assert len(queue) == 10_000
    assert not queue.lost


def test_a_ring_keeps_the_latest_messages_and_loses_only_what_is_larger_than_it() -> None:
    ring = MessageRing(3 * SIZE)
    ring.put([*map(message, range(7)), message(7, 10_000), message(8)])
    assert numbers(ring.take()) == [5, 6, 8]
    assert ring.lost == {'/other': 1}
    assert not ring.take()
