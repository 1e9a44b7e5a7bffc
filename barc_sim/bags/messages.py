"""The messages of a run as classes and as CDR, without ROS."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.bags.cdr import HEADER, TIME, fixed_layout, split_time
from barc_sim.bags.metadata import Topic
from barc_sim.bags.schemas import definition, shipped

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from rosbags.typesys.store import Typestore

CMD_VEL = 'cmd_vel'
#: What sequences of numbers must be for rosbags.
_ARRAYS = {'float64': np.float64, 'int64': np.int64, 'byte': np.uint8, 'bool': np.bool_}

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


def message_class(type_name: str) -> type[Any]:
    """Return the class of a shipped type, as in `std_msgs/msg/Header`."""
    return _types().types[type_name]


def field_types(type_name: str) -> dict[str, Any]:
    """Return the fields of a shipped type with rosbags' descriptions; none of another type."""
    return dict(_types().fielddefs.get(type_name, ((), ()))[1])


def plain_fields(fields: Iterable[tuple[str, Any]]) -> dict[str, str]:
    """Return the types of fields as `fixed_layout` takes them, given with their descriptions."""
    return {name: str(of) if kind.name == 'NAME' else of[0] for name, (kind, of) in fields}


def packer(type_name: str) -> Callable[[int, Mapping[str, Any]], bytes]:
    """Return a function that serializes a message of a shipped type.

    It takes the time [ns] with which the message may begin, and the other fields by name.
    """
    fields = _types().fielddefs[type_name][1]
    if layout := fixed_layout(plain_fields(fields)):
        return layout.pack
    names, kinds = zip(*fields, strict=True)
    header = kinds[0][1] == HEADER
    arrays = {
        name: _ARRAYS[of[0][1][0]]
        for name, (kind, of) in zip(names, kinds, strict=True)
        if kind.name == 'SEQUENCE' and of[0][1][0] in _ARRAYS
    }
    begins_with_time = header or kinds[0][1] == TIME

    def pack_any(stamp: int, fields: Mapping[str, Any]) -> bytes:
        sec, nanosec = split_time(stamp)
        first: Any = message_class(TIME)(sec=sec, nanosec=nanosec)
        if header:
            first = message_class(HEADER)(stamp=first, frame_id='')
        leading = {names[0]: first} if begins_with_time else {}
        given = {
            name: np.asarray(value, arrays[name]) if name in arrays else value
            for name, value in fields.items()
        }
        message = message_class(type_name)(**leading, **given)
        return bytes(_types().serialize_cdr(message, type_name))

    return pack_any


def topic(name: str, type_name: str) -> Topic:
    """Return a bag's record of a topic that a run publishes without ROS."""
    return Topic(
        name=name,
        type=type_name,
        definition=definition(type_name),
        type_hash=_types().hash_rihs01(type_name),
        offered_qos=[_OFFERED_QOS | _QOS_OF.get(name, {})],
    )
