"""Quality of service: the length of queues, and whether a publisher keeps its messages."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

HistoryPolicy = IntEnum('HistoryPolicy', 'SYSTEM_DEFAULT KEEP_LAST KEEP_ALL UNKNOWN', start=0)
ReliabilityPolicy = IntEnum(
    'ReliabilityPolicy', 'SYSTEM_DEFAULT RELIABLE BEST_EFFORT UNKNOWN BEST_AVAILABLE', start=0
)
DurabilityPolicy = IntEnum(
    'DurabilityPolicy', 'SYSTEM_DEFAULT TRANSIENT_LOCAL VOLATILE UNKNOWN BEST_AVAILABLE', start=0
)


@dataclass(kw_only=True)
class QoSProfile:
    """The length of a queue, and whether a publisher keeps messages; delivery is reliable.

    Parameters
    ----------
    depth
        The length of the queue, at least 1, unless the history keeps all messages.
    history, durability
        As in rclpy.
    reliability
        As in rclpy, but without effect.

    Attributes
    ----------
    length
        Of the queue; None: it has no limit.
    is_latched
        Whether a publisher keeps its messages for later subscriptions.
    """

    depth: int = 0
    history: Any = HistoryPolicy.KEEP_LAST
    reliability: Any = ReliabilityPolicy.RELIABLE
    durability: Any = DurabilityPolicy.VOLATILE

    def __post_init__(self) -> None:
        keeps_all = self.history == HistoryPolicy.KEEP_ALL
        self.length = None if keeps_all else max(self.depth, 1)
        self.is_latched = self.durability == DurabilityPolicy.TRANSIENT_LOCAL


qos_profile_system_default = QoSProfile(depth=10)
qos_profile_sensor_data = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
#: Of a publisher or subscription that gets the messages from before it began.
LATCHED = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def as_profile(qos: QoSProfile | int) -> QoSProfile:
    """Return the profile `qos`, or the profile with this depth."""
    return QoSProfile(depth=qos) if isinstance(qos, int) else qos
