"""Messages and their topics as a bag has them.

CDR is the encoding of DDS (OMG formal/2008-01-04, 15.3, PLAIN_CDR).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.interfaces.definitions import DELIMITER, definition_without_ros, store
from barc_sim.interfaces.topics import ROSOUT

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

IDL = f'{DELIMITER}\nIDL: '  #: begins a `ros2idl` definition
CDR = 'cdr'  #: the encoding of ROS's messages
ROS2MSG = 'ros2msg'  #: the encoding of definitions as in `.msg` files
ROS2IDL = 'ros2idl'  #: the encoding of definitions as in `.idl` files


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A bag's record of a topic; a topic with messages of two types has two records."""

    name: str
    type: str  #: as in `std_msgs/msg/Header`; empty without a schema
    definition: str  #: of the type with all types that it uses; bytes without UTF-8 are surrogates
    type_hash: str  #: as in `RIHS01_…`
    offered_qos: Sequence[Mapping[str, Any]]  #: of each publisher, in rosbag2's terms
    schema_encoding: str | None = ROS2MSG  #: of the definition; None without a schema
    message_encoding: str = CDR
    #: All metadata of the channel, as a bag has it; None: it has type hash and QoS.
    metadata: Mapping[str, str] | None = None


_ENDLESS = {'sec': 9_223_372_036, 'nsec': 854_775_807}
#: The QoS that ROS reports of a publisher of another participant, in rosbag2's terms.
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
#: What differs for a topic: `/rosout` is latched for ten seconds.
_QOS_OF = {ROSOUT: {'durability': 'transient_local', 'lifespan': {'sec': 10, 'nsec': 0}}}


class BagMessage(NamedTuple):
    """A message of a bag, as the reader yields it."""

    topic: Topic
    data: bytes  #: in CDR, with its header
    received: int  #: [ns] since the epoch
    published: int  #: [ns] since the epoch
    number: int  #: the publisher's count


#: A message to write: the fields of a `BagMessage` in its order, as a plain tuple. A recorder makes
#: thousands of them a second, and a `BagMessage` takes 0.3 us longer to make.
MessageFields = tuple[Topic, bytes, int, int, int]


def topic(name: str, type_name: str) -> Topic:
    """Return a bag's record of a topic that a run publishes without ROS."""
    return Topic(
        name=name,
        type=type_name,
        definition=definition_without_ros(type_name),
        type_hash=store().hash_rihs01(type_name),
        offered_qos=[_OFFERED_QOS | _QOS_OF.get(name, {})],
    )
