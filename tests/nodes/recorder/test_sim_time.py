"""Simulated time in a bag: the clock's, as soon as it is heard."""

from __future__ import annotations

import struct

from barc_sim.bags.metadata import Topic
from barc_sim.nodes.recorder.sim_time import SimulatedTime
from barc_sim.ros.topic_subscriptions import Message

SECOND = 1_000_000_000


def message(name: str, received: int, data: bytes = b'') -> Message:
    topic = Topic(name=name, type='a/msg/B', definition='', type_hash='', offered_qos=())
    return Message(topic, data, received, received, 1)


def clock(received: int, sec: int, nanosec: int = 0, *, little: bool = True) -> Message:
    order = '<' if little else '>'
    header = bytes([0, little, 0, 0])
    return message('/clock', received, header + struct.pack(f'{order}iI', sec, nanosec))


def times(*messages: Message, time: SimulatedTime | None = None) -> list[int]:
    return [each.received for each in (time or SimulatedTime()).stamped(messages)]


def test_messages_before_the_first_clock_stay_as_they_are() -> None:
    assert times(message('/a', 5), message('/b', 6)) == [5, 6]


def test_messages_are_received_at_the_time_of_the_latest_clock() -> None:
    found = times(message('/a', 1), clock(2, 7), message('/a', 3), clock(4, 8, 5), message('/a', 9))
    assert found == [1, 7 * SECOND, 7 * SECOND, 8 * SECOND + 5, 8 * SECOND + 5]


def test_the_clock_goes_on_from_one_turn_to_the_next() -> None:
    time = SimulatedTime()
    times(clock(2, 7), time=time)
    assert times(message('/a', 3), time=time) == [7 * SECOND]


def test_either_order_of_bytes_is_read() -> None:
    assert times(clock(1, 258, 3, little=False)) == times(clock(1, 258, 3)) == [258 * SECOND + 3]


def test_the_other_times_are_kept() -> None:
    (_, stamped) = SimulatedTime().stamped([clock(2, 7), message('/a', 3)])
    assert (stamped.published, stamped.number) == (3, 1)
