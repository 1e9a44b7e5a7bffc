"""Messages as a bag has them: in CDR, with their times, and their topics without ROS.

CDR is the encoding of DDS (OMG formal/2008-01-04, 15.3, PLAIN_CDR).
"""

from __future__ import annotations

import re
from functools import cache
from operator import itemgetter
from struct import Struct
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.bags.recording import Topic
from barc_sim.bags.schemas import definition, shipped

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from rosbags.typesys.store import Typestore

NANOSECONDS = 1_000_000_000

_LITTLE_ENDIAN = b'\0\1\0\0'
_STAMP = slice(4, 12)
_LAST = 2**31 - 1  #: [s]
_TIMES = (Struct('>iI'), Struct('<iI'))  # big-endian, little-endian
_HEADER = 'std_msgs/msg/Header'
_CODES = {'float64': 'd', 'bool': '?'}

#: The QoS that ROS reports of a publisher of another participant, in rosbag2's terms.
_ENDLESS = {'sec': 9_223_372_036, 'nsec': 854_775_807}
#: `/rosout` is latched for ten seconds.
_QOS_OF = {'/rosout': {'durability': 'transient_local', 'lifespan': {'sec': 10, 'nsec': 0}}}
_OFFERED_QOS = {
    'history': 'unknown',
    'depth': 0,
    'reliability': 'reliable',
    'durability': 'volatile',
    'deadline': _ENDLESS,
    'lifespan': _ENDLESS,
    'liveliness': 'automatic',
    'liveliness_lease_duration': _ENDLESS,
    'avoid_ros_namespace_conventions': False,
}


class Message(NamedTuple):
    """A message to write."""

    topic: Topic
    data: bytes  #: in CDR, with its header
    received: int  #: [ns] since the epoch
    published: int  #: [ns] since the epoch
    number: int  #: the publisher's count


#: Those of a `Message`, which takes 0.3 us to make.
MessageFields = tuple[Topic, bytes, int, int, int]


def leading_time(data: bytes) -> int:
    """Return the time [ns] at the start of a serialized message: a header's stamp, or a clock."""
    sec, nanosec = _TIMES[data[1] & 1].unpack(data[_STAMP])
    return int(sec) * NANOSECONDS + int(nanosec)


def split_time(stamp: int) -> tuple[int, int]:
    """Return a time [ns] as seconds and nanoseconds; the inverse of `leading_time`.

    Nanoseconds beyond a second stay where the seconds are at their end, as a stranger may send it.
    """
    sec, nanosec = divmod(stamp, NANOSECONDS)
    return (sec, nanosec) if sec <= _LAST else (_LAST, stamp - _LAST * NANOSECONDS)


def fixed_reader(
    fields: Iterable[tuple[str, Any]], wanted: Sequence[str]
) -> Callable[[bytes], tuple[float, ...] | None] | None:
    """Return a function that reads the `wanted` fields, two or more, of a message.

    It takes the message in CDR, and returns None for one in the other order of bytes. There is none
    for fields, with rosbags' descriptions, that do not begin with a header, doubles and flags:
    others have no fixed place in the bytes. Those behind them must be empty.
    """
    (_, first), *others = fields
    names = [name for name, _ in others]
    codes = ''.join(_CODES.get(of[0], ' ') for _, (_, of) in others).rstrip()
    fixed = first[1] == _HEADER and re.fullmatch(r'd+\?*', codes)
    if not fixed or not set(wanted) <= set(names[: len(codes)]):
        return None
    struct, select = Struct('<' + codes), itemgetter(*map(names.index, wanted))

    def read(data: bytes) -> tuple[float, ...] | None:
        if data[:4] != _LITTLE_ENDIAN:
            return None
        # The frame's length is behind the stamp; what follows begins at a multiple of 8, counted
        # from behind the encoding's four bytes.
        at = 4 + (int.from_bytes(data[12:16], 'little') + 19 & ~7)
        if any(data[at + struct.size :]):
            return None
        values: tuple[float, ...] = select(struct.unpack_from(data, at))
        return values

    return read


@cache
def _types() -> Typestore:
    """Return the types whose definitions are shipped with barc_sim."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 (100 ms)

    store = get_typestore(Stores.EMPTY)
    types: dict[str, Any] = {}
    for name, path in shipped():
        types |= get_types_from_msg(path.read_text(encoding='utf-8'), name)
    store.register(types)
    return store


def field_types(type_name: str) -> Mapping[str, Any]:
    """Return the fields of a shipped type with rosbags' descriptions; none of another type."""
    return dict(_types().fielddefs.get(type_name, ((), ()))[1])


def topic(name: str, type_name: str, store: Typestore | None = None) -> Topic:
    """Return a bag's record of a topic that a run publishes without ROS.

    What is neither installed nor shipped has its definition from `store`.
    """
    store = store or _types()
    try:
        text = definition(type_name)
    except LookupError:
        text, _ = store.generate_msgdef(type_name, ros_version=2)
    return Topic(
        name=name,
        type=type_name,
        definition=text,
        type_hash=store.hash_rihs01(type_name),
        offered_qos=[_OFFERED_QOS | _QOS_OF.get(name, {})],
    )
