"""The QoS of topics: rclpy's default, reliable, with a queue of one of these depths."""

from __future__ import annotations

DEFAULT = 100  #: messages, of every topic of a run: one second at 100 Hz
#: Of a node that needs every state and that the simulator does not wait for: in lock-step many
#: states arrive during one of its callbacks.
EVERY_STATE = 10_000
NEWEST = 1  #: of a subscription that needs only the newest message
